"""Positions and velocities of a free base before its joints': seven numbers of a pose, or six of a twist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.families import Family
from excite.conversion.columns.joints import Placed
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.recording import Recording

_POSE, _TWIST = 7, 6
_UNIT = 1e-2
# A robot that stands or walks is turned about one axis, up: the cosine of half that angle is the larger by far.
_LIKELY = 2.0
POSE_AXES = {"wxyz": ("qw", "qx", "qy", "qz"), "xyzw": ("qx", "qy", "qz", "qw")}


def without_base(
    found: Guesses, groups: Sequence[Family], recording: Recording, joints: Sequence[str]
) -> list[Family]:
    """Families with the base's part taken out of those that begin with it; the pose is added to what was found.

    A family does where it is numbered, has seven columns more than there are joints, and the last four of these are a
    quaternion in every row. ``wxyz`` (MuJoCo) and ``xyzw`` (pinocchio) are told apart by which end is larger.
    """
    posed = next((f for f in groups if f.target == "q" and len(f.columns) == _POSE + len(joints)), None)
    if posed is None:
        return list(groups)
    values = {c.name: c.values for stream in recording.streams for c in stream.columns}
    quaternion = np.column_stack([values[name] for name in posed.columns[3:_POSE]])
    if not unit_quaternions(quaternion):
        return list(groups)
    order = quaternion_order(quaternion)
    if order is None:
        found.ask(
            f"{posed.columns[0]} … begins with a pose, and which end of its quaternion is w cannot be told",
            f'columns: {{base.qw: "{posed.columns[3]}", base.qx: "{posed.columns[4]}", …}}',
        )
        return list(groups)
    axes = ("px", "py", "pz", *POSE_AXES[order])
    because = f"seven columns more than joints, four of them a quaternion, {order}"
    if not found.of("base"):
        found.mapped += [
            Mapped(f"base.{axis}", name, 1.0, because)
            for axis, name in zip(axes, posed.columns[:_POSE], strict=True)
        ]
    return [_without_base_columns(family, joints) for family in groups]


def unit_quaternions(values: Array) -> bool:
    """Whether four columns hold a quaternion in every row that has numbers; ``(n, 4)``."""
    norms = np.linalg.norm(values, axis=1)
    return bool(np.isfinite(norms).any() and np.allclose(norms[np.isfinite(norms)], 1.0, atol=_UNIT))


def quaternion_order(quaternion: Array) -> str | None:
    """``wxyz`` or ``xyzw`` by which end is larger, as of a robot that is turned about one axis; None for neither."""
    first, last = (float(np.nanmedian(np.abs(quaternion[:, k]))) for k in (0, 3))
    if first > _LIKELY * last:
        return "wxyz"
    return "xyzw" if last > _LIKELY * first else None


def _without_base_columns(family: Family, joints: Sequence[str]) -> Family:
    """A family without its base's columns where it has as many more as a base has."""
    more = len(family.columns) - len(joints)
    base = _POSE if family.quantity == "q" else _TWIST
    if more != base or family.quantity not in ("q", "v", "a", "tau"):
        return family
    columns = family.columns[base:]
    placed = Placed(dict(zip(joints, columns, strict=True)), "the columns' order, after the base's")
    return replace(family, columns=columns, placed=placed)
