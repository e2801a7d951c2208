"""Roll-outs put back where they lie in a trial, for a picture in motion."""

from __future__ import annotations

from collections import Counter

from excite.arrays import Array
from excite.diagnosis.answer.rollout_path import RolloutPath
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.simulator.rollout_windows import Plan, spans


def rollout_path(samples: ArmSamples, plan: Plan, before: Array, after: Array) -> RolloutPath:
    """The trial of which most was simulated.

    Args:
        samples: the samples.
        plan: of the roll-outs.
        before: errors of the nominal simulator, ``(n_windows, n_kept, n_joints)`` [rad].
        after: of the augmented one, likewise.
    """
    placed = spans(samples, plan)
    name = Counter(trial for trial, _, _ in placed).most_common(1)[0][0]
    trial = next(item for item in samples.trials if item.name == name)
    recorded = trial.q[:, list(samples.index)]
    paths = [recorded.copy(), recorded.copy()]
    for (where, start, _), *both in zip(placed, before, after, strict=True):
        if where != name:
            continue
        first = int(abs(trial.time - start).argmin())
        for path, error in zip(paths, both, strict=True):
            # Of two windows that meet, the last sample is the first one's, which strayed for longest.
            path[first + 1 : first + len(error)] += error[1:]
    return RolloutPath(name, samples.joints, trial.time, recorded, *paths)
