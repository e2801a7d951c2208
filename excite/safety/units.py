"""Units of what limits a motion: those of a joint are what it moves in, radians or metres."""

from __future__ import annotations

_UNITS = {
    "self_collision": "m",
    "zmp": "m",
    "robust_zmp": "m",
    "com": "m",
    "foot_lifted": "m",
    "foot_below_ground": "m",
    "foot_slip": "m",
    "slipped_in_rehearsal": "m",
    "drive_at_limit_in_rehearsal": "N·m",
    "foot_slip_speed": "m/s",
    "joint_position": "rad",
    "joint_velocity": "rad/s",
    "joint_acceleration": "rad/s²",
    "joint_jerk": "rad/s³",
    "joint_torque": "N·m",
    "robust_joint_torque": "N·m",
    "starts_moving": "rad/s",
    "ends_moving": "rad/s",
    "velocity_not_derivative": "rad/s",
    "acceleration_not_derivative": "rad/s²",
    "time_step": "s",
    "time_gap": "s",
    "time_not_increasing": "s",
    "rate_too_low": "Hz",
}
_SLIDING = {"rad": "m", "rad/s": "m/s", "rad/s²": "m/s²", "rad/s³": "m/s³", "N·m": "N"}
# Columns of a free base's velocity that are lengths a second.
_BASE = frozenset(("base.x", "base.y", "base.z"))


def unit_of(kind: str, where: str, sliding: frozenset[str]) -> str:
    """Unit of the value and the limit of something violated; empty where none is known.

    Args:
        kind: what is violated, such as ``joint_velocity``.
        where: joint, foot, pair of links or coordinate of the base.
        sliding: joints that slide.
    """
    unit = _UNITS.get(kind, "")
    return _SLIDING.get(unit, unit) if where in sliding | _BASE else unit
