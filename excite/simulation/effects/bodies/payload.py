"""A body that the robot carries unknown to its model."""

from __future__ import annotations

from dataclasses import replace

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.true_parameters import AddedPart, with_part
from excite.simulation.virtual_robot import VirtualRobot

_DENSITY = 2700.0


class Payload(InjectedEffect):
    """A cube of aluminium whose centre lies at the link's centre of mass; the last link by default."""

    name = "payload"
    what = "a body that a link carries"
    unit = "kg"
    lower, upper = 1e-3, 1e3

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return tuple(segment.link for segment in reversed(virtual.robot.segments))

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.02 * virtual.robot.mass

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        robot = virtual.robot
        segment = next(index for index, each in enumerate(robot.segments) if each.link == location)
        x, y, z = (float(part) for part in robot.model.inertias[segment + 1].lever)
        edge = (value / _DENSITY) ** (1.0 / 3.0)
        part = AddedPart("payload", segment, location, value, (x, y, z), (edge, edge, edge))
        return replace(virtual, truth=with_part(virtual.truth, part))
