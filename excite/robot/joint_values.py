"""What a ``robot.yaml`` says joint by joint, in the order of the model's joints."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.description import FREE_BASES, RobotDescription
from excite.robot.quantities import MAX_TRAVEL, PerJoint, in_radians, looks_like_degrees
from excite.robot.refusal import robot_error, unknown_name

# Blocks of a description that say a number for every joint.
_PER_JOINT = {
    "controller": ("kp", "kd"),
    "sensors": ("noise_torque",),
    "limits": ("velocity", "acceleration", "jerk", "torque"),
    "drives": ("viscous", "coulomb", "armature"),
}


@dataclass(frozen=True)
class LimitTable:
    """A limit that depends on a position, linear between the table's positions.

    Attributes:
        joint: column of the joint that is limited.
        over: column of the joint whose position counts.
        quantity: ``position_lower``, ``position_upper``, ``velocity``, ``acceleration`` or ``torque``.
        at: positions, increasing [rad or m].
        limit: values there.
    """

    joint: int
    over: int
    quantity: str
    at: tuple[float, ...]
    limit: tuple[float, ...]

    def tightest_between(self, low: Array, high: Array) -> Array:
        """The tightest limit while the joint is anywhere between two positions, ``(n,)`` each."""
        # A function that is linear between nodes is extreme at an end of an interval, or at a node inside it.
        found = np.stack([np.interp(low, self.at, self.limit), np.interp(high, self.at, self.limit)])
        sign = -1.0 if self.quantity == "position_lower" else 1.0
        worst = (sign * found).min(axis=0)
        for at, limit in zip(self.at, self.limit, strict=True):
            worst = np.where((low <= at) & (at <= high), np.minimum(worst, sign * limit), worst)
        return np.asarray(sign * worst)


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the actuated joints, each of shape ``(n_joints,)``.

    Attributes:
        position_lower: [rad or m]
        position_upper: [rad or m]
        velocity: [rad/s or m/s]
        acceleration: [rad/s² or m/s²]
        jerk: [rad/s³ or m/s³]
        torque: [N·m or N]
        tables: limits that depend on positions, and hold beside these.
    """

    position_lower: Array
    position_upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    torque: Array
    tables: tuple[LimitTable, ...] = ()

    def while_between(self, quantity: str, low: Array, high: Array | None = None) -> Array:
        """The limits of a quantity while the joints are anywhere between two postures.

        Args:
            quantity: name of one of the arrays.
            low: ``(n, n_joints)`` lowest positions [rad or m].
            high: ``(n, n_joints)`` highest positions; None where the postures are points.

        Returns:
            ``(n, n_joints)``, or ``(n_joints,)`` where no table limits it.
        """
        stated: Array = getattr(self, quantity)
        tables = [table for table in self.tables if table.quantity == quantity]
        if not tables:
            return stated
        found = np.tile(stated, (len(low), 1))
        tighter = np.maximum if quantity == "position_lower" else np.minimum
        for table in tables:
            ends = low[:, table.over], (low if high is None else high)[:, table.over]
            found[:, table.joint] = tighter(found[:, table.joint], table.tightest_between(*ends))
        return found


def check_joints(
    description: RobotDescription, names: tuple[str, ...], path: Path, passive: frozenset[str] = frozenset()
) -> None:
    """Raise RobotError unless every joint that the description names exists, and those with a motor have gains.

    Joints in ``passive`` have none.
    """
    named: dict[str, Iterable[str]] = {
        "posture.joints": description.posture.joints,
        "limits.position.joints": description.limits.position.joints,
    }
    for part, fields in _PER_JOINT.items():
        for name in fields:
            block: PerJoint[float] | None = getattr(getattr(description, part), name)
            if block is None:
                continue
            field = f"{part}.{name}"
            named[f"{field}.joints"] = block.joints
            missing = [one for one in names if one not in block.joints and one not in passive]
            # Limits and frictions that are not stated are the model's, or none.
            if part in {"controller", "sensors"} and block.default is None and missing:
                what = f"says nothing about joint {missing[0]!r}"
                remedy = f"give a default or {field}.joints.{missing[0]}"
                raise robot_error(path, f"{field}.default", what, remedy)
    for i, table in enumerate(description.limits.by_position):
        named[f"limits.by_position[{i}]"] = (table.joint, table.over or table.joint)
    for field, joints in named.items():
        for joint in joints:
            if joint not in names:
                raise unknown_name(path, field, "joint", joint, names)


