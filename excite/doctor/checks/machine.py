"""Trials to learn from and to judge by that are not of the same machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.doctor.check import Check, Outcome
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import torque_samples
from excite.finding import Finding, list_names
from excite.logs.log import Log, Trial
from excite.robot.robot import Robot

# One set of likely bodies and drives for all trials leaves so much more than one for each part: half the logarithm of
# the residual's power [nat], summed over the channels, and at one channel at least.
_WORSE, _AT_ONE = 1.0, 0.5
# Below this share of a torque's power nothing needs a second machine.
_MUCH = 0.05


class OtherMachine(Check):
    """Likely bodies and drives that explain the trials to learn from explain those to judge by as well."""

    kinds = ("other_machine",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        if log.header.free_base or log.header.torque in {None, "none"}:
            return Outcome(log)
        judges = tuple(trial.name for trial in log.role("validation"))
        learnt = log.role("identification")
        found = _apart(robot, log, learnt, log.role("validation"))
        if found is None:
            return Outcome(log)
        worse, much = found
        if not _differs(worse, much):
            return Outcome(log)
        # What no model has sets the trials of one machine apart as well, by their postures; where these are too
        # short to see how far, nothing is known of another machine.
        usual = [_apart(robot, log, first, second) for first, second in _halves(learnt)]
        if all(one is None for one in usual):
            return Outcome(log)
        for one in usual:
            worse = worse if one is None else np.minimum(worse, found[0] - np.maximum(one[0], 0.0))
        bad = (worse > _AT_ONE) & much
        if not _differs(worse, much):
            return Outcome(log)
        names = tuple(np.array(log.header.torque_joints)[bad])
        text = (
            f"what the trials to learn from say of {list_names(names)} does not hold in the trials to judge by: another "
            "machine, another load, channels put together otherwise, or something that acts in their postures alone, "
            "such as a stop"
        )
        finding = Finding(
            "other_machine",
            text,
            {"worse_nat": float(worse.sum())},
            names,
            severity="spoils",
            sure=0.8,
            remedy="compare robots, loads and settings of the recordings",
            trials=judges,
        )
        return Outcome(log, (finding,))


def _differs(worse: Array, much: NDArray[np.bool_]) -> bool:
    return float(worse.sum()) >= _WORSE and bool(((worse > _AT_ONE) & much).any())


def _halves(trials: tuple[Trial, ...]) -> tuple[tuple[tuple[Trial, ...], tuple[Trial, ...]], ...]:
    """Trials parted by their order, and by turns; of a trial alone its quarters."""
    if len(trials) == 1:
        (whole,) = trials
        parts = np.array_split(np.arange(whole.n_samples), 4)
        trials = tuple(replace(whole.rows(rows), name=f"{whole.name}_{k}") for k, rows in enumerate(parts))
    middle = len(trials) // 2
    return ((trials[:middle], trials[middle:]), (trials[::2], trials[1::2]))


def _apart(
    robot: Robot, log: Log, first: tuple[Trial, ...], second: tuple[Trial, ...]
) -> tuple[Array, NDArray[np.bool_]] | None:
    """By how much one set of bodies and drives for all leaves more than one a part [nat], and where that is much."""
    left = [_left(robot, log, trials) for trials in (first, second, (*first, *second))]
    if any(values is None for values in left):
        return None
    one, other, together = (values[:-1] for values in left if values is not None)
    return together - 0.5 * (one + other), together > 0.5 * np.log(_MUCH)


def _left(robot: Robot, log: Log, trials: tuple[Trial, ...]) -> Array | None:
    """What likely bodies leave of some trials; None where there is nothing to look at."""
    chosen = replace(log, trials=tuple(replace(trial, role="identification") for trial in trials))
    samples = torque_samples(robot, chosen) if trials else None
    return None if samples is None else samples.judged(Reading.as_stated(log))
