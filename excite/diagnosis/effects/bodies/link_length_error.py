"""A joint that sits elsewhere than the model says."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Draft, Form, Sizes
from excite.doctor.doubt import Doubt
from excite.regressor.placement_gradient import placement_gradient


class LinkLengthError(Effect):
    """The joint's placement in its parent shifted: change of all torques per metre along three axes."""

    name = "link_length_error"
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY, Doubt.CLOCK, Doubt.SIZE})
    linear = tuple(Parameter(f"shift_{axis}", "m", -0.3, 0.3) for axis in "xyz")
    confusable_with = ("link_inertia", "payload", "encoder_offset")
    separating_motion = "fast motion of the joints before it, in several postures"
    mujoco = "body pos"
    moves = True
    by_motion = True

    def offered(self, modelled: tuple[str, ...]) -> bool:
        # Free inertial parameters take up nearly all of it.
        return "rigid_body" not in modelled and self.name not in modelled

    def locations(self, context: Context) -> tuple[str, ...]:
        return context.joints[1:]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        samples = context.baseline.samples
        q, v, a = (samples.stacked(name) for name in ("q", "v", "a"))
        change = placement_gradient(samples.robot.model, location, q, v, a, context.baseline.phi)
        stacked = change[:, list(samples.index)]
        return Shape(
            {j: stacked[:, j] for j in range(stacked.shape[1]) if np.abs(stacked[:, j]).max() > 1e-9}
        )

    def in_mujoco(self, item: Sizes) -> Form:
        def shifted(draft: Draft) -> None:
            body = draft.moved_body(item.location)
            body.pos = body.pos + np.array([item.value(p.name) for p in self.linear])

        return Form(elements=shifted)
