"""Joint torque equations of a robot whose contact forces nobody measures, with those forces taken out.

With generalised forces ``[0; τ] = Y φ − Aᵣ f`` of base and joints, ``Aᵣ`` the transposed Jacobian of what the closed
contacts can transmit, the base's rows give the forces but for those that the contacts exert against each other,
``f = A_b⁺ Y_b φ + Z λ``, and what is left of the joints' rows has λ projected out (Mistry, Buchli and Schaal 2010;
for identification Khorshidi et al. 2024). Both steps are linear, so a matrix a sample does them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.arrays import Array, Flags, distinct_rows
from excite.regressor.kernels import Placements, forward_kinematics, inverse_dynamics, joint_torque_regressor
from excite.regressor.tree import FREE_FLYER, PRISMATIC, KinematicTree, read_tree
from excite.robot.joint_values import per_joint
from excite.robot.mechanisms.closures import SINGULAR
from excite.robot.robot import Foot, Robot

# Length that makes moments comparable with forces: the distance between feet [m].
_LENGTH = 0.3
# Singular values below the share SINGULAR of the largest count as zero: two point feet transmit no moment about the
# line between them, to rounding; anything that contacts do transmit is far above.


def contact_elimination(robot: Robot, q: Array, closed: Flags) -> Array:
    """Matrices that take generalised forces to joint torques without contact forces.

    Applied to ``Y φ`` and to ``[0; τ]`` alike they give equal sides, whatever the contact forces are. A robot that
    hangs keeps its joints' rows alone, and so does one that is in the air.

    Args:
        robot: a robot with a free base.
        q: ``(n, nq)`` configurations.
        closed: ``(n, n_feet)`` which feet carry.

    Returns:
        ``(n, n_joints, 6 + n_joints)``; the rows of a sample have rank ``n_joints`` less the number of forces that
        contacts can exert against each other.
    """
    n, nb = len(q), robot.n_base_v
    rows = np.zeros((n, robot.n_joints, robot.model.nv))
    rows[:, :, nb:] = np.eye(robot.n_joints)
    if not robot.feet:
        return rows
    ones = np.ones(robot.n_joints)
    weight = 1.0 / per_joint(robot.description.sensors.noise_torque, robot.joint_names, ones)
    patterns, member = distinct_rows(closed)
    for k, pattern in enumerate(patterns):
        feet = [foot for foot, on in zip(robot.feet, pattern, strict=True) if on]
        if feet:
            at = np.flatnonzero(member == k)
            rows[at] = _eliminate_contacts(contact_maps(robot, q[at], feet), weight)
    return rows


def stance_flags(robot: Robot, n: int) -> Flags:
    """Contact flags of ``n`` samples, ``(n, n_feet)``: in turn all feet down, and each of several in the air."""
    n_feet = len(robot.feet)
    patterns = np.vstack([np.ones((1, n_feet)), 1.0 - np.eye(n_feet) if n_feet > 1 else np.ones((1, n_feet))])
    return np.asarray(patterns[np.arange(n) % len(patterns)] > 0.5)


def contact_maps(robot: Robot, q: Array, feet: list[Foot]) -> Array:
    """:func:`tree_contact_maps` of a robot's model, as its motors exert the forces; ``q (n, nq)`` configurations."""
    tree = read_tree(robot.model)
    return robot.on_motors(q, tree_contact_maps(tree, forward_kinematics(tree, q), feet))


def tree_contact_maps(tree: KinematicTree, poses: Placements, feet: Sequence[Foot]) -> Array:
    """Generalised forces per unit of what feet can transmit, ``(n, nv, k)``.

    A point foot transmits three forces, a ball where it is lowest, an edge six on two points (of rank five), a sole
    a force and a moment.

    Args:
        tree: of a robot with a free base.
        poses: of its joints, n of each.
        feet: those that carry.
    """
    n = len(poses.translation)
    maps = [np.zeros((n, tree.nv, 0))]
    for foot in feet:
        turned = poses.rotation[:, foot.joint]
        wrenches = _wrench_basis(foot, turned[:, 2])
        force, moment = turned @ wrenches[..., :3, :], turned @ wrenches[..., 3:, :]
        made, joint = np.zeros((n, tree.nv, force.shape[2])), foot.joint
        while joint > 0:
            arm = poses.translation[:, foot.joint] - poses.translation[:, joint]
            about = moment + np.cross(arm[:, :, None], force, axis=1)
            at, axes = tree.idx_v[joint], poses.rotation[:, joint].transpose(0, 2, 1)
            if tree.kinds[joint] == FREE_FLYER:
                made[:, at : at + 6] = np.concatenate([axes @ force, axes @ about], axis=1)
            else:
                acts = force if tree.kinds[joint] == PRISMATIC else about
                made[:, at] = ((tree.axes[joint] @ axes)[:, None] @ acts)[:, 0]
            joint = int(tree.parents[joint])
        maps.append(made)
    return np.concatenate(maps, axis=2)


