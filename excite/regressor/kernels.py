"""Kinematics, inverse dynamics and regressors of whole trajectories.

The rigid bodies alone: friction and rotor inertia (``model.armature``) are columns of their own elsewhere.
Every function takes a pinocchio model, or a :class:`~excite.regressor.tree.KinematicTree` read from it by
:func:`~excite.regressor.tree.read_tree`, which saves about a millisecond in a loop over short trajectories.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from excite.arrays import Array, Moved
from excite.errors import InputError
from excite.regressor import force_loops, motion_loops, row_loops
from excite.regressor.tree import FREE_FLYER, KinematicTree, read_tree


@dataclass(frozen=True, eq=False)
class Placements:
    """Poses of all joints along a trajectory, in the world frame.

    Attributes:
        rotation: ``(n, n_joints + 1, 3, 3)`` by pinocchio joint index, 0 is the universe.
        translation: ``(n, n_joints + 1, 3)`` [m].
    """

    rotation: Array
    translation: Array

    def point(self, joint: int, local: Array) -> Array:
        """World position [m] of points fixed to a joint.

        ``local`` of shape ``(3,)`` gives ``(n, 3)``, of shape ``(k, 3)`` gives ``(n, k, 3)``.
        """
        rotated = np.einsum("nij,...j->n...i", self.rotation[:, joint], local)
        return np.asarray(rotated + self.translation[:, joint].reshape(-1, *[1] * (np.ndim(local) - 1), 3))


def forward_kinematics(model: pin.Model | KinematicTree, q: Array) -> Placements:
    """Poses of all joints.

    Args:
        model: the robot's model.
        q: ``(n, nq)`` configurations.

    Returns:
        Poses in the world frame.

    Raises:
        InputError: wrong shape.
        RobotError: a joint of a kind that is not supported.
    """
    tree = read_tree(model)
    q = _check_shape(q, tree.nq, "q")
    still = np.zeros((len(q), tree.nv))
    state = np.empty((len(q), tree.n_segments + 1, motion_loops.STATE_SIZE))
    motion_loops.propagate_motion(tree.structure, tree.gravity, True, q, still, still, state)
    rotation = state[:, :, : motion_loops.POS].reshape(*state.shape[:2], 3, 3)
    return Placements(rotation.copy(), state[:, :, motion_loops.POS : motion_loops.OMEGA].copy())


def inverse_dynamics(
    model: pin.Model | KinematicTree, q: Array, v: Array, a: Array, phi: Array | None = None
) -> Array:
    """Generalised forces of a trajectory by recursive Newton-Euler (Luh, Walker, Paul 1980).

    Args:
        model: the robot's model.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.
        phi: ``(10·n_segments,)`` inertial parameters; the model's own if None.

    Returns:
        ``(n, nv)`` [N·m or N]; the first six of a floating base are the wrench (force, moment) at the base's
        origin in the base frame.

    Raises:
        InputError: wrong shape.
    """
    tree = read_tree(model)
    phi = checked_parameters(tree, phi)
    q, v, a = checked_trajectory(tree, q, v, a)
    out = np.empty((len(q), tree.nv))
    room, block, _ = block_of(tree)
    force_loops.joint_torques_into(
        tree.structure, tree.gravity, q, v, a, phi, room, block, *load_of(tree), out
    )
    return out


def placement_gradient(
    model: pin.Model | KinematicTree, joint: str, q: Array, v: Array, a: Array, phi: Array | None = None
) -> Array:
    """Derivative of :func:`inverse_dynamics` with a joint's position in its parent.

    Forces are of second degree in that position: a central difference has no error of its own, whatever its step.

    Args:
        model: the robot's model.
        joint: name of a joint, not that of a floating base.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.
        phi: ``(10·n_segments,)`` inertial parameters; the model's own if None.

    Returns:
        ``(n, nv, 3)`` [N·m/m or N/m], along the axes of the parent's frame.

    Raises:
        InputError: wrong shape, or no such joint.
    """
    tree = read_tree(model)
    place = tree.names.index(joint) if joint in tree.names else 0
    if place == 0 or tree.kinds[place] == FREE_FLYER:
        raise InputError(f"no joint {joint!r} that could be moved", remedy="name one of the model's joints")
    ends = []
    for step in (*np.eye(3), *-np.eye(3)):
        translations = tree.translations.copy()
        translations[place] += step
        ends.append(inverse_dynamics(replace(tree, translations=translations), q, v, a, phi))
    return np.stack([0.5 * (ends[axis] - ends[axis + 3]) for axis in range(3)], axis=2)


def base_link_regressor(
    model: pin.Model | KinematicTree, q: Array, v: Array, a: Array, out: Array | None = None
) -> Array:
    """Regressor of the wrench on the whole robot (Ayusawa, Venture, Nakamura 2014, eq. 6).

    Args:
        model: the robot's model.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.
        out: array to write to, C-contiguous, of the result's shape.

    Returns:
        ``(n, 6, 10·n_segments)``: force [N] then moment [N·m] per unit of each inertial parameter; at the
        base's origin in the base frame for a floating base, at the world's in its frame for a fixed one.

    Raises:
        InputError: wrong shape.
    """
    tree = read_tree(model)
    q, v, a = checked_trajectory(tree, q, v, a)
    out = _check_output(out, (len(q), 6, 10 * tree.n_segments))
    row_loops.base_rows(tree.structure, tree.gravity, q, v, a, *block_of(tree), out)
    return out


def joint_torque_regressor(
    model: pin.Model | KinematicTree, q: Array, v: Array, a: Array, out: Array | None = None
) -> Array:
    """Regressor of the generalised forces: ``inverse_dynamics = regressor @ phi``.

    Args:
        model: the robot's model.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.
        out: array to write to, C-contiguous, of the result's shape.

    Returns:
        ``(n, nv, 10·n_segments)`` [N·m or N per unit of each parameter].

    Raises:
        InputError: wrong shape.
    """
    tree = read_tree(model)
    q, v, a = checked_trajectory(tree, q, v, a)
    out = _check_output(out, (len(q), tree.nv, 10 * tree.n_segments))
    wrench, screws = np.empty((1, 6, 10)), np.empty((tree.n_segments + 1, 6))
    row_loops.torque_rows(tree.structure, tree.gravity, q, v, a, *block_of(tree), wrench, screws, out)
    return out


class Block(NamedTuple):
    """Memory of the compiled loops for a block of samples: scratch, and states of all bodies in two orders."""

    room: Array
    bodies: Array
    samples: Array


def block_of(tree: KinematicTree) -> Block:
    """What compiled loops need for the motion of a block of samples: scratch, and room for the states of all bodies as
    :func:`~excite.regressor.motion_loops.move_bodies` and :func:`~excite.regressor.motion_loops.by_sample` fill it.
    """
    bodies, size, lanes = tree.n_segments + 1, motion_loops.STATE_SIZE, motion_loops.LANES
    room = np.empty(motion_loops.ROOM_SIZE * lanes)
    return Block(room, np.empty((bodies, size * lanes)), np.empty((lanes, bodies, size)))


def load_of(tree: KinematicTree) -> tuple[Array, Array]:
    """What compiled loops need for the forces of a block: those of all bodies, and scratch for one."""
    lanes = motion_loops.LANES
    return np.empty((tree.n_segments + 1, 6 * lanes)), np.empty(force_loops.LOAD_SIZE * lanes)


def checked_trajectory(tree: KinematicTree, q: Array, v: Array, a: Array) -> Moved:
    """A trajectory as the compiled loops take it, of a length and of widths that fit the robot."""
    q, v, a = _check_shape(q, tree.nq, "q"), _check_shape(v, tree.nv, "v"), _check_shape(a, tree.nv, "a")
    if not len(q) == len(v) == len(a):
        raise InputError(
            f"q, v, a have {len(q)}, {len(v)}, {len(a)} samples", remedy="hand over as many of each"
        )
    return Moved(q, v, a)


def _check_shape(values: Array, width: int, name: str) -> Array:
    values = np.ascontiguousarray(values, dtype=float)
    if values.ndim != 2 or values.shape[1] != width:
        raise InputError(f"{name} has shape {values.shape}", remedy=f"expected (n_samples, {width})")
    return values


def checked_parameters(tree: KinematicTree, phi: Array | None) -> Array:
    """Inertial parameters as the compiled loops take them, the model's own where none are given."""
    if phi is None:
        return tree.phi
    phi = np.ascontiguousarray(phi, dtype=float)
    if phi.shape != tree.phi.shape:
        raise InputError(f"phi has shape {phi.shape}", remedy=f"expected {tree.phi.shape}")
    return phi


def _check_output(out: Array | None, shape: tuple[int, ...]) -> Array:
    if out is None:
        return np.empty(shape)
    if out.shape != shape or not out.flags.c_contiguous or out.dtype != np.float64:
        raise InputError(
            f"out has shape {out.shape} and type {out.dtype}", remedy=f"expected C-contiguous {shape}"
        )
    return out
