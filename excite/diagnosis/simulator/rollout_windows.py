"""Which pieces of a record are simulated, and what drives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.simulator.rollout_drives import Drive, LoggedTorque, Past, Window
from excite.diagnosis.simulator.rollout_torques import DrivingTorques, driving_torques
from excite.logs.signals.butterworth import lowpass
from excite.logs.signals.differentiate import central_differences

HORIZON_S = 0.5
_TOTAL_S = 16.0
_STEP_S = 1.25e-3
_START_HZ = 10.0
_EDGE_S = 0.3
_PAST_S = 2.0
# Where torques were beyond their range all pieces without such are simulated, or this share with the fewest.
_KNOWN = 0.25


@dataclass(frozen=True, eq=False)
class Plan:
    """How roll-outs are run.

    Attributes:
        horizon_s: length of one [s].
        drives: by name of the trial, where its torques come from.
        driven_by: the same in words.
        total_s: simulated time at most: roll-outs are spread evenly over longer records [s].
        growth: by joint, how far friction that drifts has come, one ``(n,)`` a trial.
        deflections: by joint, deflection of a soft or loose gear and its speed, one ``(n, 2)`` a trial.
        fitted: simulate the identification trials, not the validation trials.
        torques: what drives them where that is the log's torques.
        least_gain: share of some joint's squared error that each effect after the first has to take away.
        all_effects: whether errors with all effects are wanted where some do not help.
        noise: ``(n_joints,)`` standard deviation of the filtered positions' noise [rad or m]; None where it is unknown.
    """

    horizon_s: float
    drives: dict[str, Drive]
    driven_by: str
    total_s: float = _TOTAL_S
    growth: Mapping[str, list[Array]] = field(default_factory=dict)
    deflections: Mapping[str, list[Array]] = field(default_factory=dict)
    fitted: bool = False
    torques: DrivingTorques | None = None
    least_gain: float = 0.0
    all_effects: bool = False
    noise: Array | None = None


def torque_plan(samples: ArmSamples) -> Plan:
    """Half a second with the logged torques."""
    torques = driving_torques(samples)
    drives: dict[str, Drive] = {t.name: LoggedTorque(t.time, torques.torque[t.name]) for t in samples.trials}
    how = "logged torque, smoothed by what the commands tell of it" if torques.smoothed else "logged torque"
    return Plan(HORIZON_S, drives, how, torques=torques)


@dataclass(frozen=True, eq=False)
class Piece:
    """A window with the torques that drive it and the positions that were recorded.

    Attributes:
        window: where it starts.
        drive: what drives it.
        recorded: ``(n_kept, n_joints)`` [rad].
        keep: steps between recorded positions.
    """

    window: Window
    drive: Drive
    recorded: Array
    keep: int


def pieces(samples: ArmSamples, rigid: Array, plan: Plan) -> list[Piece]:
    """Windows of the trials that the plan asks for, of all trials where there are no such ones.

    Args:
        samples: the samples.
        rigid: ``(n_samples, n_joints)`` torque that the gears carry, for their deflection [N·m].
        plan: horizon and drives.
    """
    loads, starts = samples.split(rigid), _starts(samples, plan)
    n = round(plan.horizon_s * samples.rate_hz)
    smooth = {k: _smooth(samples, samples.trials[k]) for k in {k for k, _ in starts}}
    return [_piece(samples, samples.trials[k], smooth[k], loads[k], i, n, plan) for k, i in starts]


def spans(samples: ArmSamples, plan: Plan) -> tuple[tuple[str, float, float], ...]:
    """Where the pieces lie: the trial's name, their first and last instant after its start [s]."""
    n = round(plan.horizon_s * samples.rate_hz)
    trials = samples.trials
    return tuple(
        (trials[k].name, float(trials[k].time[i]), float(trials[k].time[i + n]))
        for k, i in _starts(samples, plan)
    )


def _starts(samples: ArmSamples, plan: Plan) -> list[tuple[int, int]]:
    """Index of the trial and of the first sample of every piece."""
    wanted = [k for k, t in enumerate(samples.trials) if t.identification == plan.fitted]
    chosen = wanted or list(range(len(samples.trials)))
    n = round(plan.horizon_s * samples.rate_hz)
    edge = round(_EDGE_S * samples.rate_hz)
    starts = [(k, i) for k in chosen for i in range(edge, len(samples.trials[k].time) - edge - n, n)]
    if any(trial.beyond is not None for trial in samples.trials):
        # Nobody knows what drove the robot where a torque was beyond its range.
        guessed = np.array([_guessed(samples.trials[k], i, n) for k, i in starts])
        starts = (
            [starts[p] for p in np.flatnonzero(guessed <= np.quantile(guessed, _KNOWN))] if starts else starts
        )
    most = max(1, int(plan.total_s / plan.horizon_s))
    pick = np.unique(np.linspace(0, len(starts) - 1, min(most, len(starts))).round().astype(int))
    return [starts[p] for p in pick]


def _guessed(trial: ArmTrial, first: int, n: int) -> float:
    """Share of a piece's samples in which some torque is a guess."""
    return 0.0 if trial.beyond is None else float(trial.beyond[first : first + n + 1].any(axis=1).mean())


def _smooth(samples: ArmSamples, trial: ArmTrial) -> tuple[Array, Array]:
    cut = min(_START_HZ, 0.2 * samples.rate_hz)
    d = central_differences(lowpass(trial.q[:, list(samples.index)], samples.rate_hz, cut), samples.rate_hz)
    return d.value, d.first


def _piece(
    samples: ArmSamples,
    trial: ArmTrial,
    smooth: tuple[Array, Array],
    load: Array,
    i: int,
    n: int,
    plan: Plan,
) -> Piece:
    period = 1.0 / samples.rate_hz
    keep = max(1, int(np.ceil(period / _STEP_S - 1e-9)))
    step = period / keep
    t0 = float(trial.time[i])
    v = np.array([np.interp(t0 - 0.5 * step, trial.time, c) for c in smooth[1].T])
    k = samples.trials.index(trial)
    growth = {joint: float(values[k][i]) for joint, values in plan.growth.items()}
    deflected = {
        joint: (float(values[k][i, 0]), float(np.interp(t0 - 0.5 * step, trial.time, values[k][:, 1])))
        for joint, values in plan.deflections.items()
    }
    steps = np.asarray(t0 + step * np.arange(n * keep), dtype=np.float64)
    before = slice(max(0, i - round(_PAST_S * samples.rate_hz)), i + 1)
    past = Past(trial.time[before], smooth[0][before], trial.v[before][:, list(samples.index)])
    window = Window(smooth[0][i], v, load[i], steps, float(trial.session_s[i]), growth, past, deflected)
    recorded = trial.q[i : i + n + 1][:, list(samples.index)]
    return Piece(window, plan.drives[trial.name], recorded, keep)