def per_joint(block: PerJoint[Any] | None, names: tuple[str, ...], fallback: Array) -> Array:
    """Values of a per-joint block in the order of ``names``; joints it does not cover get ``fallback``."""
    if block is None:
        return fallback.copy()
    default = fallback if block.default is None else np.full(len(names), block.default)
    return np.array([block.joints.get(name, default[i]) for i, name in enumerate(names)])


def check_range(joint: str, values: tuple[float, ...], slides: bool, field: str, path: Path) -> None:
    """Raise RobotError where a joint's positions can only be in degrees or millimetres."""
    for value in values:
        if slides and abs(value) > MAX_TRAVEL:
            what = f"is {value:g} m for the slide {joint!r}"
            raise robot_error(path, field, what, "looks like millimetres: write metres")
        if not slides and looks_like_degrees(value):
            raise robot_error(path, field, f"is {value:g} rad for the hinge {joint!r}", in_radians(value))


def read_limits(
    model: pin.Model, description: RobotDescription, names: tuple[str, ...], path: Path
) -> Limits:
    """Joint limits of the model, with what the description says instead; raises RobotError."""
    nq, nv = (7, 6) if description.base in FREE_BASES else (0, 0)
    block, nothing = description.limits, np.full(len(names), np.nan)
    lower, upper = model.lowerPositionLimit[nq:].copy(), model.upperPositionLimit[nq:].copy()
    for joint, (low, high) in block.position.joints.items():
        slides = "Prismatic" in model.joints[model.getJointId(joint)].shortname()
        check_range(joint, (low, high), slides, f"limits.position.joints.{joint}", path)
        lower[names.index(joint)], upper[names.index(joint)] = low, high
    found = {
        "position_lower": lower + block.position.margin,
        "position_upper": upper - block.position.margin,
        "velocity": per_joint(block.velocity, names, model.velocityLimit[nv:]),
        "acceleration": per_joint(block.acceleration, names, nothing),
        "jerk": per_joint(block.jerk, names, nothing),
        "torque": per_joint(block.torque, names, model.effortLimit[nv:]),
    }
    for field, values in found.items():
        bad = ~np.isfinite(values) | ((values <= 0.0) & (not field.startswith("position")))
        for index in np.flatnonzero(bad)[:1]:
            what = f"{field} of joint {names[index]!r} is {values[index]}"
            remedy = "state a positive, finite limit for it"
            raise robot_error(path, f"limits.{field.split('_')[0]}", what, remedy)
    for index in np.flatnonzero(found["position_upper"] <= found["position_lower"])[:1]:
        joint, low, high = names[index], lower[index], upper[index]
        remedy = "make limits.position.margin smaller than half of it"
        if high < low:
            remedy = f"exchange them: {joint}: [{high:g}, {low:g}]"
        elif high == low:
            remedy = f"hold it still: locked_joints: {{{joint}: {low:g}}}"
        what = f"empty position range of joint {joint!r}: {low:g} … {high:g}, less a margin"
        raise robot_error(path, "limits.position", what, remedy)
    tables = []
    for table in block.by_position:
        ends = {"position_lower": table.lower, "position_upper": table.upper}
        quantities = ends if table.quantity == "position" else {table.quantity: table.limit}
        column, over = names.index(table.joint), names.index(table.over or table.joint)
        tables += [LimitTable(column, over, name, table.at, row) for name, row in quantities.items()]
    return Limits(**found, tables=tuple(tables))
