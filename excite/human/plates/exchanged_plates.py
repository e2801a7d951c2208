"""Plates whose channels and places do not belong together."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.finding import Finding
from excite.human.plates.pressure import typical_miss
from excite.human.recording import PlateRecording

NEAR, FAR = 0.15, 0.25
"""A foot that stands on a plate has the centre of pressure below it; both are good to a few centimetres [m]."""


def unswapped_plates(
    plates: list[PlateRecording], feet: dict[str, Array], height: float, source: Path
) -> tuple[list[PlateRecording], list[Finding]]:
    """Plates with each other's places where that brings the centres of pressure under the feet, and a finding.

    Args:
        plates: loaded plates in a world with z up.
        feet: heel and toe of either foot over time, ``(n, 2, 3)``.
        height: of the ground [m].
        source: of the recording.
    """
    worst = max(typical_miss(plate, feet, height) for plate in plates)
    placed = [plate for plate in plates if plate.corners is not None]
    if worst < NEAR or len(placed) < len(plates) or not 2 <= len(plates) <= 4:
        return plates, []
    best, best_miss, order = plates, worst, tuple(range(len(plates)))
    for chosen in permutations(range(len(plates))):
        moved = [_move_plate(plates[i], plates[j]) for i, j in enumerate(chosen)]
        miss = max(typical_miss(plate, feet, height) for plate in moved)
        if miss < best_miss:
            best, best_miss, order = moved, miss, chosen
    if best_miss > 0.5 * worst or best_miss > FAR:
        return plates, []
    names = tuple(plates[i].name for i, j in enumerate(order) if i != j)
    text = (
        f"{source.name}: {' and '.join(names)} are swapped: their forces act {100 * worst:.0f} cm from any "
        f"foot, and {100 * best_miss:.0f} cm with each other's place; put back"
    )
    return best, [Finding("swapped_plates", text, {"miss_m": worst, "mended_m": best_miss}, names)]


def _move_plate(plate: PlateRecording, other: PlateRecording) -> PlateRecording:
    """A plate's reading at another plate's pose."""
    if plate.corners is None or other.corners is None:
        return plate
    here, there = _plate_pose(plate.corners), _plate_pose(other.corners)
    turn = there[0] @ here[0].T
    local = plate.moment - np.cross(here[1], plate.force)
    force, moment = plate.force @ turn.T, local @ turn.T
    return replace(plate, force=force, moment=moment + np.cross(there[1], force), corners=other.corners)


def _plate_pose(corners: Array) -> tuple[Array, Array]:
    """Rotation and centre of a plate; x and y along its edges, as C3D counts its corners."""
    x = corners[0] + corners[3] - corners[1] - corners[2]
    y = corners[0] + corners[1] - corners[2] - corners[3]
    z = np.cross(x, y)
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z]), corners.mean(axis=0)
