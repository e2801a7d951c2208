"""What every effect says of itself, and what it is given to work with."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.context import Context
from excite.diagnosis.equations.joint_torque import Fit

Theta = tuple[float, ...]


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect.

    Attributes:
        name: its name.
        unit: SI unit.
        low: least value that is physical.
        high: greatest value that is physical.
        width: standard deviation that it has a priori.
    """

    name: str
    unit: str
    low: float = -np.inf
    high: float = np.inf
    width: float = np.inf


@dataclass(frozen=True, eq=False)
class Shape:
    """What an effect adds to the torques at given non-linear parameters.

    Attributes:
        columns: by index of the joint's row, full-rate torques per unit of each linear parameter
            ``(n_samples, n_linear)``; rows that are not named get nothing.
        offset: by index of the row, full-rate torques ``(n_samples,)`` that come without a factor.
    """

    columns: dict[int, Array] = field(default_factory=dict)
    offset: dict[int, Array] = field(default_factory=dict)


class Effect(ABC):
    """An effect: its physics, where it can be, its parameters, and what it looks like in the torques.

    Attributes:
        name: its name in a diagnosis.
        linear: its linear parameters, in the order of the columns.
        searched: its non-linear parameters, in the order of ``theta``.
        confusable_with: effects that can look alike.
        separating_motion: what motion or measurement tells them apart.
        mujoco: how a MuJoCo model expresses it; empty where it cannot.
        moves: whether it changes the torque that the gears carry (bodies, geometry), not the drives'.
        friction: whether the width of the velocity's sign change is searched along with it.
        timing: whether it is a matter of time in the torque channel as a whole.
        smooths: whether it can smooth the model's torque, and the encoders' noise in it, which is no evidence of it
            where little else is.
    """

    name: ClassVar[str]
    linear: ClassVar[tuple[Parameter, ...]] = ()
    searched: ClassVar[tuple[Parameter, ...]] = ()
    confusable_with: ClassVar[tuple[str, ...]] = ()
    separating_motion: ClassVar[str] = ""
    mujoco: ClassVar[str] = ""
    moves: ClassVar[bool] = False
    friction: ClassVar[bool] = False
    timing: ClassVar[bool] = False
    smooths: ClassVar[bool] = False

    @property
    def widths(self) -> Array:
        """Standard deviations that its linear parameters have a priori, ``(n_linear,)``."""
        return np.array([p.width for p in self.linear])

    @property
    def own_joint(self) -> bool:
        """Whether it acts on the torque of its own joint alone."""
        return not (self.moves or self.timing)

    @property
    def richer(self) -> tuple[Effect, ...]:
        """Other forms of the same physics with more parameters, tried once the effect is named, or where none is."""
        return ()

    @property
    def kin(self) -> tuple[Effect, ...]:
        """Effects that richer forms of this one run into: the same torque within a record, by another name."""
        return ()

    @property
    def closer(self) -> Effect | None:
        """The same with what its first order leaves out, tried at last; None where that is nothing."""
        return None

    @property
    def forms(self) -> tuple[Effect, ...]:
        """Other forms of the same physics that may be what is there, tried along with this one."""
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        """Where the search of a richer form begins, from the non-linear parameters of the plain one."""
        return [theta]

    def own_starts(self, context: Context, location: str) -> list[Theta]:
        """Where the search of a richer form begins besides, where the plain one fits nothing."""
        return []

    def carried_over(self, old: Context, new: Context, location: str, theta: Theta) -> Theta:
        """Non-linear parameters that say about the same on another fit of the baseline."""
        return theta

    def offered(self, modelled: tuple[str, ...]) -> bool:
        """Whether it can be told from what the baseline has."""
        return self.name not in modelled

    def locations(self, context: Context) -> tuple[str, ...]:
        """Where it can be: every joint, unless said otherwise."""
        return context.joints

    def grid(self, context: Context, location: str) -> list[Theta]:
        """Non-linear parameters to start the search from."""
        return [()]

    @abstractmethod
    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        """What it adds to the torques."""

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        """Whether the parameters are physical, and far enough from what another effect's name says better."""
        return all(p.low <= b <= p.high for p, b in zip(self.linear, beta, strict=True))

    def physical(self, context: Context, location: str, fit: Fit) -> bool:
        """Whether a fit says something that can be, within what the record tells of it."""
        return True

    def settled(self, context: Context, location: str, theta: Theta, fit: Fit) -> bool:
        """Whether a search ended within what the effect's name stands for, not at the end of it."""
        return True

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        """Its parameters, for people; without those that nothing in the record shows."""
        found = {
            p.name: Estimate(float(b), float(s), p.unit)
            for p, b, s in zip(self.linear, fit.extra, fit.extra_std, strict=True)
            if np.isfinite(s)
        }
        return found | {p.name: Estimate(t, None, p.unit) for p, t in zip(self.searched, theta, strict=True)}
