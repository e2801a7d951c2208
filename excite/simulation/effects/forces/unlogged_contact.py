"""A hand on a table that the log knows nothing of."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from excite.simulation.coordinates import body_name
from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.plant import Plant
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class TouchLaw:
    """An upward force on a link's centre of mass that comes and goes smoothly every ``period``.

    Attributes:
        link: its name.
        force: at most [N].
        period: [s]; the contact lasts half of it.
    """

    link: str
    force: float
    period: float = 2.0

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        body = plant.model.body(body_name(self.link)).id

        def step() -> None:
            wave = math.sin(2.0 * math.pi * plant.time / self.period) if plant.time > 0.0 else 0.0
            plant.force[body, 2] += self.force * max(wave, 0.0)

        return step


class UnloggedContact(InjectedEffect):
    """The last link touches something every two seconds."""

    name = "unlogged_contact"
    what = "a contact that comes and goes and is not logged"
    unit = "N"
    lower, upper = -1e4, 1e4

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return tuple(segment.link for segment in reversed(virtual.robot.segments))

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.03 * 9.81 * virtual.robot.mass

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_law(TouchLaw(location, value))
