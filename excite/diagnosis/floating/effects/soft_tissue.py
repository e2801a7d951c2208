"""Markers or straps on soft tissue: a segment seems to turn when the body shakes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, joint_of, joints
from excite.diagnosis.floating.effects.form import Beyond
from excite.diagnosis.floating.equations.joint_turns import joint_turn
from excite.diagnosis.floating.equations.state import State
from excite.doctor.doubt import Doubt

_CUTOFF_HZ = 3.0


class SoftTissue(FloatingEffect):
    """The true angles of a segment's joints differ from those logged by what its acceleration does to the tissue.

    Tissue on a spring and a damper follows the acceleration of the joint's origin as an oscillator does:
    ``inertia·φ'' + lag·φ' + φ = by·acceleration`` (Leardini et al. 2005 review what such artefacts look like).
    """

    name: ClassVar[str] = "soft_tissue"
    told_by = frozenset({Doubt.CLOCK, Doubt.DELAY})
    reads_as: ClassVar[str] = "elasticity, where the joint's load is the segment's own inertia"
    confusable_with: ClassVar[tuple[str, ...]] = ("joint_elasticity",)
    says = Beyond.MOTION
    least_shrink: ClassVar[float] = 0.3

    def locations(self, state: State) -> tuple[str, ...]:
        """Links with mass; joints through massless links belong to the next link with mass."""
        return tuple(dict.fromkeys(self._link(state, name) for name in joints(state)))

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Each joint's angle by acceleration in the world's axes; the tissue's damper and inertia."""
        direct = tuple(
            Parameter(f"{name}_by_{axis}", "rad·s²/m", 0.03, 1e-3)
            for name in self._joints(state, location)
            for axis in "xyz"
        )
        return (*direct, Parameter("lag", "s", 0.015, 1e-3), Parameter("inertia", "s²", 1e-3, 1e-4))

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Turn the joints, with the rates that this brings."""
        turned = [joint_of(state, name) for name in self._joints(state, location)]
        turns = self._wobble(state, turned[0], theta[-2:])
        q, v, a = state.q.copy(), state.v.copy(), state.a.copy()
        for joint, by in zip(turned, theta[:-2].reshape(-1, 3), strict=True):
            iq, iv = state.tree.idx_q[joint], state.tree.idx_v[joint]
            turn, rate, again = turns @ by
            q[:, iq] += turn
            v[:, iv] += rate
            a[:, iv] += again
        return state.replace(q=q, v=v, a=a)

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """The joints' columns along what each parameter makes them do."""
        turned = [joint_of(state, name) for name in self._joints(state, location)]
        there = self.apply(state, location, theta) if theta.any() else state
        here, each, tissue = self._wobble(state, turned[0], theta[-2:]), theta[:-2].reshape(-1, 3), []
        for i, parameter in enumerate(self.parameters(state, location)[-2:]):
            ahead = theta[-2:].copy()
            ahead[i] += parameter.step
            moved = self._wobble(state, turned[0], ahead) - here if each.any() else np.zeros_like(here)
            tissue.append(moved / parameter.step)
        own, shared = [], np.zeros((len(state.q), 6, len(tissue)))
        for joint, by in zip(turned, each, strict=True):
            changes = np.concatenate([here, *((moved @ by)[..., None] for moved in tissue)], axis=2)
            columns = joint_turn(there, joint).columns(state.readings, *changes)
            own.append(columns[:, :, :3])
            shared = shared + columns[:, :, 3:]
        return np.concatenate([*own, shared], axis=2)

    def _wobble(self, state: State, joint: int, tissue: Array) -> Array:
        """``(3, n, 3)`` angle, velocity and acceleration for each axis' unit of angle by acceleration.

        Args:
            state: the state.
            joint: index in the tree.
            tissue: ``lag`` and ``inertia``.
        """
        out = np.empty((3, len(state.q), 3))
        point = state.poses.translation[:, joint]
        for span in state.record.spans:
            n = span.stop - span.start
            omega = 2.0 * np.pi * np.fft.rfftfreq(n, 1.0 / state.record.rate_hz)
            # Noise of accelerations is left out as a low-pass without phase does.
            follows = -(omega**2) / (1.0 + (omega / (2.0 * np.pi * _CUTOFF_HZ)) ** 8)
            follows = follows / (1.0 + 1j * omega * tissue[0] - omega**2 * tissue[1])
            line = np.linspace(0.0, 1.0, n)[:, None] * (point[span][-1] - point[span][0])
            turn = np.fft.rfft(point[span] - line, axis=0) * follows[:, None]
            for order in range(3):
                out[order, span] = np.fft.irfft(turn * (1j * omega[:, None]) ** order, n, axis=0)
        return out

    def _joints(self, state: State, link: str) -> tuple[str, ...]:
        """The joints that belong to a link."""
        return tuple(name for name in joints(state) if self._link(state, name) == link)

    def _link(self, state: State, joint: str) -> str:
        """The next link with mass at or after a joint, along single children."""
        record, index = state.record, joint_of(state, joint)
        while record.tree.phi[10 * (index - 1)] == 0.0:
            children = np.flatnonzero(record.tree.parents == index)
            if len(children) != 1:
                break
            index = int(children[0])
        return record.robot.segments[index - 1].link
