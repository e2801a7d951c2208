"""The trivial neighbours of a diagnosis' held-out figures: of positions that follow commands, and of torques."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.answer.trivial import TrivialErrors
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.units import force_unit, slides
from excite.diagnosis.trivial.alike import Alike, Commanded, alike, difference, turned
from excite.diagnosis.trivial.delayed_command import fit_delayed_command
from excite.diagnosis.trivial.even_trial import EvenTrial, Span, even_trials
from excite.diagnosis.trivial.fir import fit_fir
from excite.logs.log import Log
from excite.robot.robot import Robot


class _Predictor(Protocol):
    def predicted(self, trial: EvenTrial) -> Array:
        """Positions ``(n, n_joints)``."""


def of_positions(
    robot: Robot,
    log: Log,
    joints: Sequence[str],
    spans: Sequence[Span] = (),
    model: Mapping[str, float] | None = None,
    floor: Mapping[str, float] | None = None,
) -> dict[str, TrivialErrors]:
    """What simple predictors of positions reach, by joint.

    They are fitted on the identification trials and judged on the pieces that judge the simulator.

    Args:
        robot: the robot.
        log: the log, repaired, with commands.
        joints: the channels.
        spans: pieces that judge; by default the whole validation trials, all trials where there are none.
        model: the simulator's own errors there [rad or m].
        floor: what no model can go below [rad or m].
    """
    trials = even_trials(log, joints, spans)
    learnt = [t for t in trials if t.learns]
    if not learnt or not any(t.judges.any() for t in trials):
        return {}
    late, fir = fit_delayed_command(learnt), fit_fir(learnt)
    command = _error(trials, [t.command for t in trials])
    delayed, filtered = (_error(trials, [p.predicted(t) for t in trials]) for p in (late, fir))
    repeat = _repeat(
        trials, [t.time for t in trials], [t.position for t in trials], [t.judges for t in trials]
    )
    return {
        name: TrivialErrors(
            command=float(command[j]),
            delayed_command=float(delayed[j]),
            fir=float(filtered[j]),
            repeat=None if repeat is None else float(repeat[j]),
            model=None if model is None else model.get(name),
            floor=0.0 if floor is None else floor.get(name, 0.0),
            unit="m" if slides(robot, name) else "rad",
            delay_s=float(late.delay_s[j]),
            fir_s=float(fir.length_s[j]),
        )
        for j, name in enumerate(joints)
    }


def of_torques(samples: ArmSamples, after: Array) -> dict[str, TrivialErrors]:
    """What one trial's torques say of another's with the same command, by joint; no more where torques are judged.

    Args:
        samples: the samples.
        after: ``(n_joints, n_rows)`` what the model leaves [N·m].
    """
    measured = samples.rows(samples.stacked("measured"))
    trials = samples.trials
    judge = samples.judging
    rows = [np.flatnonzero(samples.trial_of_row == k) for k in range(len(trials))]
    repeat = _repeat(
        [_Run(t) for t in trials],
        [t.time[t.rows] for t in trials],
        [measured[r] for r in rows],
        [judge[r] for r in rows],
    )
    model = np.sqrt((after[:, judge] ** 2).mean(axis=1))
    return {
        name: TrivialErrors(
            repeat=None if repeat is None else float(repeat[j]),
            model=float(model[j]),
            unit=force_unit(samples.robot, name),
        )
        for j, name in enumerate(samples.joints)
    }


class _Run:
    """A trial that is compared by its command, by its motion where there is none."""

    def __init__(self, trial: ArmTrial) -> None:
        self.name, self.repeats, self.time = trial.name, trial.repeats, trial.time
        self.q = trial.q if trial.q_cmd is None else trial.q_cmd
        self.v = trial.v if trial.q_cmd is None else np.gradient(trial.q_cmd, trial.time, axis=0)


def _error(trials: Sequence[EvenTrial], predicted: Sequence[Array]) -> Array:
    """RMS over all rows that judge, ``(n_joints,)``."""
    left = [(p - t.position)[t.judges] for p, t in zip(predicted, trials, strict=True)]
    return np.asarray(np.sqrt((np.concatenate(left) ** 2).mean(axis=0)))


def _repeat(
    trials: Sequence[Commanded],
    times: Sequence[Array],
    values: Sequence[Array],
    judges: Sequence[NDArray[np.bool_]],
) -> Array | None:
    """Mean over pairs of trials with one command of the RMS of their difference, ``(n_channels,)``.

    Each pair with a trial that judges counts on the rows that do; where no such trial was run twice, all pairs.
    """
    pairs = alike(trials)
    seen: list[Alike] = [side for pair in pairs for side in (pair, turned(pair))]
    told = [difference(pair, times, values, judges) for pair in seen]
    if not any(len(item) for item in told):
        told = [difference(pair, times, values) for pair in pairs]
    each = [np.sqrt((item**2).mean(axis=0)) for item in told if len(item)]
    return np.mean(each, axis=0) if each else None
