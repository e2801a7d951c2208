"""A joint that sits elsewhere than the model says."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Draft, Form, Sizes
from excite.doctor.doubt import Doubt

_STEP = 1e-4


class LinkLengthError(Effect):
    """The joint's placement in its parent shifted: change of all torques per metre along three axes."""

    name = "link_length_error"
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY, Doubt.CLOCK, Doubt.SIZE})
    linear = tuple(Parameter(f"shift_{axis}", "m", -0.3, 0.3) for axis in "xyz")
    confusable_with = ("link_inertia", "payload", "encoder_offset")
    separating_motion = "fast motion of the joints before it, in several postures"
    mujoco = "body pos"
    moves = True

    def offered(self, modelled: tuple[str, ...]) -> bool:
        # Free inertial parameters take up nearly all of it.
        return "rigid_body" not in modelled and self.name not in modelled

    def locations(self, context: Context) -> tuple[str, ...]:
        return context.joints[1:]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        samples = context.baseline.samples
        q, v, a = (samples.stacked(name) for name in ("q", "v", "a"))
        joint = samples.robot.model.getJointId(location)
        columns = []
        for axis in range(3):
            both = []
            for sign in (1.0, -1.0):
                model = samples.robot.model.copy()
                placement = model.jointPlacements[joint].copy()
                placement.translation = placement.translation + sign * _STEP * np.eye(3)[axis]
                model.jointPlacements[joint] = placement
                both.append(context.torques(q, v, a, model))
            columns.append((both[0] - both[1]) / (2.0 * _STEP))
        stacked = np.stack(columns, axis=2)
        return Shape(
            {j: stacked[:, j] for j in range(stacked.shape[1]) if np.abs(stacked[:, j]).max() > 1e-9}
        )

    def in_mujoco(self, item: Sizes) -> Form:
        def shifted(draft: Draft) -> None:
            body = draft.moved_body(item.location)
            body.pos = body.pos + np.array([item.value(p.name) for p in self.linear])

        return Form(elements=shifted)
