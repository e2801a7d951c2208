"""Torque limits as smooth constraints, with their gradients."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.excitation.optimisation.limits import JointLimits
from excite.excitation.optimisation.objective import Layout, Sampling
from excite.regressor.adjoint import torque_gradient
from excite.regressor.kernels import inverse_dynamics
from excite.regressor.tree import read_tree
from excite.robot.joint_values import per_joint

# The norm that stands for the maximum over time exceeds it by n^(1/EXPONENT) at most.
_EXPONENT = 100.0


class TorqueLimits:
    """The largest drive torque of each moved joint over time, as a share of its limit.

    Torques are those of the rigid bodies with the drives' own viscous friction and inertia; Coulomb friction
    takes its share of the limit. The base of a floating robot stands still and contacts do not matter, since no
    leg moves.

    Args:
        layout: what the variables stand for.
        limits: joint limits.
        time: ``(n,)`` at which torques are taken [s].
    """

    def __init__(self, layout: Layout, limits: JointLimits, time: Array) -> None:
        robot, joints = layout.robot, layout.joints
        self._sampling, self._tree = Sampling(layout, time), read_tree(robot.model)
        drives, nothing = robot.description.drives, np.zeros(robot.n_joints)
        blocks = (drives.viscous, drives.coulomb, drives.armature)
        viscous, coulomb, armature = (per_joint(block, robot.joint_names, nothing) for block in blocks)
        self._viscous, self._armature = viscous[joints], armature[joints]
        self._room = np.maximum(limits.torque[joints] - coulomb[joints], 1e-6)

    def torques(self, x: Array) -> Array:
        """Torques in shares of what the limits leave, ``(n, n_moved)``."""
        whole = self._sampling.whole(x)
        return self._torques(whole.q, whole.v, whole.a)

    def peaks(self, x: Array) -> Array:
        """Their largest magnitudes, ``(n_moved,)``."""
        return np.asarray(np.abs(self.torques(x)).max(axis=0))

    def rows(self, x: Array, chosen: NDArray[np.intp]) -> tuple[Array, Array]:
        """What is left of the limits of the moved joints ``chosen``, ``(m,)``, and its gradient ``(m, size)``."""
        whole = self._sampling.whole(x)
        q, v, a = whole.q, whole.v, whole.a
        layout = self._sampling.layout
        robot, first = layout.robot, layout.robot.n_base_v
        share = self._torques(q, v, a)
        left, slopes = np.empty(len(chosen)), np.empty((len(chosen), layout.size))
        for row, i in enumerate(chosen):
            top = np.abs(share[:, i]).max()
            power = (np.abs(share[:, i]) / top) ** (_EXPONENT - 1.0)
            total = (power * np.abs(share[:, i]) / top).sum()
            left[row] = 1.0 - top * total ** (1.0 / _EXPONENT)
            pull = power * total ** (1.0 / _EXPONENT - 1.0) * np.sign(share[:, i]) / self._room[i]
            weights = np.zeros((len(q), robot.n_joints))
            weights[:, layout.joints[i]] = pull
            found = torque_gradient(self._tree, q, v, a, weights)
            by_q, by_v, by_a = (part[:, first + layout.joints] for part in (found.q, found.v, found.a))
            by_v[:, i] += pull * self._viscous[i]
            by_a[:, i] += pull * self._armature[i]
            slopes[row] = -self._sampling.pulled(by_q, by_v, by_a)
        return left, slopes

    def _torques(self, q: Array, v: Array, a: Array) -> Array:
        columns = self._sampling.layout.robot.n_base_v + self._sampling.layout.joints
        tau = inverse_dynamics(self._tree, q, v, a)[:, columns]
        return np.asarray((tau + self._viscous * v[:, columns] + self._armature * a[:, columns]) / self._room)
