"""Markers or straps on soft tissue: a segment seems to turn when the body shakes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, joint_of, joints
from excite.diagnosis.floating.state import State
from excite.robot.robot import Array

_CUTOFF_HZ = 3.0


class SoftTissue(FloatingEffect):
    """The joint's true angle differs from the logged one by what the segment's acceleration does to the tissue.

    Tissue on a spring and a damper follows the acceleration of the joint's origin as an oscillator does:
    ``inertia·φ'' + lag·φ' + φ = by·acceleration`` (Leardini et al. 2005 review what such artefacts look like).
    """

    name: ClassVar[str] = "soft_tissue"
    reads_as: ClassVar[str] = "elasticity, where the joint's load is the segment's own inertia"
    least_shrink: ClassVar[float] = 0.3

    def locations(self, state: State) -> tuple[str, ...]:
        """Links with mass; joints through massless links belong to the next link with mass."""
        return tuple(dict.fromkeys(self._link(state, name) for name in joints(state)))

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """For the first joint of the segment: angle by acceleration in the world's axes; tissue's damper, inertia."""
        direct = tuple(Parameter(f"by_{axis}", "rad·s²/m", 0.03, 1e-3) for axis in "xyz")
        return (*direct, Parameter("lag", "s", 0.015, 1e-3), Parameter("inertia", "s²", 1e-3, 1e-4))

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Turn the joint, with the rates that this brings."""
        joint = self._joint(state, location)
        iq, iv = state.tree.idx_q[joint], state.tree.idx_v[joint]
        q, v, a = state.q.copy(), state.v.copy(), state.a.copy()
        point = state.poses.translation[:, joint]
        for span in state.record.spans:
            n = span.stop - span.start
            omega = 2.0 * np.pi * np.fft.rfftfreq(n, 1.0 / state.record.rate_hz)
            # Noise of accelerations is left out as a low-pass without phase does.
            follows = -(omega**2) / (1.0 + (omega / (2.0 * np.pi * _CUTOFF_HZ)) ** 8)
            follows = follows / (1.0 + 1j * omega * theta[3] - omega**2 * theta[4])
            line = np.linspace(0.0, 1.0, n)[:, None] * (point[span][-1] - point[span][0])
            turn = np.fft.rfft((point[span] - line) @ theta[:3]) * follows
            q[span, iq] += np.fft.irfft(turn, n)
            v[span, iv] += np.fft.irfft(turn * 1j * omega, n)
            a[span, iv] += np.fft.irfft(turn * -(omega**2), n)
        return state.but(q=q, v=v, a=a)

    def _joint(self, state: State, link: str) -> int:
        """The first joint that belongs to a link."""
        return next(joint_of(state, name) for name in joints(state) if self._link(state, name) == link)

    def _link(self, state: State, joint: str) -> str:
        """The next link with mass at or after a joint, along single children."""
        record, index = state.record, joint_of(state, joint)
        while record.tree.phi[10 * (index - 1)] == 0.0:
            children = np.flatnonzero(record.tree.parents == index)
            if len(children) != 1:
                break
            index = int(children[0])
        return record.robot.segments[index - 1].link
