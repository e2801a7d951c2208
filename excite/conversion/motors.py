"""Positions and torques of motors turned into those of joints, where a map says how they are geared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from excite.conversion.assemble import Table
from excite.conversion.mapping import Map
from excite.errors import LogError

# Smaller pivots are no gear: the largest robots' ratios have some thousand.
_SINGULAR = 1e-9
_MOVED = ("q", "v", "a", "q_cmd")
_PUSHED = ("tau", "tau_cmd")


def joint_sided(table: Table, mapping: Map, joints: Sequence[str], source: object) -> Table:
    """The table with joint positions ``R⁻¹ θ`` and joint torques ``Rᵀ τ`` of motors ``θ = R q``.

    Raises:
        LogError: the matrix of the map is not square, singular, or not of the joints' number.
    """
    if not mapping.motors:
        return table
    rows = {len(row) for row in mapping.motors} | {len(mapping.motors)}
    if rows != {len(joints)}:
        raise LogError(
            f"motors: is no matrix of {len(joints)} rows and columns",
            source=source,
            remedy="one row a motor, in map.yaml",
        )
    gears = np.array(mapping.motors, dtype=float)
    if abs(np.linalg.det(gears / np.abs(gears).max())) < _SINGULAR ** len(joints):
        raise LogError("motors: cannot be inverted", source=source, remedy="correct the ratios in map.yaml")
    columns = dict(table.columns)
    for channels, matrix in ((_MOVED, np.linalg.inv(gears)), (_PUSHED, gears.T)):
        for channel in channels:
            names = [f"{channel}.{joint}" for joint in joints]
            if all(name in columns for name in names):
                values = np.column_stack([columns[name] for name in names]) @ matrix.T
                columns |= {name: values[:, k] for k, name in enumerate(names)}
    return replace(table, columns=columns)
