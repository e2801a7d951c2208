"""Markers or straps on soft tissue: a segment seems to turn when the body shakes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, joint_of, joints
from excite.diagnosis.floating.state import State
from excite.logs.signals.butterworth import lowpass
from excite.robot.robot import Array

_CUTOFF_HZ = 3.0


class SoftTissue(FloatingEffect):
    """The joint's true angle differs from the logged one by what the segment's acceleration does to the tissue.

    Tissue on a spring and a damper follows acceleration with a delay: the angle is linear in the acceleration
    of the joint's origin and in its rate (Leardini et al. 2005 review what such artefacts look like).
    """

    name: ClassVar[str] = "soft_tissue"
    reads_as: ClassVar[str] = "elasticity, where the joint's load is the segment's own inertia"
    least_shrink: ClassVar[float] = 0.3

    def locations(self, state: State) -> tuple[str, ...]:
        """Links with mass; joints through massless links belong to the next link with mass."""
        return tuple(dict.fromkeys(self._link(state, name) for name in joints(state)))

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """For the first joint of the segment: angle by acceleration, and by its rate, in the world's axes."""
        direct = tuple(Parameter(f"by_{axis}", "rad·s²/m", 0.03, 1e-3) for axis in "xyz")
        return direct + tuple(Parameter(f"by_rate_{axis}", "rad·s³/m", 0.001, 1e-4) for axis in "xyz")

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Turn the joint, with the rates that this brings."""
        joint = self._joint(state, location)
        rate_hz = state.record.rate_hz
        iq, iv = state.tree.idx_q[joint], state.tree.idx_v[joint]
        q, v, a = state.q.copy(), state.v.copy(), state.a.copy()
        point = state.poses.translation[:, joint]
        for span in state.record.spans:
            pull = _rate(_rate(lowpass(point[span], rate_hz, _CUTOFF_HZ), rate_hz), rate_hz)
            turn = pull @ theta[:3] + _rate(pull, rate_hz) @ theta[3:]
            q[span, iq] += turn
            turn = _rate(turn, rate_hz)
            v[span, iv] += turn
            a[span, iv] += _rate(turn, rate_hz)
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


def _rate(values: Array, rate_hz: float) -> Array:
    return np.gradient(values, 1.0 / rate_hz, axis=0)
