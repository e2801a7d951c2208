"""What far simpler predictors than a simulator reach on the rows that judge it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.answer.gap import TrivialErrors
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.repeats import Moving, lag_of
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.units import force_unit, slides
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


@dataclass(frozen=True)
class Alike:
    """Two trials of one command.

    Attributes:
        first: index of one.
        again: index of the other.
        lag_s: how much later the other runs it [s].
    """

    first: int
    again: int
    lag_s: float


@dataclass(frozen=True, eq=False)
class _Thinned:
    """Some samples of something that moves."""

    time: Array
    q: Array
    v: Array


def alike(trials: Sequence[Commanded]) -> tuple[Alike, ...]:
    """Pairs of trials that say that they repeat each other, or whose commands do."""
    if not trials:
        return ()
    rate = 1.0 / float(np.median(np.diff(trials[0].time)))
    step = max(1, max(len(t.time) for t in trials) // _SAMPLES)
    few = [_Thinned(t.time[::step], t.q[::step], t.v[::step]) for t in trials]
    apart = _apart(few)
    stated = {
        (i, k)
        for i, k in combinations(range(len(trials)), 2)
        if trials[i].name == trials[k].repeats or trials[k].name == trials[i].repeats
    }
    near = (
        pair for pair in combinations(range(len(trials)), 2) if apart[pair] <= _LOOK and pair not in stated
    )
    looked = [*sorted(stated), *sorted(near, key=lambda pair: float(apart[pair]))[:_LOOKS]]
    found: list[Alike] = []
    for i, k in looked:
        if (i, k) in stated or _same(few[i], few[k], lag_of(few[i], few[k], rate / step)):
            found.append(Alike(i, k, lag_of(trials[i], trials[k], rate)))
        if len(found) == _PAIRS:
            break
    return tuple(found)


def _apart(trials: Sequence[Moving]) -> Array:
    """Largest difference of what does not depend on when a logger was started, ``(n_trials, n_trials)``."""
    mean, spread, speed = (
        np.array([f(t) for t in trials])
        for f in (
            lambda t: t.q.mean(axis=0),
            lambda t: t.q.std(axis=0),
            lambda t: t.v.std(axis=0),
        )
    )

    def off(values: Array, scale: Array) -> Array:
        difference = np.abs(values[:, None] - values[None]).sum(axis=2)
        whole = scale.sum(axis=1)
        return np.asarray(difference / np.maximum(np.maximum(whole[:, None], whole[None]), 1e-300))

    return np.maximum(off(mean, spread), np.maximum(off(spread, spread), off(speed, speed)))


def _same(one: Moving, other: Moving, lag: float) -> bool:
    """Whether two commands are one."""
    here = _shared(one.time, other.time, lag)
    if here.sum() < _SHARED * min(len(one.time), len(other.time)):
        return False
    difference = one.q[here] - moved(other.time, other.q, one.time[here] + lag)
    scale = one.q[here].std(axis=0)
    return bool((difference**2).mean() < _SAME**2 * (scale**2).mean())


def _shared(time: Array, other: Array, lag: float) -> NDArray[np.bool_]:
    """Which instants both have, ``(n,)``."""
    return (time + lag >= other[0] - 1e-9) & (time + lag <= other[-1] + 1e-9)


def moved(time: Array, values: Array, instants: Array) -> Array:
    """Values ``(n, k)`` at other instants ``(m,)``, ``(m, k)``."""
    return np.column_stack([np.interp(instants, time, column) for column in values.T])


def difference(
    pair: Alike,
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
    here = _shared(times[pair.first], times[pair.again], pair.lag_s)
    if rows is not None:
        here = here & rows[pair.first]
    other = moved(times[pair.again], values[pair.again], times[pair.first][here] + pair.lag_s)
    return values[pair.first][here] - other


def turned(pair: Alike) -> Alike:
    """The same pair, seen from the other."""
    return Alike(pair.again, pair.first, -pair.lag_s)


# The simplest servo there is: each joint is where its command was some time ago, to a scale and an offset.

# What follows its command later than this is no servo [s]; so fine is the first search [s], and so many times finer the
# second.
_LATEST_S, _STEP_S, _FINER = 0.5, 0.005, 10
# Rows enough to fit three numbers a joint on.
_DELAYED_COMMAND_ROWS = 20_000


@dataclass(frozen=True, eq=False)
class DelayedCommand:
    """``q_j(t) = scale_j q_cmd_j(t − delay_j) + offset_j``.

    Attributes:
        delay_s: ``(n_joints,)`` [s].
        scale: ``(n_joints,)``.
        offset: ``(n_joints,)`` [rad or m].
    """

    delay_s: Array
    scale: Array
    offset: Array

    def predicted(self, trial: EvenTrial) -> Array:
        """Positions ``(n, n_joints)`` [rad or m]."""
        columns = zip(trial.command.T, self.delay_s, strict=True)
        late = [np.interp(trial.time - delay, trial.time, column) for column, delay in columns]
        return np.column_stack(late) * self.scale + self.offset


def fit_delayed_command(trials: Sequence[EvenTrial]) -> DelayedCommand:
    """The delay, scale and offset of each joint with the least squared error on these trials."""
    rows = sum(len(t.time) for t in trials)
    thin = max(1, rows // _DELAYED_COMMAND_ROWS)
    shortest = min(float(t.time[-1]) for t in trials)
    period = float(np.median(np.diff(trials[0].time)))
    step = max(period, _STEP_S)
    found = []
    for j in range(trials[0].command.shape[1]):
        coarse = np.arange(0.0, min(_LATEST_S, 0.25 * shortest) + 0.5 * step, step)
        best = min((_fitted(trials, j, float(delay), thin) for delay in coarse), key=lambda x: x.error)
        fine = best.delay + step / _FINER * np.arange(1 - _FINER, _FINER)
        tried = (_fitted(trials, j, float(delay), thin) for delay in fine if delay >= 0.0)
        found.append(min(tried, key=lambda x: x.error))
    _, delay, scale, offset = np.array(found).T
    return DelayedCommand(delay, scale, offset)


class _Fitted(NamedTuple):
    """Mean squared error, delay, scale and offset of a joint."""

    error: float
    delay: float
    scale: float
    offset: float


def _fitted(trials: Sequence[EvenTrial], joint: int, delay: float, thin: int) -> _Fitted:
    """The fit of a joint at a delay."""
    late = np.concatenate([np.interp(t.time[::thin] - delay, t.time, t.command[:, joint]) for t in trials])
    here = np.concatenate([t.position[::thin, joint] for t in trials])
    x, y = late - late.mean(), here - here.mean()
    power = float(x @ x)
    scale = float(x @ y) / power if power > 0.0 else 0.0
    left = float(((y - scale * x) ** 2).mean())
    return _Fitted(left, float(delay), scale, float(here.mean() - scale * late.mean()))


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
    rate = common_rate(log)
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


def common_rate(log: Log) -> float:
    """The rate that all trials are brought to [Hz]."""
    return float(np.median([trial_rate(log.header, trial) for trial in log.trials]))


# A linear filter of finite response from each joint's command to its position.

# Lengths that are tried [s]: from a stiff servo's to that of one which sways.
_LENGTHS_S = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8)
# Taps at most; between those of a long filter lie samples that are left out.
_TAPS = 40
# Ridges that are tried, relative to the mean power of the taps: commands have little above their band, and what taps
# do there is noise.
_RIDGES = (1e-8, 1e-6, 1e-4, 1e-2)
_ROWS = 20_000
# Parts of a lone trial, each left out once.
_PARTS = 4


@dataclass(frozen=True, eq=False)
class JointFir:
    """``q(t) = offset + Σ_k weight_k q_cmd(t − lags_k)`` of one joint.

    Attributes:
        lags: ``(n_taps,)`` [samples].
        weights: ``(n_taps,)``.
        offset: [rad or m].
    """

    lags: NDArray[np.intp]
    weights: Array
    offset: float

    def predicted(self, command: Array) -> Array:
        """Positions ``(n,)`` from a command ``(n,)`` [rad or m]."""
        return _taps(command, self.lags, np.arange(len(command))) @ self.weights + self.offset


@dataclass(frozen=True, eq=False)
class Fir:
    """One filter a joint.

    Attributes:
        joints: the filters.
        period_s: between samples [s].
    """

    joints: tuple[JointFir, ...]
    period_s: float

    def predicted(self, trial: EvenTrial) -> Array:
        """Positions ``(n, n_joints)`` [rad or m]."""
        return np.column_stack([f.predicted(c) for f, c in zip(self.joints, trial.command.T, strict=True)])

    @property
    def length_s(self) -> Array:
        """Length of each joint's filter, ``(n_joints,)`` [s]."""
        return np.array([f.lags[-1] * self.period_s for f in self.joints])


