"""What every injected effect says about itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import ClassVar

from excite.errors import InputError, UnknownNameError
from excite.simulation.virtual_robot import Injected, VirtualRobot


class InjectedEffect(ABC):
    """Something that a virtual robot has and its nominal model lacks.

    Attributes:
        name: name in the registry and on the command line.
        what: one line for people.
        unit: unit of the value.
        lower: smallest value allowed.
        upper: largest value allowed.
    """

    name: ClassVar[str]
    what: ClassVar[str]
    unit: ClassVar[str]
    lower: ClassVar[float]
    upper: ClassVar[float]

    @abstractmethod
    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        """Where it can sit on this robot; the first is the default; empty where it cannot sit at all."""

    @abstractmethod
    def default(self, virtual: VirtualRobot, location: str) -> float:
        """A value that a careful experiment should notice on this robot."""

    @abstractmethod
    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        """The robot with the effect; location and value are already checked."""

    def inject(
        self, virtual: VirtualRobot, location: str | None = None, value: float | None = None
    ) -> VirtualRobot:
        """The robot with the effect.

        Args:
            virtual: the robot; left as it is.
            location: where, None for the first of :meth:`locations`.
            value: how much [``unit``], None for :meth:`default`.

        Raises:
            UnknownNameError: the effect cannot sit there.
            InputError: the effect cannot sit on this robot at all, or the value is out of bounds.
        """
        known = self.locations(virtual)
        if not known:
            raise InputError(
                f"{self.name} has no place on {virtual.robot.name}", remedy="inject something else"
            )
        location = known[0] if location is None else location
        if location not in known:
            raise UnknownNameError(f"location of {self.name}", location, list(known))
        value = self.default(virtual, location) if value is None else value
        if not self.lower <= value <= self.upper:
            raise InputError(
                f"{self.name} is {value:g} {self.unit}",
                remedy=f"choose from {self.lower:g} to {self.upper:g} {self.unit}",
            )
        changed = self.apply(virtual, location, value)
        return replace(changed, injected=(*virtual.injected, Injected(self.name, location, value, self.unit)))
