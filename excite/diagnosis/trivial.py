"""What far simpler predictors than a simulator reach on the rows that judge it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, islice
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.answer.gap import TrivialErrors
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.repeats import Moving, Repeat, estimate_lag
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.units import force_unit, is_sliding_joint
from excite.logs.log import Log
from excite.robot.robot import Robot
from excite.rows.kinematics import forces_on_grid, positions_on_grid, trial_grid, trial_rate

# Trials that have the same command, and by how much what was measured in them differs.

# Commands are the same where their difference is less than this share of their deviation, every joint taken together.
# Ten runs of one program on a walking robot, whose logger and program kept clocks of their own, differ by 0.03.
_SAME = 0.05
# Trials whose commands' means, deviations and speeds differ by more than this share of them are not looked at closer.
_LOOK = 0.1
# So many pairs tell what a repeat is worth; so many are looked at, on so many samples: a few milliseconds each.
_PAIRS, _LOOKS, _SAMPLES = 40, 200, 4000
# What two trials must share of the shorter one.
_SHARED = 0.8


class Commanded(Moving, Protocol):
    """A trial that may repeat another."""

    @property
    def name(self) -> str:
        """Stem of its file."""

    @property
    def repeats(self) -> str | None:
        """Name of the trial that it says it repeats."""


@dataclass(frozen=True, eq=False)
class _ThinnedMotion:
    """Some samples of something that moves."""

    time: Array
    q: Array
    v: Array


def find_repeated_commands(trials: Sequence[Commanded]) -> tuple[Repeat, ...]:
    """Pairs of trials that say that they repeat each other, or whose commands do."""
    if not trials:
        return ()
    rate = 1.0 / float(np.median(np.diff(trials[0].time)))
    step = max(1, max(len(t.time) for t in trials) // _SAMPLES)
    few = [_ThinnedMotion(t.time[::step], t.q[::step], t.v[::step]) for t in trials]
    like = [_CommandSummary.from_trial(trial) for trial in few]
    apart = {(i, k): like[i].largest_difference(like[k]) for i, k in combinations(range(len(trials)), 2)}
    stated = [
        (i, k) for i, k in apart if trials[i].name == trials[k].repeats or trials[k].name == trials[i].repeats
    ]
    near = sorted(
        (pair for pair in apart if apart[pair] <= _LOOK and pair not in stated), key=apart.__getitem__
    )
    found = (
        Repeat(i, k, estimate_lag(trials[i], trials[k], rate))
        for i, k in (*stated, *near[:_LOOKS])
        if (i, k) in stated or _is_same_command(few[i], few[k], estimate_lag(few[i], few[k], rate / step))
    )
    return tuple(islice(found, _PAIRS))


@dataclass(frozen=True, eq=False)
class _CommandSummary:
    """What of a command does not depend on when a logger was started, by joint: mean, deviation, and its speed's."""

    mean: Array
    spread: Array
    speed: Array

    @classmethod
    def from_trial(cls, trial: Moving) -> _CommandSummary:
        """Of a command."""
        return cls(trial.q.mean(axis=0), trial.q.std(axis=0), trial.v.std(axis=0))

    def largest_difference(self, other: _CommandSummary) -> float:
        """Largest difference, as a share of deviations."""
        spread, speed = (
            max(float(one.sum()), float(two.sum()), 1e-300)
            for one, two in ((self.spread, other.spread), (self.speed, other.speed))
        )
        return max(
            float(np.abs(self.mean - other.mean).sum()) / spread,
            float(np.abs(self.spread - other.spread).sum()) / spread,
            float(np.abs(self.speed - other.speed).sum()) / speed,
        )


def _is_same_command(one: Moving, other: Moving, lag: float) -> bool:
    """Whether two commands are one."""
    left = _repeat_difference(Repeat(0, 1, lag), (one.time, other.time), (one.q, other.q))
    if len(left) < _SHARED * min(len(one.time), len(other.time)):
        return False
    return bool((left**2).mean() < _SAME**2 * one.q.var(axis=0).mean())


def _repeat_difference(
    pair: Repeat,
    times: Sequence[Array],
    values: Sequence[Array],
    rows: Sequence[NDArray[np.bool_]] | None = None,
) -> Array:
    """What two trials measured differently at the same instants of their command, ``(m, n_channels)``.

    Args:
        pair: the two.
        times: ``(n,)`` of every trial [s].
        values: ``(n, n_channels)`` of every trial.
        rows: which samples of each trial count, ``(n,)`` each; by default all.
    """
    there, known = times[pair.first] + pair.lag_s, times[pair.again]
    here = (there >= known[0] - 1e-9) & (there <= known[-1] + 1e-9)
    if rows is not None:
        here = here & rows[pair.first]
    other = [np.interp(there[here], known, column) for column in values[pair.again].T]
    return values[pair.first][here] - np.column_stack(other)


# Commands and positions of trials on even clocks, and which of their samples judge.