def fit_fir(trials: Sequence[EvenTrial]) -> Fir:
    """Filters by ridge regression, their length and ridge chosen by what is left out of these trials in turn."""
    period = float(np.median(np.diff(trials[0].time)))
    shortest = min(len(t.time) for t in trials)
    lengths = sorted({min(max(1, round(s / period)), shortest // 4) for s in _LENGTHS_S})
    folds = _folds(trials)
    joints = range(trials[0].command.shape[1])
    return Fir(tuple(_joint(trials, j, lengths, folds) for j in joints), period)


def _folds(trials: Sequence[EvenTrial]) -> list[list[NDArray[np.intp]]]:
    """Rows of each trial that are left out together: whole trials, parts of a lone one."""
    thin = max(1, sum(len(t.time) for t in trials) // _ROWS)
    rows = [np.arange(0, len(t.time), thin) for t in trials]
    if len(rows) == 1:
        return [[part] for part in np.array_split(rows[0], _PARTS)]
    none = np.zeros(0, dtype=np.intp)
    return [[r if k == i else none for k, r in enumerate(rows)] for i in range(len(rows))]


@dataclass(frozen=True, eq=False)
class _Moments:
    """Sums over rows of products of taps, one, and positions."""

    products: Array
    count: int

    def solved(self, ridge: float) -> Array:
        """Weights and offset ``(n_taps + 1,)``."""
        normal, right = self.products[:-1, :-1].copy(), self.products[:-1, -1]
        n = len(normal) - 1
        mean = normal[:n, -1] / self.count
        power = float(np.trace(normal[:n, :n])) / n - self.count * float((mean**2).mean())
        # A joint whose command stands has no power, and its taps no weight.
        normal[np.arange(n), np.arange(n)] += ridge * max(power, 0.0) + 1e-12 * (1.0 + normal[n, n])
        return np.asarray(np.linalg.solve(normal, right))

    def error(self, weights: Array) -> float:
        """Sum of the squared errors of weights."""
        both = np.append(weights, -1.0)
        return float(both @ self.products @ both)


def _joint(
    trials: Sequence[EvenTrial], joint: int, lengths: Sequence[int], folds: list[list[NDArray[np.intp]]]
) -> JointFir:
    best: tuple[float, JointFir] | None = None
    for length in lengths:
        lags = np.arange(0, length + 1, max(1, -(-length // _TAPS)), dtype=np.intp)
        parts = [_moments(trials, joint, lags, rows) for rows in folds]
        products = np.sum([p.products for p in parts], axis=0)
        whole = _Moments(products, sum(p.count for p in parts))
        rest = [_Moments(whole.products - p.products, whole.count - p.count) for p in parts]
        for ridge in _RIDGES:
            left = sum(p.error(r.solved(ridge)) for p, r in zip(parts, rest, strict=True))
            if best is None or left < best[0]:
                weights = whole.solved(ridge)
                best = left, JointFir(lags, weights[:-1], float(weights[-1]))
    if best is None:
        raise ValueError("no length was tried")
    return best[1]


def _moments(
    trials: Sequence[EvenTrial], joint: int, lags: NDArray[np.intp], rows: list[NDArray[np.intp]]
) -> _Moments:
    made = []
    for trial, here in zip(trials, rows, strict=True):
        taps = _taps(trial.command[:, joint], lags, here)
        made.append(np.column_stack([taps, np.ones(len(here)), trial.position[here, joint]]))
    stacked = np.concatenate(made)
    return _Moments(stacked.T @ stacked, len(stacked))


def _taps(command: Array, lags: NDArray[np.intp], rows: NDArray[np.intp]) -> Array:
    """Earlier commands ``(n_rows, n_taps)``; before a trial its first one held."""
    return command[np.maximum(rows[:, None] - lags, 0)]


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
