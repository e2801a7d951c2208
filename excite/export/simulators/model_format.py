"""The format of a simulator: how a robot is written in it, how it is read again, and what it has no place for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from excite.arrays import Array
from excite.export.models.verification import States
from excite.export.simulators.subject import Lost, Subject


@dataclass(frozen=True, eq=False)
class Rendered:
    """The files of a robot in a format.

    Attributes:
        files: contents by name in the folder, the one that a simulator opens first.
        notes: what a user of them should know, one sentence each.
        mesh_root: where relative paths in them start while nothing is written yet.
    """

    files: Mapping[str, bytes]
    notes: tuple[str, ...] = ()

    @property
    def main(self) -> str:
        """Name of the file that a simulator opens."""
        return next(iter(self.files))


class LoadedModel(ABC):
    """A robot as it was read again from files, by a reader that shares nothing with their writer.

    Attributes:
        drives: terms of joints that the files hold, ``(n_joints,)`` each in the robot's order.
        servos: terms of servos that they hold, likewise.
    """

    def __init__(self, drives: Mapping[str, Array], servos: Mapping[str, Array] | None = None) -> None:
        self.drives = drives
        self.servos = servos or {}

    @abstractmethod
    def torques(self, states: States) -> Array:
        """Inverse dynamics with all friction and rotor inertia, ``(n, nv)`` in the robot's layout."""


class ModelFormat(ABC):
    """A format for identified robots.

    Attributes:
        name: what users type.
        summary: one line for help texts.
        terms: which of :data:`~excite.export.simulators.subject.JOINT_TERMS` it holds.
        servo_terms: which of :data:`~excite.export.simulators.subject.SERVO_TERMS` it holds.
        lacks: by term that it does not hold, what that means in the simulator.
        tolerance: how far torques of what is read again may be off, relative to the largest.
        delay_step_s: what delays in it are whole multiples of; zero where any is held [s].
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    terms: ClassVar[tuple[str, ...]] = ("viscous", "coulomb", "armature")
    servo_terms: ClassVar[tuple[str, ...]] = ()
    lacks: ClassVar[Mapping[str, str]] = {}
    tolerance: ClassVar[float] = 1e-9
    delay_step_s: ClassVar[float] = 0.0

    @abstractmethod
    def render(self, subject: Subject) -> Rendered:
        """The files.

        Raises:
            InputError: the format takes no such robot.
        """

    @abstractmethod
    def load(self, subject: Subject, rendered: Rendered) -> LoadedModel:
        """The robot as the format's reader understands the files; raises InputError where it refuses them.

        Args:
            subject: for the robot's names and joints; none of its values.
            rendered: the files.
        """

    def lost(self, subject: Subject) -> tuple[Lost, ...]:
        """What was found and the format holds in no way of its own, beside what :mod:`lost` says of every format."""
        return ()

    def servo(self, subject: Subject) -> tuple[str, ...]:
        """Terms of servos that files of this subject hold."""
        return self.servo_terms

    def exact(self, subject: Subject) -> bool:
        """Whether torques have to be the found ones, and not only change as they do."""
        return True
