"""What each step of the signal processing did, for a person to look at."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from excite.arrays import Array
from excite.results import FEW, HIDDEN, Name, Stated, Unbounded, stated_with

_MOST_POINTS = 800


@dataclass(frozen=True)
class Points(Stated):
    """A curve, thinned out to what a figure shows.

    Attributes:
        x: in the unit of the axis.
        y: in the unit of the quantity; null where there is nothing.
    """

    x: tuple[float, ...]
    y: tuple[Unbounded, ...]

    @staticmethod
    def contradiction(found: Any) -> str:
        """Other numbers of places than of values."""
        n, m = len(found.x), len(found.y)
        return "" if n == m else f"x has {n} values, y has {m}"


@dataclass(frozen=True, eq=False)
class SignalStep(Stated):
    """One step: a signal before and after it.

    Attributes:
        name: the step.
        effect: what it did, with numbers, in one sentence.
        quantity: what is shown, with its unit.
        axis: what it is shown over, with its unit.
        before_x: ``(n,)``.
        before: ``(n,)``, NaN where there is nothing.
        after_x: ``(m,)``.
        after: ``(m,)`` likewise.
        dots: whether samples are shown one by one.
    """

    name: Name
    effect: str
    quantity: Name
    axis: Name
    before_x: Array = field(metadata=HIDDEN)
    before: Array = field(metadata=HIDDEN)
    after_x: Array = field(metadata=HIDDEN)
    after: Array = field(metadata=HIDDEN)
    dots: bool = False

    @property
    @stated_with(stated="before")
    def points_before(self) -> Points:
        """The signal before the step."""
        return _plot_points(self.before_x, self.before)

    @property
    @stated_with(stated="after")
    def points_after(self) -> Points:
        """The signal after it."""
        return _plot_points(self.after_x, self.after)


@dataclass(frozen=True, eq=False)
class SignalTrace(Stated):
    """The steps that one trial's channel went through, in order.

    Attributes:
        trial: name of the trial.
        channel: joint or wrench component that is shown.
        steps: the steps.
    """

    SCHEMA = "excite.signals/1"

    trial: Name
    channel: Name
    steps: Annotated[tuple[SignalStep, ...], FEW]

    @staticmethod
    def contradiction(found: Any) -> str:
        """A channel that went through nothing."""
        return "" if found.steps else "steps: list should have at least 1 item"

    def summary(self) -> str:
        """A line for each step."""
        width = max(len(step.name) for step in self.steps)
        lines = [f"  {step.name:{width}}  {step.effect}" for step in self.steps]
        return "\n".join([f"signals of {self.channel} in {self.trial}:", *lines])


def trace_from_json(document: dict[str, Any]) -> SignalTrace:
    """What :meth:`SignalTrace.to_json` wrote."""
    steps = []
    for step in document["steps"]:
        curves: dict[str, Any] = {}
        for side in ("before", "after"):
            curves[f"{side}_x"] = np.array(step[side]["x"], dtype=float)
            curves[side] = np.array(step[side]["y"], dtype=float)
        words = {key: step[key] for key in ("name", "effect", "quantity", "axis", "dots")}
        steps.append(SignalStep(**words, **curves))
    return SignalTrace(document["trial"], document["channel"], tuple(steps))


def _plot_points(x: Array, y: Array) -> Points:
    every = slice(None, None, max(1, -(-len(x) // _MOST_POINTS)))
    rounded = (
        tuple(float(f"{value:.{digits}g}") for value in values[every]) for values, digits in ((x, 7), (y, 6))
    )
    return Points(*rounded)