# A piece of a trial: its name, its first and its last instant after the trial's start [s].
Span = tuple[str, float, float]


@dataclass(frozen=True, eq=False)
class EvenTrial:
    """A trial on an even clock.

    Attributes:
        name: stem of its file.
        learns: whether predictors are fitted on it.
        repeats: name of the trial that it says it repeats.
        time: ``(n,)`` from its start [s].
        position: ``(n, n_joints)`` [rad or m].
        command: as ``position``.
        judges: ``(n,)`` which samples judge.
    """

    name: str
    learns: bool
    repeats: str | None
    time: Array
    position: Array
    command: Array
    judges: NDArray[np.bool_]

    @property
    def q(self) -> Array:
        """What trials are compared by: the command, ``(n, n_joints)``."""
        return self.command

    @cached_property
    def v(self) -> Array:
        """Its velocity, ``(n, n_joints)``."""
        return np.gradient(self.command, self.time, axis=0)


def even_trials(log: Log, joints: Sequence[str], spans: Sequence[Span] = ()) -> tuple[EvenTrial, ...]:
    """Trials of a log that have commands.

    Args:
        log: the log, repaired.
        joints: in the order that is wanted.
        spans: pieces that judge; by default the whole validation trials, all trials where there are none.
    """
    order = [log.header.joints.index(name) for name in joints]
    rate = float(np.median([trial_rate(log.header, trial) for trial in log.trials]))
    spared = bool(log.role("validation"))
    made = []
    for trial in log.trials:
        if trial.q_cmd is None:
            continue
        grid = trial_grid(trial, rate)
        position = positions_on_grid(trial.time, trial.q, grid)[:, order]
        # Commands come in steps, which a spline would overshoot.
        command = forces_on_grid(trial.time, trial.q_cmd, grid)[:, order]
        time, learns = grid - grid[0], trial.role == "identification"
        judges = np.full(len(time), not spans and not (spared and learns))
        for name, first, last in spans:
            if name == trial.name:
                judges |= (time >= first - 1e-9) & (time <= last + 1e-9)
        made.append(EvenTrial(trial.name, learns, trial.repeats, time, position, command, judges))
    return tuple(made)


# Linear filters of finite response from each joint's command to its position; one of one tap is a delay.

# What follows its command later than this is no servo [s]; so fine is the first search for a delay [s], and so many
# times finer the second.
_LATEST_S, _STEP_S, _FINER = 0.5, 0.005, 10
# Lengths that are tried [s]: from a stiff servo's to that of one which sways.
_LENGTHS_S = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8)
# Taps at most; between those of a long filter lie samples that are left out.
_TAPS = 40
# Ridges that are tried, relative to the mean power of the taps: commands have little above their band, and what taps
# do there is noise.
_RIDGES = (1e-8, 1e-6, 1e-4, 1e-2)
# Rows enough to fit on.
_ROWS = 20_000
# Parts of a lone trial, each left out once.
_PARTS = 4


@dataclass(frozen=True, eq=False)
class LinearFilter:
    """``q_j(t) = offset_j + Σ_k weight_jk q_cmd_j(t − lags_jk)``.

    Attributes:
        lags: ``(n_taps,)`` of each joint [s].
        weights: ``(n_taps + 1,)`` of each joint, the offset last [rad or m].
    """

    lags: tuple[Array, ...]
    weights: tuple[Array, ...]

    def predict_positions(self, trial: EvenTrial) -> Array:
        """Positions ``(n, n_joints)`` [rad or m]."""
        rows, each = np.arange(len(trial.time)), zip(self.lags, self.weights, strict=True)
        return np.column_stack(
            [_tap_columns(trial, j, lags, rows) @ weights for j, (lags, weights) in enumerate(each)]
        )

    @property
    def length_s(self) -> Array:
        """Largest lag of each joint, ``(n_joints,)`` [s]."""
        return np.array([lags[-1] for lags in self.lags])


def fit_delayed_command(trials: Sequence[EvenTrial]) -> LinearFilter:
    """The simplest servo there is: each joint is where its command was some time ago, to a scale and an offset."""
    latest = min(_LATEST_S, 0.25 * min(float(t.time[-1]) for t in trials))
    step = max(float(np.median(np.diff(trials[0].time))), _STEP_S)
    begin = [list(np.arange(0.0, latest + 0.5 * step, step)[:, None])] * trials[0].command.shape[1]
    coarse = _fit_filters(trials, begin, _RIDGES[:1])
    nearby = step / _FINER * np.arange(1 - _FINER, _FINER)
    fine = [[np.array([near + by]) for by in nearby if near + by >= 0.0] for near in coarse.length_s]
    return _fit_filters(trials, fine, _RIDGES[:1])


