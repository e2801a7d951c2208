"""A body that is on a link in some of a record's trials and not in the others."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from excite.diagnosis.effects.bodies.payload import Payload
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.effects.note import Beyond
from excite.diagnosis.equations.joint_torque import Fit


class PartTimePayload(Payload):
    """The columns of one body in the trials that have it, nothing in the others.

    Bodies that are fitted to all trials alike do not take it up: it can be told whatever is modelled.

    Attributes:
        trials: names of the trials that have the body.
    """

    def __init__(self, trials: Collection[str]) -> None:
        self.trials = frozenset(trials)

    def offered(self, modelled: tuple[str, ...]) -> bool:
        return self.name not in modelled

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        trials = context.baseline.samples.trials
        there = np.concatenate([np.full(len(t.time), t.name in self.trials) for t in trials])
        columns = super().shape(context, location, theta).columns
        return Shape({j: block * there[:, None] for j, block in columns.items()})

    def physical(self, context: Context, location: str, fit: Fit) -> bool:
        # What some trials have more, others have less: its sign was chosen with the trials.
        return True

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(absent=Beyond.SOME_TRIALS)
