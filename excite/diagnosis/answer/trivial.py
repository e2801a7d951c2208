"""What predictors far simpler than a simulator reach where it is judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from excite.finding import Finding, list_names
from excite.results import HIDDEN, Name, Stated, UnboundedPositive

# Up to so many times the floor a model does what can be done, and its neighbours tell nothing.
_AT_FLOOR = 1.3


@dataclass(frozen=True)
class TrivialErrors(Stated):
    """RMS errors of one channel on the rows that judge [unit]; None what the record does not tell.

    Attributes:
        command: of the command taken for the position; null for torques.
        delayed_command: of the command a while ago, to a scale and an offset.
        fir: of a linear filter from the command to the position.
        repeat: by which trials with the same command differ; null without such.
        model: of the simulator with the effects found.
        floor: what no model can go below.
        unit: of them all.
        delay_s: delay of the delayed command [s].
        fir_s: length of the filter [s].
    """

    command: UnboundedPositive | None = None
    delayed_command: UnboundedPositive | None = None
    fir: UnboundedPositive | None = None
    repeat: UnboundedPositive | None = None
    model: UnboundedPositive | None = None
    floor: float = field(default=0.0, metadata=HIDDEN)
    unit: Name = "rad"
    delay_s: UnboundedPositive | None = None
    fir_s: UnboundedPositive | None = None

    @property
    def best(self) -> float | None:
        """The least error of the predictors that have learnt from commands."""
        known = [value for value in (self.delayed_command, self.fir) if value is not None]
        return min(known) if known else None


def beaten(errors: Mapping[str, TrivialErrors]) -> tuple[Finding, ...]:
    """A finding where a simulator is no better on trials left out than what has no physics."""
    known = {name: (e, e.best, e.model) for name, e in errors.items()}
    worse = {
        name: (item, best, model)
        for name, (item, best, model) in known.items()
        if best is not None and model is not None and model >= max(best, _AT_FLOOR * item.floor)
    }
    if not worse:
        return ()
    said = [
        f"{name} {model:.2g} {item.unit} against {best:.2g} of {_by(item)}"
        for name, (item, best, model) in worse.items()
    ]
    text = (
        f"at {len(worse)} of {len(errors)} joints the simulator is no better on trials left out than "
        f"a linear filter or a delay of the command: {list_names(said)}; they do not show that its physics is right"
    )
    figures = {
        **{f"model.{name}": model for name, (_, _, model) in worse.items()},
        **{f"trivial.{name}": best for name, (_, best, _) in worse.items()},
    }
    return (
        Finding(
            "no_better_than_trivial",
            text,
            figures,
            tuple(worse),
            "limits",
            remedy="take the filter where only positions are wanted, or look for what the model lacks",
        ),
    )


def _by(item: TrivialErrors) -> str:
    fir, late = item.fir, item.delayed_command
    return "the filter" if late is None or (fir is not None and fir <= late) else "the delay"


def overall(errors: Mapping[str, TrivialErrors], name: str) -> float | None:
    """Root mean square over the channels of one of the errors; None where any channel lacks it."""
    values = [getattr(item, name) for item in errors.values()]
    if not values or any(v is None for v in values):
        return None
    return float(np.sqrt(np.mean(np.square(values))))