def fit_fir(trials: Sequence[EvenTrial]) -> LinearFilter:
    """Filters by ridge regression, of a length and a ridge that suit best."""
    period, shortest = float(np.median(np.diff(trials[0].time))), min(len(t.time) for t in trials)
    lengths = sorted({min(max(1, round(s / period)), shortest // 4) for s in _LENGTHS_S})
    tried = [np.asarray(period * np.arange(0, n + 1, max(1, -(-n // _TAPS)))) for n in lengths]
    return _fit_filters(trials, [tried] * trials[0].command.shape[1], _RIDGES)


def _fit_filters(
    trials: Sequence[EvenTrial], choices: Sequence[Sequence[Array]], ridges: Sequence[float]
) -> LinearFilter:
    """Of each joint's choices of lags, and of ridges, those that leave least of trials left out in turn."""
    thin = max(1, sum(len(t.time) for t in trials) // _ROWS)
    rows = [(t, np.arange(0, len(t.time), thin)) for t in trials]
    if len(rows) == 1:
        rows = [(trials[0], part) for part in np.array_split(rows[0][1], _PARTS)]

    def try_filters(j: int) -> Iterator[tuple[float, Array, Array]]:
        for lags in choices[j]:
            made = [np.column_stack([_tap_columns(t, j, lags, r), t.position[r, j]]) for t, r in rows]
            parts = np.array([x.T @ x for x in made])
            for ridge in ridges:
                both = (np.append(_ridge_solution(parts.sum(axis=0) - part, ridge), -1.0) for part in parts)
                left = sum(float(x @ part @ x) for x, part in zip(both, parts, strict=True))
                yield left, lags, _ridge_solution(parts.sum(axis=0), ridge)

    best = [min(try_filters(j), key=lambda item: item[0]) for j in range(len(choices))]
    return LinearFilter(tuple(lags for _, lags, _ in best), tuple(weights for *_, weights in best))


def _ridge_solution(products: Array, ridge: float) -> Array:
    """Weights and offset ``(n_taps + 1,)`` from products of taps, one and positions."""
    normal, n = products[:-1, :-1].copy(), len(products) - 2
    # A joint whose command stands has no power, and its taps no weight.
    power = float(np.trace(normal[:n, :n]) - (normal[:n, n] ** 2).sum() / normal[n, n]) / n
    normal[np.arange(n), np.arange(n)] += ridge * max(power, 0.0) + 1e-12 * (1.0 + normal[n, n])
    return np.asarray(np.linalg.solve(normal, products[:-1, -1]))


def _tap_columns(trial: EvenTrial, joint: int, lags: Array, rows: NDArray[np.intp]) -> Array:
    """Earlier commands and one, ``(n_rows, n_taps + 1)``; before a trial its first one held."""
    earlier = np.interp(trial.time[rows, None] - lags, trial.time, trial.command[:, joint])
    return np.column_stack([earlier, np.ones(len(rows))])


# The trivial neighbours of a diagnosis' held-out figures: of positions that follow commands, and of torques.


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
    command = _judged_rms(trials, [t.command for t in trials])
    delayed, filtered = (_judged_rms(trials, [p.predict_positions(t) for t in trials]) for p in (late, fir))
    repeat = _repeat_rms(
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
            unit="m" if is_sliding_joint(robot, name) else "rad",
            delay_s=float(late.length_s[j]),
            fir_s=float(fir.length_s[j]),
        )
        for j, name in enumerate(joints)
    }


def of_torques(samples: ArmSamples, after: Array) -> dict[str, TrivialErrors]:
    """What one trial's torques say of another's with the same command, by joint; no more where torques are judged.

    Args:
        after: ``(n_joints, n_rows)`` what the model leaves [N·m].
    """
    measured = samples.to_rows(samples.stack_trials("measured_torque"))
    trials = samples.trials
    judge = samples.judging_rows
    rows = [np.flatnonzero(samples.trial_of_row == k) for k in range(len(trials))]
    repeat = _repeat_rms(
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


def _judged_rms(trials: Sequence[EvenTrial], predicted: Sequence[Array]) -> Array:
    """RMS over all rows that judge, ``(n_joints,)``."""
    left = [(p - t.position)[t.judges] for p, t in zip(predicted, trials, strict=True)]
    return np.asarray(np.sqrt((np.concatenate(left) ** 2).mean(axis=0)))


def _repeat_rms(
    trials: Sequence[Commanded],
    times: Sequence[Array],
    values: Sequence[Array],
    judges: Sequence[NDArray[np.bool_]],
) -> Array | None:
    """Mean over pairs of trials with one command of the RMS of their difference, ``(n_channels,)``.

    Each pair with a trial that judges counts on the rows that do; where no such trial was run twice, all pairs.
    """
    pairs = find_repeated_commands(trials)
    both = [*pairs, *(Repeat(pair.again, pair.first, -pair.lag_s) for pair in pairs)]
    told = [_repeat_difference(pair, times, values, judges) for pair in both]
    if not any(len(item) for item in told):
        told = [_repeat_difference(pair, times, values) for pair in pairs]
    each = [np.sqrt((item**2).mean(axis=0)) for item in told if len(item)]
    return np.mean(each, axis=0) if each else None
