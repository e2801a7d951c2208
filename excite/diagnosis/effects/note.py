"""What a MuJoCo model cannot say of an effect and leaves to whoever runs it: typed, and as text within the model."""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Any, ClassVar, Self

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.bristle import Bristle, Static


class Beyond(StrEnum):
    """Why a MuJoCo model cannot have an effect, or a part of it, by itself."""

    FRICTION = "a joint has one level of dry friction, whatever its speed, load, time and deflection"
    SPRING = "a joint's spring is odd in its deflection and not periodic"
    CHANNEL = "a motor has one filter and no delay"
    READING = "the servo and the log read a joint's position alike"
    START = "where a gear stands when a roll-out begins is part of the state"
    SOME_TRIALS = "it is there in some trials alone"
    NO_FORM = "no form is given"


def _no_runs() -> Array:
    return np.zeros(0)


@dataclass(eq=False, slots=True)
class JointStep:
    """A joint at the start of a step, in every run of a simulation; all arrays are ``(n_runs,)``.

    Attributes:
        carried: torque that its gear carries, asked for where it is needed [N·m].
        bends: whether all its dry friction builds up over a deflection.
        q: position [rad].
        v: velocity [rad/s].
        trial_s: time since the trial's start [s].
        session_s: time since the session's start [s].
        growth: how far friction that drifts had come when the roll-out began, where that is known.
    """

    carried: Callable[[], Array]
    bends: bool = False
    q: Array = field(default_factory=_no_runs)
    v: Array = field(default_factory=_no_runs)
    trial_s: Array = field(default_factory=_no_runs)
    session_s: Array = field(default_factory=_no_runs)
    growth: Array | None = None


class Note(ABC):
    """What a runner does for an effect; a frozen dataclass of numbers, those that may be missing None by default.

    Attributes:
        beyond: why the model cannot say it.
        every_step: whether the runner has to see to it at every step.
        rubs: whether it changes the joint's dry or viscous friction.
        takes_all: whether its bristles hold all of the joint's dry friction.
    """

    beyond: ClassVar[Beyond]
    every_step: ClassVar[bool] = True
    takes_all: ClassVar[bool] = False

    @property
    def rubs(self) -> bool:
        """Whether it changes the joint's dry or viscous friction."""
        return False

    @property
    def late_by(self) -> float:
        """Time by which the torque channel is late [s]."""
        return 0.0

    @property
    def filter_before(self) -> float:
        """Time constant of a filter before the motors [s]."""
        return 0.0

    @property
    def log_offset(self) -> float:
        """By how much the log's position exceeds the one that a servo reads [rad]."""
        return 0.0

    @property
    def static(self) -> Static | None:
        """Static friction, which further bends whatever bristles the joint's friction has."""
        return None

    def bristle(self) -> Bristle | None:
        """Bristles of its own."""
        return None

    def held(self, level: Array) -> Array:
        """Dry friction that its own bristles hold, of a joint with a ``level`` of it, both ``(n_runs,)`` [N·m]."""
        return np.zeros_like(level)

    def deflection(self, torque: float) -> float | None:
        """Where the joint's gear rests under a torque [N·m] that it opposes [rad]; None where it does not give way."""
        return None

    def friction(self, level: Array, at: JointStep) -> tuple[Array, Array | float]:
        """A joint's level of dry friction with it [N·m], and viscous friction that it adds [N·m·s/rad], by run."""
        return level, 0.0

    def torque(self, at: JointStep) -> Array | float:
        """Torque on the joint, ``(n_runs,)`` [N·m]."""
        return 0.0

    @classmethod
    def numbers(cls) -> tuple[str, ...]:
        """Names of its numbers, in order."""
        # They are its dataclass' fields, which its abstract class has none of.
        known: Any = cls
        return tuple(f.name for f in fields(known))

    @classmethod
    def of(cls, values: Mapping[str, float]) -> Self:
        """The note with those of the values that are its own."""
        return cls(**{name: values[name] for name in cls.numbers() if name in values})

    def text(self) -> str:
        """Its numbers by name; those that it does not have are left out."""
        values = ((name, getattr(self, name)) for name in self.numbers())
        return " ".join(f"{name}={value:.9g}" for name, value in values if value is not None)


@dataclass(frozen=True, eq=False)
class Noted:
    """A note at a place.

    Attributes:
        word: what it is called in the model: the effect's name.
        place: joint, or the channels of ``torque``.
        note: the note.
    """

    word: str
    place: str
    note: Note
