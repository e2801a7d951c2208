"""How the feet share the load along a path, and what that takes off the joints' torques."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array, distinct_rows
from excite.motion.generators.candidate import Candidate
from excite.robot.robot import Robot
from excite.safety.repairs.path import MotionPath


def take_off_contacts(
    candidate: Candidate, path: MotionPath, soles: Mapping[str, Array], tau: Array, wrench: Array
) -> None:
    """Take the contact forces' torques off generalised forces at the knots of a path, in place.

    Both are linear in the wrench, as the rows of a path's limits have to be: two soles share it by their nearness to
    where it acts, any other feet so that the forces on their corners are smallest. That none of them pulls is for the
    verdict to say.

    Args:
        candidate: says which feet carry, where.
        path: the path.
        soles: corners of each foot at rest, where a carrying foot always is, ``(n_corners, 3)`` [m].
        tau: ``(n, 3, nv)`` generalised forces without contacts for 1, ṡ², s̈.
        wrench: ``(n, 3, 6)`` the wrench that the ground must supply, about the world origin.
    """
    feet = path.robot.feet
    carried = np.column_stack([candidate.supports(path.knots.s, foot.name) for foot in feet])
    if len(feet) == 2 and all(foot.flat for foot in feet):
        _by_nearness(path, soles, carried, tau, wrench)
    else:
        _by_corners(path, soles, carried, tau, wrench)


def _by_nearness(
    path: MotionPath, soles: Mapping[str, Array], carried: NDArray[np.bool_], tau: Array, wrench: Array
) -> None:
    robot, knots = path.robot, path.knots
    data = robot.model.createData()
    centres = {name: corners.mean(axis=0) for name, corners in soles.items()}
    point = np.column_stack([-wrench[:, 0, 4], wrench[:, 0, 3]]) / wrench[:, 0, 2:3]
    share = load_shares(point, np.array([centres[foot.name] for foot in robot.feet]), carried)
    middle = share @ np.array([centres[foot.name] for foot in robot.feet])
    about_middle = wrench[..., 3:] - np.cross(middle[:, None], wrench[..., :3])
    bears = share > 0.0
    rotation = np.empty((len(knots.q), len(robot.feet), 3, 3))
    position = np.zeros((len(knots.q), len(robot.feet), 3))
    jacobians = {}
    placed = [(data.oMi[foot.joint].rotation, data.oMi[foot.joint].translation) for foot in robot.feet]
    for i, q in enumerate(knots.q):
        pin.forwardKinematics(robot.model, data, q)
        for k in np.flatnonzero(bears[i]).tolist():
            rotation[i, k], position[i, k] = placed[k]
            jacobians[i, k] = pin.computeJointJacobian(robot.model, data, q, robot.feet[k].joint)
    for k, foot in enumerate(robot.feet):
        force = share[:, k, None, None] * wrench[..., :3]
        moment = share[:, k, None, None] * about_middle
        rows = np.flatnonzero(bears[:, k])
        lever = centres[foot.name] - position[rows, k]
        shifted = moment[rows] + np.cross(lever[:, None], force[rows])
        local = np.concatenate([force[rows] @ rotation[rows, k], shifted @ rotation[rows, k]], axis=2)
        for row, i in enumerate(rows.tolist()):
            tau[i] -= local[row] @ jacobians[i, k]


def shares_of_feet(
    candidate: Candidate, path: MotionPath, soles: Mapping[str, Array], wrench: Array
) -> Array:
    """Wrench of each foot about the world origin per total wrench at the knots, ``(n, n_feet, 6, 6)``.

    The shares are those of :func:`take_off_contacts`, whose arguments these are; zero for free feet.
    """
    feet, knots = path.robot.feet, path.knots
    carried = np.column_stack([candidate.supports(knots.s, foot.name) for foot in feet])
    found = np.zeros((len(knots.s), len(feet), 6, 6))
    if not (len(feet) == 2 and all(foot.flat for foot in feet)):
        patterns, member = distinct_rows(carried)
        return np.array([corner_shares(path.robot, soles, pattern) for pattern in patterns])[member]
    centres = np.array([soles[foot.name].mean(axis=0) for foot in feet])
    point = np.column_stack([-wrench[:, 0, 4], wrench[:, 0, 3]]) / wrench[:, 0, 2:3]
    share = load_shares(point, centres, carried)
    middle = share @ centres
    for k in range(len(feet)):
        found[:, k] = np.eye(6)
        found[:, k, 3:, :3] = [pin.skew(lever) for lever in centres[k] - middle]
    return np.asarray(found * share[:, :, None, None])


def load_shares(point: Array, centres: Array, carried: NDArray[np.bool_]) -> Array:
    """Share of the load on each of two feet, ``(n, 2)``, from where it acts between their centres."""
    line = centres[1, :2] - centres[0, :2]
    second = np.clip((point - centres[0, :2]) @ line / (line @ line), 0.0, 1.0)
    share = np.column_stack([1.0 - second, second])
    share = np.where(carried, np.maximum(share, 1e-9), 0.0)
    return np.asarray(share / share.sum(axis=1, keepdims=True))


def _by_corners(
    path: MotionPath, soles: Mapping[str, Array], carried: NDArray[np.bool_], tau: Array, wrench: Array
) -> None:
    robot, knots = path.robot, path.knots
    data = robot.model.createData()
    patterns, member = distinct_rows(carried)
    shares = [corner_shares(robot, soles, pattern) for pattern in patterns]
    for i, pattern in enumerate(member):
        wrenches = np.einsum("jkl,al->jak", shares[pattern], wrench[i])
        pin.forwardKinematics(robot.model, data, knots.q[i])
        for k in np.flatnonzero(carried[i]):
            joint = robot.feet[k].joint
            jacobian = pin.computeJointJacobian(robot.model, data, knots.q[i], joint)
            # The transpose of a pose's action takes a wrench from the world's origin to the joint's frame.
            tau[i] -= wrenches[k] @ data.oMi[joint].toActionMatrix() @ jacobian


def corner_shares(robot: Robot, soles: Mapping[str, Array], carried: NDArray[np.bool_]) -> Array:
    """Wrench of each foot about the world origin per total wrench, ``(n_feet, 6, 6)``; zero for free feet.

    Args:
        robot: the robot.
        soles: corners of each foot, ``(n_corners, 3)`` [m].
        carried: whether each foot carries, ``(n_feet,)``.
    """
    shares = np.zeros((len(carried), 6, 6))
    owners = [k for k in np.flatnonzero(carried) for _ in soles[robot.feet[k].name]]
    if not owners:
        return shares
    corners = np.vstack([soles[robot.feet[k].name] for k in np.flatnonzero(carried)])
    maps = [np.vstack([np.eye(3), pin.skew(corner)]) for corner in corners]
    forces = np.linalg.pinv(np.hstack(maps)).reshape(len(maps), 3, 6)
    for k, to_wrench, force in zip(owners, maps, forces, strict=True):
        shares[k] += to_wrench @ force
    return shares
