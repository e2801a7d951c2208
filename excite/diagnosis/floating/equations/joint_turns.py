"""How the residual changes when a joint's position, velocity and acceleration do."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.equations.moved_branch import branch
from excite.diagnosis.floating.equations.state import State

# The residual is linear in accelerations and quadratic in velocities; positions turn sines and cosines.
_STEP_Q, _STEP_V, _STEP_A = 1e-4, 1e-3, 1.0


@dataclass(frozen=True, eq=False)
class JointTurn:
    """Derivatives of the residual, each ``(n, 6)``, with respect to one joint's motion at each instant.

    Attributes:
        state: where to linearise; its readings do not matter.
        joint: index in the tree.
    """

    state: State
    joint: int

    def by_q(self, readings: dict[str, Array]) -> Array:
        """With respect to its position; sensors that it carries turn too, and what they read.

        Args:
            readings: by sensor, ``(n, 6)``.
        """
        change, levers = self._by_q
        for name, lever in levers.items():
            change = change + np.einsum("nij,nj->ni", lever, readings[name])
        return change

    @cached_property
    def _by_q(self) -> tuple[Array, dict[str, Array]]:
        """Of minus the predicted wrench; of the levers of the sensors that it carries."""
        turned = self._changed("q", int(self.state.tree.idx_q[self.joint]), _STEP_Q)
        carried = branch(self.state.tree.parents, self.joint)
        levers = {
            sensor.name: (turned.levers[sensor.name] - self.state.levers[sensor.name]) / _STEP_Q
            for sensor in self.state.record.robot.sensors
            if sensor.joint in carried
        }
        return (self.state.predicted - turned.predicted) / _STEP_Q, levers

    @cached_property
    def by_v(self) -> Array:
        """With respect to its velocity."""
        moved = self._changed("v", int(self.state.tree.idx_v[self.joint]), _STEP_V)
        return (self.state.predicted - moved.predicted) / _STEP_V

    @cached_property
    def by_a(self) -> Array:
        """With respect to its acceleration."""
        moved = self._changed("a", int(self.state.tree.idx_v[self.joint]), _STEP_A)
        return (self.state.predicted - moved.predicted) / _STEP_A

    def columns(self, readings: dict[str, Array], q: Array, v: Array, a: Array) -> Array:
        """Minus the derivative along ``k`` changes of the joint's motion, each ``(n, k)``: ``(n, 6, k)``."""
        parts = ((self.by_q(readings), q), (self.by_v, v), (self.by_a, a))
        return -np.sum([by[:, :, None] * change[:, None, :] for by, change in parts], axis=0)

    def _changed(self, what: str, column: int, step: float) -> State:
        values = getattr(self.state, what).copy()
        values[:, column] += step
        return self.state.replace(**{what: values})


def joint_turn(state: State, joint: int) -> JointTurn:
    """Derivatives for one joint (index in the tree); those of a state are computed once."""
    kept: JointTurn = state.turns.setdefault(joint, JointTurn(state, joint))
    return kept
