"""An accepted effect with its sizes, as a simulator takes it up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.form import Form, Sizes


@dataclass(frozen=True)
class Found:
    """An accepted effect with its sizes.

    Attributes:
        effect: the effect, in the form that was fitted.
        location: its place.
        values: its parameters, SI.
    """

    effect: Effect
    location: str
    values: Mapping[str, float]

    def form(self, joints: tuple[str, ...]) -> Form:
        """Its form in a model of an arm with torque at these joints."""
        return self.effect.in_mujoco(Sizes(self.location, self.values, joints))

    @property
    def formless(self) -> str | None:
        """Why no model can have it, in a sentence; None where models can."""
        absent = self.form((self.location,)).absent
        if absent is None:
            return None
        return f"{self.effect.name} has no form in a simulator and is left out of the model: {absent}"
