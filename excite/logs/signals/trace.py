"""What each step of the signal processing did, for a person to look at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.arrays import Array

SCHEMA = "excite.signals/1"
_MOST_POINTS = 800


@dataclass(frozen=True, eq=False)
class SignalStep:
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
        dots: whether the samples after are shown one by one.
    """

    name: str
    effect: str
    quantity: str
    axis: str
    before_x: Array
    before: Array
    after_x: Array
    after: Array
    dots: bool = False


@dataclass(frozen=True, eq=False)
class SignalTrace:
    """The steps that one trial's channel went through, in order.

    Attributes:
        trial: name of the trial.
        channel: joint or wrench component that is shown.
        steps: the steps.
    """

    trial: str
    channel: str
    steps: tuple[SignalStep, ...]

    def summary(self) -> str:
        """A line for each step."""
        width = max(len(step.name) for step in self.steps)
        lines = [f"  {step.name:{width}}  {step.effect}" for step in self.steps]
        return "\n".join([f"signals of {self.channel} in {self.trial}:", *lines])

    def to_json(self) -> dict[str, Any]:
        """The document ``excite.signals/1``, curves thinned out to what a figure shows."""
        return {
            "schema": SCHEMA,
            "trial": self.trial,
            "channel": self.channel,
            "steps": [
                {
                    "name": step.name,
                    "effect": step.effect,
                    "quantity": step.quantity,
                    "axis": step.axis,
                    "before": _plot_points(step.before_x, step.before),
                    "after": _plot_points(step.after_x, step.after),
                    "dots": step.dots,
                }
                for step in self.steps
            ],
        }


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


def _plot_points(x: Array, y: Array) -> dict[str, list[float | None]]:
    every = slice(None, None, max(1, -(-len(x) // _MOST_POINTS)))
    finite = [float(f"{value:.6g}") if np.isfinite(value) else None for value in y[every]]
    return {"x": [float(f"{value:.7g}") for value in x[every]], "y": finite}
