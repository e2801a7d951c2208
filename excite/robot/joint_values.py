"""What a ``robot.yaml`` says joint by joint, in the order of the model's joints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.description import FREE_BASES, LimitsBlock, RobotDescription
from excite.robot.quantities import MAX_TRAVEL, PerJoint, in_radians, looks_like_degrees
from excite.robot.refusal import robot_error, unknown_name


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

    def tightest(self, low: Array, high: Array) -> Array:
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
            found[:, table.joint] = tighter(found[:, table.joint], table.tightest(*ends))
        return found


def check_joints(
    description: RobotDescription, names: tuple[str, ...], path: Path, passive: frozenset[str] = frozenset()
) -> None:
    """Raise RobotError unless every joint that the description names exists, and those with a motor have gains.

    Joints in ``passive`` have none.
    """
    driven = tuple(name for name in names if name not in passive)
    limits, drives = description.limits, description.drives
    named: dict[str, dict[str, object]] = {
        "posture.joints": dict(description.posture.joints),
        "limits.position.joints": dict(limits.position.joints),
        "controller.kp.joints": dict(description.controller.kp.joints),
        "controller.kd.joints": dict(description.controller.kd.joints),
    }
    for field, block in {
        "limits.velocity": limits.velocity,
        "limits.acceleration": limits.acceleration,
        "limits.jerk": limits.jerk,
        "limits.torque": limits.torque,
        "sensors.noise_torque": description.sensors.noise_torque,
        "drives.viscous": drives.viscous,
        "drives.coulomb": drives.coulomb,
        "drives.armature": drives.armature,
    }.items():
        if block is not None:
            named[f"{field}.joints"] = dict(block.joints)
    for field, full in {"kp": description.controller.kp, "kd": description.controller.kd}.items():
        _check_covers(full, driven, f"controller.{field}", path)
    if description.sensors.noise_torque is not None:
        _check_covers(description.sensors.noise_torque, driven, "sensors.noise_torque", path)
    for i, table in enumerate(limits.by_position):
        named[f"limits.by_position[{i}]"] = dict.fromkeys({table.joint, table.over or table.joint})
    for field, joints in named.items():
        for joint in joints:
            if joint not in names:
                raise unknown_name(path, field, "joint", joint, names)


def _check_covers(block: PerJoint, names: tuple[str, ...], field: str, path: Path) -> None:
    """A block without default must name every joint."""
    missing = [name for name in names if block.default is None and name not in block.joints]
    if missing:
        remedy = f"give a default or {field}.joints.{missing[0]}"
        raise robot_error(path, f"{field}.default", f"says nothing about joint {missing[0]!r}", remedy)


def per_joint(block: PerJoint | None, names: tuple[str, ...], fallback: Array) -> Array:
    """Values of a per-joint block in the order of ``names``; joints it does not cover get ``fallback``."""
    if block is None:
        return fallback.copy()
    default = fallback if block.default is None else np.full(len(names), block.default)
    return np.array([block.joints.get(name, default[i]) for i, name in enumerate(names)])


def check_range(joint: str, values: tuple[float, ...], slides: bool, field: str, path: Path) -> None:
    """Raise RobotError where a joint's positions can only be in degrees or millimetres."""
    for value in values:
        if slides and abs(value) > MAX_TRAVEL:
            what, remedy = f"is {value:g} m for the slide {joint!r}", "looks like millimetres: write metres"
        elif not slides and looks_like_degrees(value):
            what, remedy = f"is {value:g} rad for the hinge {joint!r}", in_radians(value)
        else:
            continue
        raise robot_error(path, field, what, remedy)


def _joint_kind(model: pin.Model, joint: str) -> str:
    return str(model.joints[model.getJointId(joint)].shortname())


def read_limits(
    model: pin.Model, description: RobotDescription, names: tuple[str, ...], path: Path
) -> Limits:
    """Joint limits of the model, with what the description says instead; raises RobotError."""
    nq, nv = (7, 6) if description.base in FREE_BASES else (0, 0)
    block = description.limits
    lower, upper = model.lowerPositionLimit[nq:].copy(), model.upperPositionLimit[nq:].copy()
    for joint, (low, high) in block.position.joints.items():
        check_range(
            joint,
            (low, high),
            "Prismatic" in _joint_kind(model, joint),
            f"limits.position.joints.{joint}",
            path,
        )
        lower[names.index(joint)], upper[names.index(joint)] = low, high
    lower, upper = lower + block.position.margin, upper - block.position.margin
    nothing = np.full(len(names), np.nan)
    limits = Limits(
        position_lower=lower,
        position_upper=upper,
        velocity=per_joint(block.velocity, names, model.velocityLimit[nv:]),
        acceleration=per_joint(block.acceleration, names, nothing),
        jerk=per_joint(block.jerk, names, nothing),
        torque=per_joint(block.torque, names, model.effortLimit[nv:]),
        tables=tuple(_read_tables(block, names)),
    )
    for field in ("position_lower", "position_upper", "velocity", "acceleration", "jerk", "torque"):
        values = getattr(limits, field)
        bad = ~np.isfinite(values) | (values <= 0.0 if not field.startswith("position") else False)
        if bad.any():
            joint = names[int(np.argmax(bad))]
            raise robot_error(
                path,
                f"limits.{field.split('_')[0]}",
                f"{field} of joint {joint!r} is {values[names.index(joint)]}",
                "state a positive, finite limit for it",
            )
    if (upper <= lower).any():
        joint = names[int(np.argmax(upper <= lower))]
        index = names.index(joint)
        low, high = lower[index] - block.position.margin, upper[index] + block.position.margin
        remedy = (
            f"exchange them: {joint}: [{high:g}, {low:g}]"
            if high < low
            else f"hold it still: locked_joints: {{{joint}: {low:g}}}"
            if high == low
            else "make limits.position.margin smaller than half of it"
        )
        what = f"empty position range of joint {joint!r}: {low:g} … {high:g}, less a margin"
        raise robot_error(path, "limits.position", what, remedy)
    return limits


def _read_tables(block: LimitsBlock, names: tuple[str, ...]) -> Iterator[LimitTable]:
    for table in block.by_position:
        joint, over = names.index(table.joint), names.index(table.over or table.joint)
        if table.quantity == "position":
            yield LimitTable(joint, over, "position_lower", table.at, table.lower)
            yield LimitTable(joint, over, "position_upper", table.at, table.upper)
        else:
            yield LimitTable(joint, over, table.quantity, table.at, table.limit)
