"""A link whose inertial parameters are not the model's."""

from __future__ import annotations

from dataclasses import replace

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.true_parameters import TrueParameters
from excite.simulation.virtual_robot import VirtualRobot


class LinkInertia(InjectedEffect):
    """All ten parameters times ``1 + value``: a link of another material."""

    name = "link_inertia"
    what = "a link that is heavier or lighter by this share"
    unit = "1"
    lower, upper = -0.9, 10.0

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return tuple(segment.link for segment in reversed(virtual.robot.segments))

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.5

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        phi = virtual.truth.phi.copy()
        k = next(i for i, each in enumerate(virtual.robot.segments) if each.link == location)
        phi[10 * k : 10 * k + 10] *= 1.0 + value
        return replace(virtual, truth=TrueParameters(phi, virtual.truth.parts, virtual.truth.scatter))
