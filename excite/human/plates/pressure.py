"""Centres of pressure, and how far from the feet they lie."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.human.body import Body
from excite.human.posture.skeleton import Placement
from excite.human.recording import PlateRecording
from excite.human.segments import NAMES

LOADED_N = 50.0
"""Vertical force above which a centre of pressure means something [N]."""


def pressure_center(force: Array, moment: Array, height: float) -> Array:
    """Where a force acts on the plane ``z = height``, ``(n, 3)``; NaN where it is not loaded.

    Args:
        force: ``(n, 3)`` [N].
        moment: about the world's origin ``(n, 3)`` [N·m].
        height: of the plane [m].
    """
    vertical = np.where(force[:, 2] > LOADED_N, force[:, 2], np.nan)
    x = (-moment[:, 1] + height * force[:, 0]) / vertical
    y = (moment[:, 0] + height * force[:, 1]) / vertical
    return np.column_stack([x, y, np.full(len(force), height)])


def foot_line(placement: Placement, side: str, body: Body) -> Array:
    """Heel and toe of a foot over time, ``(n, 2, 3)``."""
    k = NAMES.index(f"{side}_foot")
    d = body.dimensions
    front = d.foot_length - d.heel
    ends = np.array([[-d.heel, 0.0, -d.ankle_height], [front, 0.0, -d.ankle_height]])
    return placement.origin[:, k, None] + np.einsum("nij,ej->nei", placement.rotation[:, k], ends)


def foot_distances(plate: PlateRecording, feet: dict[str, Array], height: float) -> dict[str, Array]:
    """Horizontal distance of the centre of pressure from each foot's line, ``(n,)``, NaN where not loaded."""
    point = pressure_center(plate.force, plate.moment, height)[:, :2]
    found = {}
    for side, line in feet.items():
        heel, toe = line[:, 0, :2], line[:, 1, :2]
        along = toe - heel
        share = np.einsum("ni,ni->n", point - heel, along) / np.maximum((along**2).sum(axis=1), 1e-6)
        nearest = heel + np.clip(share, 0.0, 1.0)[:, None] * along
        found[side] = np.linalg.norm(point - nearest, axis=1)
    return found


def typical_miss(plate: PlateRecording, feet: dict[str, Array], height: float) -> float:
    """Typical distance of the centre of pressure from the nearer foot [m]."""
    nearest = np.minimum(*foot_distances(plate, feet, height).values())
    return float(np.nanmedian(nearest)) if np.isfinite(nearest).any() else 0.0
