"""Which parameters a robot's sensors can speak of: the columns of its regressor, by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array, Flags, Indices
from excite.errors import InputError, UnknownNameError
from excite.regressor.contact_forces import contact_elimination, motor_regressor
from excite.regressor.kernels import base_link_regressor, forward_kinematics
from excite.robot.robot import Robot

PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
DRIVE_TERMS = ("viscous", "coulomb", "offset", "armature")


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a robot's regressor, inertial ones first, then those of the drives.

    Attributes:
        names: such as ``Ixx(torso)`` or ``viscous(joint1)``.
        segment: ``(n,)`` index in ``Robot.segments``, -1 for a drive's column.
        parameter: ``(n,)`` index in ``phi``, -1 for a drive's column.
        joint: ``(n,)`` index in ``Robot.joint_names`` of a drive's column, else -1.
        drives: terms of each drive, out of ``DRIVE_TERMS``; drive columns are ordered by term, then joint.
    """

    names: tuple[str, ...]
    segment: Indices
    parameter: Indices
    joint: Indices
    drives: tuple[str, ...]

    @property
    def inertial(self) -> Indices:
        """Indices in ``phi`` of the inertial columns, in their order."""
        return self.parameter[self.parameter >= 0]

    def only(self, kept: Indices) -> Columns:
        """Some of the columns, by index."""
        names = tuple(self.names[column] for column in kept)
        return replace(
            self,
            names=names,
            segment=self.segment[kept],
            parameter=self.parameter[kept],
            joint=self.joint[kept],
        )

    def of_segment(self, segment: int) -> Indices:
        """Columns of a segment, empty where no sensor sees it."""
        return np.flatnonzero(self.segment == segment)


def measured_columns(robot: Robot, drives: Sequence[str] = ("viscous", "coulomb")) -> Columns:
    """The columns that a robot's own sensors see.

    A robot on wrench sensors is observed through its contact wrenches: internal friction does not show, and segments
    beyond its ankle sensors are left out. An arm is observed through its joint torques, and so is any other robot.

    Args:
        robot: the robot.
        drives: terms of each joint's drive; ignored for a robot on wrench sensors.

    Raises:
        UnknownNameError: a term that is not in ``DRIVE_TERMS``.
    """
    for term in drives:
        if term not in DRIVE_TERMS:
            raise UnknownNameError("drive term", term, list(DRIVE_TERMS))
    drives = () if robot.measures_contacts else tuple(drives)
    hidden = {segment for sensor in robot.sensors for segment in sensor.excludes}
    seen = [segment for segment in range(len(robot.segments)) if segment not in hidden]
    names = [f"{parameter}({robot.segments[segment].name})" for segment in seen for parameter in PARAMETERS]
    names += [f"{term}({joint})" for term in drives for joint in robot.joint_names]
    n_drive, none = len(drives) * robot.n_joints, -1
    segment = np.repeat(np.array(seen, dtype=np.int64), len(PARAMETERS))
    parameter = np.concatenate([np.arange(10 * s, 10 * s + 10, dtype=np.int64) for s in seen])
    return Columns(
        names=tuple(names),
        segment=np.concatenate([segment, np.full(n_drive, none)]),
        parameter=np.concatenate([parameter, np.full(n_drive, none)]),
        joint=np.concatenate(
            [np.full(len(parameter), none), np.tile(np.arange(robot.n_joints), len(drives))]
        ),
        drives=drives,
    )


def regressor_rows(
    robot: Robot, columns: Columns, q: Array, v: Array, a: Array, closed: Flags | None = None
) -> Array:
    """Regressor of what a robot measures: the base's wrench, or the joint torques less what contacts add to them.

    Args:
        robot: the robot.
        columns: from :func:`measured_columns`, all of them or some.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.
        closed: ``(n, n_feet)`` which feet carry, where no sensor measures how; all of them if None.

    Returns:
        ``(n, r, n_columns)`` [SI, per unit of each parameter]: r = 6 rows (force, moment about the base's
        origin, base frame; Jovic et al. 2015, eq. 2) for a robot on wrench sensors, else one row a joint, to which
        the drives add viscous·v + coulomb·sign(v) + offset + armature·a. Contact forces that nobody measures are
        taken out by :func:`~excite.regressor.contact_forces.contact_elimination`.

    Raises:
        InputError: wrong shape.
    """
    if robot.measures_contacts:
        return base_link_regressor(robot.model, q, v, a)[:, :, columns.inertial]
    n_inertial, n_joints, n_base = len(columns.inertial), robot.n_joints, robot.n_base_v
    rows = np.zeros((len(q), n_base + n_joints, len(columns.names)))
    rows[:, :, :n_inertial] = motor_regressor(robot, q, v, a)[:, :, columns.inertial]
    v, a = v[:, n_base:], a[:, n_base:]
    motors = np.where(robot.passive, 0.0, np.ones_like(v))
    values = {"viscous": v, "coulomb": np.sign(v), "offset": motors, "armature": a}
    values = {term: motors * value for term, value in values.items()}
    for place in range(n_inertial, len(columns.names)):
        term, joint = columns.names[place].partition("(")[0], columns.joint[place]
        rows[:, n_base + joint, place] = values[term][:, joint]
    if not robot.floating:
        return rows
    closed = np.ones((len(q), len(robot.feet)), dtype=bool) if closed is None else closed
    return np.asarray(contact_elimination(robot, q, closed) @ rows)


# The measured side of a floating robot's base equation: sensor readings brought to the base.


def base_wrench(robot: Robot, q: Array, wrenches: Mapping[str, Array]) -> Array:
    """Sum of the measured contact wrenches at the base: Σ J1ᵀ f (Jovic et al. 2015, eq. 2, right-hand side).

    Args:
        robot: a floating robot with wrench sensors.
        q: ``(n, nq)`` configurations.
        wrenches: by sensor, ``(n, 6)``: force [N] and moment [N·m] that the ground exerts on the robot,
            in the sensor's frame, moment about its origin. An ankle sensor moves with its link, a force plate
            is fixed in the world. Sensors that are left out count as unloaded.

    Returns:
        ``(n, 6)`` force and moment about the base's origin, in the base frame.

    Raises:
        InputError: wrong shape, or a fixed-base robot.
        UnknownNameError: a sensor that the robot does not have.
    """
    if not robot.floating:
        raise InputError(f"robot {robot.name!r} has a fixed base", remedy="use its joint torques")
    sensors = {sensor.name: sensor for sensor in robot.sensors}
    poses = forward_kinematics(robot.model, q)
    base_rotation, base_origin = poses.rotation[:, 1], poses.translation[:, 1]
    total = np.zeros((len(q), 6))
    for name, wrench in wrenches.items():
        if name not in sensors:
            raise UnknownNameError("sensor", name, sorted(sensors))
        wrench = np.asarray(wrench, dtype=float)
        if wrench.shape != total.shape:
            raise InputError(f"wrench {name!r} has shape {wrench.shape}", remedy=f"expected {total.shape}")
        sensor = sensors[name]
        rotation = poses.rotation[:, sensor.joint] @ sensor.placement.rotation
        lever = poses.point(sensor.joint, sensor.placement.translation) - base_origin
        force = np.einsum("nij,nj->ni", rotation, wrench[:, :3])
        moment = np.einsum("nij,nj->ni", rotation, wrench[:, 3:]) + np.cross(lever, force)
        total[:, :3] += np.einsum("nji,nj->ni", base_rotation, force)
        total[:, 3:] += np.einsum("nji,nj->ni", base_rotation, moment)
    return total
