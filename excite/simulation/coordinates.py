"""Pinocchio's coordinates of a state and MuJoCo's, one into the other."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import scipy

from excite.arrays import Array


def body_name(link: str) -> str:
    """Name of a link's body in MuJoCo, which keeps ``world`` for what does not move; some bases are called so."""
    return "world link" if link == "world" else link


def position_to_mujoco(q: Array, *, floating: bool) -> Array:
    """``(nq,)`` configuration with the base's quaternion as w x y z."""
    return np.concatenate([q[:3], q[6:7], q[3:6], q[7:]]) if floating else q.copy()


def position_from_mujoco(qpos: Array, *, floating: bool) -> Array:
    """``(n, nq)`` configurations with the base's quaternion as x y z w."""
    if not floating:
        return qpos.copy()
    return np.concatenate([qpos[:, :3], qpos[:, 4:7], qpos[:, 3:4], qpos[:, 7:]], axis=1)


def velocity_to_mujoco(q: Array, v: Array, *, floating: bool) -> Array:
    """``(nv,)`` velocity with the base's linear part along the world's axes; ``q`` in pinocchio's layout."""
    result = v.copy()
    if floating:
        result[:3] = pin.Quaternion(q[3:7]).matrix() @ v[:3]
    return result


def motion_from_mujoco(q: Array, qvel: Array, qacc: Array, *, floating: bool) -> tuple[Array, Array]:
    """Velocities and accelerations with the base's twist, and its derivative, in the base frame.

    Args:
        q: ``(n, nq)`` configurations in pinocchio's layout.
        qvel: ``(n, nv)``, the base's linear part along the world's axes, its angular part along the base's.
        qacc: ``(n, nv)`` derivatives of ``qvel``.
        floating: whether there is a base.

    Returns:
        v and a, ``(n, nv)`` each; a's linear part is d(Rᵀ ṗ)/dt = Rᵀ p̈ − ω × Rᵀ ṗ.
    """
    v, a = qvel.copy(), qacc.copy()
    if floating:
        rotation = scipy.spatial.transform.Rotation.from_quat(q[:, 3:7]).as_matrix()
        v[:, :3] = np.einsum("nji,nj->ni", rotation, qvel[:, :3])
        a[:, :3] = np.einsum("nji,nj->ni", rotation, qacc[:, :3]) - np.cross(v[:, 3:6], v[:, :3])
    return v, a
