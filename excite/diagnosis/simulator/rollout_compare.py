"""Roll-outs of validation trials with the simulator as it was and with the effects in it, against the record."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.atomic import write_text
from excite.diagnosis.answer.answer import Rollout
from excite.diagnosis.answer.gap import RolloutPath
from excite.diagnosis.attribution import Attribution
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.noise_floor import white_floor
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.simulator.augmented_plant import (
    MODEL,
    AugmentedModel,
    augmented_model,
    describe_left_out,
    found_effects,
    initial_states,
)
from excite.diagnosis.simulator.rollout import HORIZON_S, Drive, Piece, Plan, Simulator, cut_pieces
from excite.errors import InputError
from excite.logs.signals.butterworth import lowpass, noise_bandwidth
from excite.logs.signals.spectrum import welch_spectrum
from excite.progress import step

# Simulated time on identification trials, where it is decided whether the effects help at all [s].
_CHECKED_S = 8.0
_SEGMENT_S = 1.28


@dataclass(frozen=True, eq=False)
class Comparison:
    """Roll-outs before and after effects.

    Attributes:
        rollout: their errors; the model is not written.
        xml: the model with the effects that help.
        kept: how many of the accepted effects, the first ones, are in it.
        spans: where they lie: a trial's name, first and last instant after its start [s].
        errors: without and with the effects (all accepted ones where the plan asks for these, else the kept):
            simulated less recorded positions,
            ``(n_windows, n_kept, n_joints)`` each [rad]; None where there are no effects.
    """

    rollout: Rollout
    xml: str
    kept: int
    spans: tuple[tuple[str, float, float], ...]
    errors: tuple[Array, Array] | None = None

    def write_model(self, out: Path | None) -> Rollout:
        """The errors, once the model is written to a folder; without one, as they are."""
        if out is None:
            return self.rollout
        out.mkdir(parents=True, exist_ok=True)
        write_text(out / MODEL, self.xml)
        return replace(self.rollout, model=MODEL)


@step("roll out in the simulator")
def simulate_effects(attribution: Attribution, out: Path | None) -> Rollout:
    """Roll-outs before and after the accepted effects; the augmented model is written where there is a folder.

    Each runs for half a second with the logged torques and no feedback, which would hide the gap.
    """
    drives = {t.name: Drive(t.time, t.measured_torque) for t in attribution.baseline.samples.trials}
    try:
        return compare_rollouts(attribution, Plan(HORIZON_S, drives, "logged torque")).write_model(out)
    except InputError as error:
        # A joint that no simulator has, or a log that leaves joints out, is no reason to say nothing else.
        return Rollout({}, {}, HORIZON_S, None, warnings=(f"no roll-outs: {error}",))


def compare_rollouts(attribution: Attribution, plan: Plan) -> Comparison:
    """Roll-outs before and after the accepted effects, each from the record's positions and velocities.

    Effects that bring the roll-outs of the identification trials no nearer to the record are left out of the model, the
    last accepted first, and a warning says so.

    Args:
        plan: horizon and drives.

    Raises:
        InputError: the log or the model gives no roll-outs, or those of the nominal simulator diverge.
    """
    baseline, effects = attribution.baseline, found_effects(attribution)
    samples = baseline.samples
    if samples.is_coupled:
        raise InputError(
            "motors turn with several joints, and the simulator's turn with one",
            field="coupling",
            remedy="judge by the torques",
        )
    if len(samples.joints) < samples.robot.n_joints:
        raise InputError(
            "some joints of the robot have no torque in the log",
            field="joints",
            remedy="log them all, or give a model without them",
        )
    told = initial_states(attribution)
    plan = replace(
        plan,
        growth={place: state.growth for place, state in told if state.growth is not None},
        deflections={place: state.deflection for place, state in told if state.deflection is not None},
    )

    @cache
    def with_first(count: int) -> tuple[AugmentedModel, Array]:
        """The model with the first effects, and the torque that its gears carry."""
        beside = attribution.baseline_at(count)
        return augmented_model(beside, effects[:count]), beside.rigid

    def errors_with(count: int, plan: Plan) -> Array:
        model, rigid = with_first(count)
        return rollout_errors(model.xml, samples, rigid, plan)

    plain = errors_with(0, plan)
    if not np.isfinite(plain).all():
        raise InputError("roll-outs of the nominal simulator diverge", remedy="judge by the torques")
    check = replace(plan, fitted=True, total_s=min(plan.total_s, _CHECKED_S))
    left = cache(lambda count: (errors_with(count, check) ** 2).mean(axis=(0, 1)))
    kept = next(
        (
            n
            for n in range(len(effects), 0, -1)
            if _is_nearer(left(n), left(0))
            and _is_nearer(left(n), left(n - 1), plan.least_gain if n > 1 else 0.0)
        ),
        0,
    )
    after = errors_with(kept, plan) if kept else plain
    every = errors_with(len(effects), plan) if plan.all_effects and kept < len(effects) else after
    model, rigid = with_first(kept)
    dropped = effects[kept:]
    warnings = (
        *model.warnings,
        *(e.reason_of_absence for e in dropped if e.reason_of_absence is not None),
        *describe_left_out(
            [f"{e.effect.name} at {e.location}" for e in dropped if e.reason_of_absence is None]
        ),
    )
    pieces = cut_pieces(samples, rigid, plan)
    rollout = Rollout(
        before=_joint_rms(plain, samples.joints),
        after=_joint_rms(after, samples.joints),
        horizon_s=plan.horizon_s,
        model=None,
        driven_by=plan.driven_by,
        warnings=warnings,
        floor=_joint_rms(_replica_errors(with_first(0)[0].xml, baseline, plan) - plain, samples.joints),
        path=_rollout_path(samples, pieces, plain, after),
    )
    spans = tuple((samples.trials[p.trial].name, *_piece_times(samples, p)) for p in pieces)
    return Comparison(rollout, model.xml, kept, spans, (plain, every) if effects else None)


def _is_nearer(after: Array, before: Array, gain: float = 0.0) -> bool:
    """Whether squared errors ``(n_joints,)`` are smaller, on some joint by a share ``gain`` of them.

    In all, and relative to each joint's own error: a joint that moves little counts as well.
    """
    ratio = after / before
    less = after.sum() < before.sum() and float(ratio.mean()) < 1.0
    return bool(less and ratio.min() <= 1.0 - gain)


def rollout_errors(xml: str, samples: ArmSamples, rigid: Array, plan: Plan) -> Array:
    """Simulated less recorded positions, ``(n_windows, n_kept, n_joints)`` [rad]."""
    pieces = cut_pieces(samples, rigid, plan)
    if not pieces:
        raise InputError("no trial is as long as a roll-out", remedy="record trials of some seconds")
    windows, drives = [p.window for p in pieces], [p.drive for p in pieces]
    paths = Simulator(xml, samples.joints).run_all(windows, drives, pieces[0].keep)
    return np.asarray(paths - np.array([p.recorded for p in pieces]))


def _replica_errors(xml: str, baseline: Baseline, plan: Plan) -> Array:
    """Errors of the nominal simulator from a record, and with torques, that have as much noise again."""
    samples, rng = baseline.samples, np.random.default_rng(0)
    rate, band, index = samples.rate_hz, samples.bands.kinematics_hz, list(samples.index)
    passed = np.sqrt(noise_bandwidth(rate, band))
    white = _white_noise(samples) if plan.noise is None else plan.noise / passed
    # Torques of a servo are as noisy as its positions.
    torque = white_floor(samples) / np.sqrt(noise_bandwidth(rate, samples.bands.rows_hz))
    trials, drives = [], {}
    for trial in samples.trials:
        q, drive = trial.q.copy(), plan.drives[trial.name]
        q[:, index] += lowpass(white * rng.standard_normal((len(q), len(index))), rate, band)
        trials.append(replace(trial, q=q))
        noise = torque * rng.standard_normal(drive.torque.shape) if drive.kp is None else 0.0
        drives[trial.name] = replace(drive, torque=drive.torque + noise)
    noisy = replace(samples, trials=tuple(trials))
    return rollout_errors(xml, noisy, baseline.rigid, replace(plan, drives=drives))


def _white_noise(samples: ArmSamples) -> Array:
    """Standard deviation of the white noise of positions, ``(n_joints,)`` [rad], from between half and three quarters
    of the filter's cut-off; third differences keep the motion from leaking there."""
    rate, found = samples.rate_hz, []
    cut = min(samples.bands.kinematics_hz, 0.5 * rate)
    length = min(round(_SEGMENT_S * rate), *(len(t.time) // 2 for t in samples.trials))
    for trial in samples.trials:
        changes = np.diff(trial.q[:, list(samples.index)], 3, axis=0)
        frequency, power = welch_spectrum(changes, rate, length, median=True)
        between = (frequency > 0.5 * cut) & (frequency < 0.75 * cut)
        differenced = (2.0 * np.sin(np.pi * frequency[between] / rate)) ** 6
        found.append(np.median(power[between] / differenced[:, None], axis=0))
    return np.asarray(np.sqrt(0.5 * rate * np.median(found, axis=0)))


def _joint_rms(error: Array, joints: Sequence[str]) -> dict[str, float]:
    values = np.sqrt((error**2).mean(axis=(0, 1)))
    return {name: float(v) for name, v in zip(joints, values, strict=True)}


def _piece_times(samples: ArmSamples, piece: Piece) -> tuple[float, float]:
    time = samples.trials[piece.trial].time
    return float(time[piece.first]), float(time[piece.first + len(piece.recorded) - 1])


def _rollout_path(samples: ArmSamples, pieces: Sequence[Piece], before: Array, after: Array) -> RolloutPath:
    """The trial of which most was simulated, for a picture in motion.

    Args:
        pieces: that were simulated.
        before: errors of the nominal simulator, ``(n_windows, n_kept, n_joints)`` [rad].
        after: of the augmented one, likewise.
    """
    chosen = Counter(piece.trial for piece in pieces).most_common(1)[0][0]
    trial = samples.trials[chosen]
    recorded = trial.q[:, list(samples.index)]
    paths = [recorded.copy(), recorded.copy()]
    for piece, *both in zip(pieces, before, after, strict=True):
        if piece.trial == chosen:
            # Of two windows that meet, the last sample is the first one's, which strayed for longest.
            for path, error in zip(paths, both, strict=True):
                path[piece.first + 1 : piece.first + len(error)] += error[1:]
    return RolloutPath(trial.name, samples.joints, trial.time, recorded, *paths)
