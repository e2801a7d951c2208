"""Curves of an arm's torques."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.curves import Curves
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.units import force_unit


def trial_curves(samples: ArmSamples, before: Array, after: Array) -> Curves:
    """Curves of the first validation trial, of the first trial where there is none.

    Args:
        samples: the samples.
        before: ``(n_joints, n_rows)`` measured minus predicted without effects [N·m].
        after: the same with the effects.
    """
    chosen = next((k for k, t in enumerate(samples.trials) if not t.identification), 0)
    trial, here = samples.trials[chosen], samples.trial_of_row == chosen
    measured = np.asarray(samples.rows(samples.stacked("measured"))[here])
    before, after = (samples.unweighed(values)[:, here].T for values in (before, after))
    return Curves(
        trial=trial.name,
        validation=not trial.identification,
        channels=samples.joints,
        units=tuple(force_unit(samples.robot, name) for name in samples.joints),
        time=trial.time[trial.rows],
        measured=measured,
        before=measured - before,
        after=measured - after,
    )