def carried_wrench(maps: Array, stretched: float) -> Array:
    """What joint torques say of the wrench on the base: ``X`` with ``A_b + X A_j = 0``, ``(n, 6, n_joints)``.

    Each leg's torques tell its foot's force, and ``[1, X]`` takes generalised forces to what is left at the base. It
    spans the same rows as :func:`contact_elimination` where legs have a torque for each force, has full rank and
    follows the posture smoothly; the order of the rows is the wrench's.

    Args:
        maps: ``(n, 6 + n_joints, k)`` of :func:`contact_maps`.
        stretched: singular values below this share of the largest count as zero: a leg that is stretched tells no
            force along it.
    """
    base, joints = (maps[:, rows].transpose(0, 2, 1) for rows in (slice(6), slice(6, None)))
    return np.asarray(-(np.linalg.pinv(joints, rcond=stretched) @ base).transpose(0, 2, 1))


def _wrench_basis(foot: Foot, up: Array) -> Array:
    """Wrenches at the joint's origin, in its frame, that a foot can transmit, ``(6, k)`` or, of a ball, ``(n, 6, 3)``.

    ``up`` is the vertical in that frame at each sample, ``(n, 3)``.
    """
    if foot.flat:
        return np.eye(6)
    places = foot.sole if foot.radius <= 0.0 else [foot.centre - foot.radius * up]
    skew = [np.cross(place[..., None, :], np.eye(3)) for place in places]
    return np.concatenate(
        [np.concatenate([np.broadcast_to(np.eye(3), s.shape), s.swapaxes(-1, -2)], axis=-2) for s in skew],
        axis=-1,
    )


def _eliminate_contacts(maps: Array, weight: Array) -> Array:
    """The matrices of samples with the same contacts, from ``(n, nv, k)``; ``weight``: one over torques' noise."""
    n, nv, k = maps.shape
    base, joints = maps[:, :6].copy(), maps[:, 6:]
    base[:, 3:] /= _LENGTH
    u, s, vt = np.linalg.svd(base)
    rank_s = np.zeros((n, k))
    rank_s[:, : s.shape[1]] = np.where(s > SINGULAR * s[:, :1], s, 0.0)
    known = rank_s > 0.0
    inverse = np.where(known, 1.0 / np.where(known, rank_s, 1.0), 0.0)
    width = s.shape[1]
    pinv = (vt.transpose(0, 2, 1)[:, :, :width] * inverse[:, None, :width]) @ u[:, :, :width].transpose(
        0, 2, 1
    )
    pinv[:, :, 3:] /= _LENGTH
    inner = weight[:, None] * (joints @ (vt.transpose(0, 2, 1) * ~known[:, None, :]))
    left, size, _ = np.linalg.svd(inner, full_matrices=False)
    left = left * (size > SINGULAR * weight.max())[:, None, :]
    free = np.eye(nv - 6) - left @ left.transpose(0, 2, 1)
    free = free * weight / weight[:, None]
    return np.asarray(np.concatenate([-free @ joints @ pinv, free], axis=2))


# Torques of a robot's motors and their regressor: the tree's own where each joint has one, else through its
# mechanism.
#
# Between them and :mod:`excite.regressor.kernels` stands ``τ_m = Gᵀ τ`` of closed loops and coupled joints
# (:mod:`excite.robot.mechanisms.mechanism`).


def motor_torques(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Forces of base and motors that a motion takes, contacts and drives' own friction aside.

    Args:
        robot: the robot.
        q: ``(n, nq)`` configurations, closed.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.

    Returns:
        ``(n, nv)`` [N·m or N], the base's wrench first; zero for joints without a motor.

    Raises:
        InputError: wrong shape; MotionError: a mechanism is at a singular position.
    """
    return robot.on_motors(q, inverse_dynamics(robot.model, q, v, a))


def motor_regressor(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Regressor of :func:`motor_torques`, ``(n, nv, 10·n_segments)``; arguments and errors as there."""
    return robot.on_motors(q, joint_torque_regressor(robot.model, q, v, a))
