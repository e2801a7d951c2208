"""Which parameters a robot's sensors can speak of: the columns of its regressor, by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import UnknownNameError
from excite.regressor.kernels import base_link_regressor, joint_torque_regressor
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
    segment: NDArray[np.int64]
    parameter: NDArray[np.int64]
    joint: NDArray[np.int64]
    drives: tuple[str, ...]

    @property
    def inertial(self) -> NDArray[np.int64]:
        """Indices in ``phi`` of the inertial columns, in their order."""
        return self.parameter[self.parameter >= 0]

    def of_segment(self, segment: int) -> NDArray[np.int64]:
        """Columns of a segment, empty where no sensor sees it."""
        return np.flatnonzero(self.segment == segment)


def measured_columns(robot: Robot, drives: Sequence[str] = ("viscous", "coulomb")) -> Columns:
    """The columns that a robot's own sensors see.

    A floating robot is observed through its contact wrenches: internal friction does not show, and segments
    beyond its ankle sensors are left out. An arm is observed through its joint torques.

    Args:
        robot: the robot.
        drives: terms of each joint's drive; ignored for a floating robot.

    Raises:
        UnknownNameError: a term that is not in ``DRIVE_TERMS``.
    """
    for term in drives:
        if term not in DRIVE_TERMS:
            raise UnknownNameError("drive term", term, list(DRIVE_TERMS))
    drives = () if robot.floating else tuple(drives)
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


def regressor_rows(robot: Robot, columns: Columns, q: Array, v: Array, a: Array) -> Array:
    """Regressor of what a robot measures: the base's wrench, or the joint torques.

    Args:
        robot: the robot.
        columns: from :func:`measured_columns`.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.

    Returns:
        ``(n, r, n_columns)`` [SI, per unit of each parameter]: r = 6 rows (force, moment about the base's
        origin, base frame; Jovic et al. 2015, eq. 2) for a floating robot, else one row a joint, to which
        the drives add viscous·v + coulomb·sign(v) + offset + armature·a.

    Raises:
        InputError: wrong shape.
    """
    if robot.floating:
        return base_link_regressor(robot.model, q, v, a)[:, :, columns.inertial]
    n_inertial, n_joints = len(columns.inertial), robot.n_joints
    rows = np.zeros((len(q), n_joints, len(columns.names)))
    rows[:, :, :n_inertial] = joint_torque_regressor(robot.model, q, v, a)[:, :, columns.inertial]
    values = {"viscous": v, "coulomb": np.sign(v), "offset": np.ones_like(v), "armature": a}
    joints = np.arange(n_joints)
    for index, term in enumerate(columns.drives):
        rows[:, joints, n_inertial + index * n_joints + joints] = values[term]
    return rows
