"""Roll-outs of validation trials with the simulator as it was and with the effects in it, against the record."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from excite.arrays import Array
from excite.atomic import write_text
from excite.diagnosis.answer.answer import Rollout
from excite.diagnosis.answer.gap import RolloutPath
from excite.diagnosis.attribution import Attribution
from excite.diagnosis.effects.form import Draft, Form, Noted
from excite.diagnosis.effects.friction import PRESLIDING, BuildUp
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.own_columns import COULOMB
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.simulator.augmented_plant import Plant, physical_plant, plant_with, unphysical
from excite.diagnosis.simulator.model_text import (
    LOUDER,
    MODEL,
    AugmentedModel,
    Found,
    found_effects,
    ignored,
    told_states,
    without,
    write_note,
)
from excite.diagnosis.simulator.rollout import Simulator
from excite.diagnosis.simulator.rollout_windows import (
    HORIZON_S,
    LoggedTorque,
    Piece,
    Plan,
    pieces,
    spans,
    torque_plan,
)
from excite.errors import InputError
from excite.logs.signals.butterworth import lowpass, noise_bandwidth
from excite.logs.signals.spectrum import welch_spectrum
from excite.progress import step
from excite.robot.robot import Robot
from excite.simulation.mjcf import World, build_spec
from excite.simulation.true_parameters import Drives

if TYPE_CHECKING:
    import mujoco

# Simulated time on identification trials, where it is decided whether the effects help at all [s].
_CHECKED_S = 8.0


@dataclass(frozen=True, eq=False)
class Comparison:
    """Roll-outs before and after effects.

    Attributes:
        rollout: their errors; the model is not written.
        xml: the model with the effects that help.
        kept: how many of the accepted effects, the first ones, are in it.
        errors: without and with the effects (all accepted ones where the plan asks for these, else the kept):
            simulated less recorded positions,
            ``(n_windows, n_kept, n_joints)`` each [rad]; None where there are no effects.
    """

    rollout: Rollout
    xml: str
    kept: int
    errors: tuple[Array, Array] | None = None


@step("roll out in the simulator")
def simulated(attribution: Attribution, baseline: Baseline, out: Path | None) -> Rollout:
    """Roll-outs before and after the accepted effects; the augmented model is written where there is a folder."""
    try:
        comparison = compared(attribution, baseline)
    except InputError as error:
        # A joint that no simulator has, or a log that leaves joints out, is no reason to say nothing else.
        return Rollout({}, {}, HORIZON_S, None, warnings=(f"no roll-outs: {error}",))
    if out is None:
        return comparison.rollout
    write_text(out / MODEL, comparison.xml)
    return replace(comparison.rollout, model=MODEL)


def compared(attribution: Attribution, baseline: Baseline, plan: Plan | None = None) -> Comparison:
    """Roll-outs before and after the accepted effects.

    Every roll-out starts from the record's positions and velocities. By default it runs for half a second with
    the logged torques and no feedback, which would hide the gap. Effects that bring the roll-outs of the
    identification trials no nearer to the record are left out of the model, the last accepted first, and a
    warning says so.

    Args:
        attribution: the attribution.
        baseline: the baseline before it.
        plan: horizon and drives, where they are others.

    Returns:
        The comparison.

    Raises:
        InputError: the log or the model gives no roll-outs, or those of the nominal simulator diverge.
    """
    if len(baseline.samples.joints) < baseline.samples.robot.n_joints:
        raise InputError(
            "some joints of the robot have no torque in the log",
            field="joints",
            remedy="log them all, or give a model without them",
        )
    if baseline.samples.coupled:
        raise InputError(
            "motors turn with several joints, and the simulator's turn with one",
            field="coupling",
            remedy="judge by the torques",
        )
    samples, effects = baseline.samples, found_effects(attribution)
    told = told_states(attribution)
    plan = replace(
        plan or torque_plan(samples),
        growth={place: state.growth for place, state in told if state.growth is not None},
        deflections={place: state.deflection for place, state in told if state.deflection is not None},
    )
    before = baseline_model(baseline)
    plain = errors(before.xml, samples, baseline.rigid, plan)
    if not np.isfinite(plain).all():
        raise InputError("roll-outs of the nominal simulator diverge", remedy="judge by the torques")
    helpful = _helpful(attribution, baseline, before, effects, plan)
    after, final, kept = helpful.model, helpful.baseline, helpful.effects
    augmented = errors(after.xml, samples, final.rigid, plan) if kept else plain
    with_all = augmented
    if len(kept) < len(effects) and plan.all_effects:
        with_all = errors(helpful.whole.xml, samples, attribution.final.rigid, plan)
    left = effects[len(kept) :]
    unhelpful = [f"{e.effect.name} at {e.location}" for e in left if e.formless is None]
    unsaid = [e.formless for e in left if e.formless is not None]
    warnings = (*after.warnings, *unheard(final, kept, after.xml, plan), *unsaid, *without(unhelpful))
    rollout = Rollout(
        before=_rms(plain, samples.joints),
        after=_rms(augmented, samples.joints),
        horizon_s=plan.horizon_s,
        model=None,
        driven_by=plan.driven_by,
        warnings=warnings,
        floor=_floor(before.xml, baseline, plan, plain),
        path=rollout_path(samples, plan, plain, augmented),
    )
    return Comparison(rollout, after.xml, len(kept), (plain, with_all) if effects else None)


def _floor(xml: str, baseline: Baseline, plan: Plan, plain: Array) -> dict[str, float]:
    """RMS by which replicas of the nominal simulator differ from it, by joint [rad]."""
    samples, noisy = replicated(baseline.samples, plan, np.random.default_rng(0))
    return _rms(errors(xml, samples, baseline.rigid, noisy) - plain, samples.joints)


@dataclass(frozen=True, eq=False)
class _Helpful:
    """The model with as many effects as help, and the one with all.

    Attributes:
        model: with the effects that help.
        baseline: beside these.
        effects: those.
        whole: the model with all of them.
    """

    model: AugmentedModel
    baseline: Baseline
    effects: tuple[Found, ...]
    whole: AugmentedModel


class _Candidate(NamedTuple):
    """A model, its baseline, and the mean squared errors of its roll-outs ``(n_joints,)`` [rad²]."""

    model: AugmentedModel
    baseline: Baseline
    errors: Array


def _helpful(
    attribution: Attribution,
    baseline: Baseline,
    before: AugmentedModel,
    effects: tuple[Found, ...],
    plan: Plan,
) -> _Helpful:
    """The model with as many effects as bring roll-outs of the identification trials nearer to the record.

    The last of them has to do so as well. With it comes the model that has all of them.
    """
    if not effects:
        return _Helpful(before, baseline, (), before)
    samples, check = baseline.samples, replace(plan, fitted=True, total_s=min(plan.total_s, _CHECKED_S))

    def left(model: AugmentedModel, rigid: Array) -> Array:
        return np.asarray((errors(model.xml, samples, rigid, check) ** 2).mean(axis=(0, 1)))

    @cache
    def made(count: int) -> _Candidate:
        """With the first effects; fewer of them are simulated only where more do not help."""
        if count == 0:
            return _Candidate(before, baseline, left(before, baseline.rigid))
        final = attribution.final if count == len(effects) else attribution.stages[count].context.baseline
        model = augmented_model(final, effects[:count])
        return _Candidate(model, final, left(model, final.rigid))

    whole = made(len(effects)).model
    for count in range(len(effects), 0, -1):
        model, final, most = made(count)
        gain = plan.least_gain if count > 1 else 0.0
        if _nearer(most, made(0).errors) and _nearer(most, made(count - 1).errors, gain):
            return _Helpful(model, final, effects[:count], whole)
    return _Helpful(before, baseline, (), whole)


def _nearer(after: Array, before: Array, gain: float = 0.0) -> bool:
    """Whether squared errors ``(n_joints,)`` are smaller, on some joint by a share ``gain`` of them.

    In all, and relative to each joint's own error: a joint that moves little counts as well.
    """
    ratio = after / before
    less = after.sum() < before.sum() and float(ratio.mean()) < 1.0
    return bool(less and ratio.min() <= 1.0 - gain)


def errors(xml: str, samples: ArmSamples, rigid: Array, plan: Plan) -> Array:
    """Simulated less recorded positions, ``(n_windows, n_kept, n_joints)`` [rad]."""
    few = pieces(samples, rigid, plan)
    if not few:
        raise InputError("no trial is as long as a roll-out", remedy="record trials of some seconds")
    return _paths(Simulator(xml, samples.joints), few) - np.array([piece.recorded for piece in few])


def _paths(simulator: Simulator, few: Sequence[Piece]) -> Array:
    """Simulated positions of pieces, ``(n_pieces, n_kept, n_joints)`` [rad]."""
    return simulator.run_all([p.window for p in few], [p.drive for p in few], few[0].keep)


def unheard(baseline: Baseline, effects: Sequence[Found], xml: str, plan: Plan) -> tuple[str, ...]:
    """Effects that the written model, loaded again, ignores: half as large again, they move no roll-out."""
    samples = baseline.samples
    few = pieces(samples, baseline.rigid, replace(plan, horizon_s=HORIZON_S, total_s=3.0 * HORIZON_S))
    said = []
    if not effects or not few:
        return ()
    here = _paths(Simulator(xml, samples.joints), few)
    for k, item in enumerate(effects):
        if item.formless is not None:
            continue
        bigger = replace(item, values={n: LOUDER * v for n, v in item.values.items()})
        other = augmented_model(baseline, [*effects[:k], bigger, *effects[k + 1 :]])
        # One that diverges of so much of it heeds it too, and what is no number equals nothing.
        if np.array_equal(_paths(Simulator(other.xml, samples.joints), few), here):
            said.append(ignored(item.effect.name, item.location))
    return tuple(said)


def _rms(error: Array, joints: Sequence[str]) -> dict[str, float]:
    values = np.sqrt((error**2).mean(axis=(0, 1)))
    return {name: float(v) for name, v in zip(joints, values, strict=True)}


# The nominal simulator with the accepted effects in it: a MuJoCo model, and notes on what XML cannot say.

_TIMESTEP = 1e-3
_NO_LIMIT = 1e6


def baseline_model(baseline: Baseline) -> AugmentedModel:
    """The simulator without effects: the fitted or trusted baseline."""
    return augmented_model(baseline, ())


def augmented_model(baseline: Baseline, effects: Sequence[Found]) -> AugmentedModel:
    """The simulator with effects.

    Args:
        baseline: the baseline as fitted together with them.
        effects: the effects.

    Returns:
        The model.

    Raises:
        InputError: the robot has joints that cannot be simulated, or MuJoCo refuses the bodies.
    """
    robot = baseline.samples.robot
    joints = baseline.samples.joints
    forms = [item.form(joints) for item in effects]
    wanted = plant_with(baseline, ((item.location, form) for item, form in zip(effects, forms, strict=True)))
    plant = physical_plant(baseline, wanted, _turned(np.array(robot.model.gravity.linear), forms))
    warnings = [said for item in effects if (said := item.formless) is not None]
    warnings += unphysical(plant.mismatch, "residual")
    draft = Draft(joints, _spec(robot, baseline.samples.index, plant))
    draft.spec.option.gravity = _turned(np.array(draft.spec.option.gravity), forms)
    for noted in _presliding(baseline):
        write_note(draft.spec, noted)
    for form in forms:
        if form.elements is not None:
            form.elements(draft)
        for noted in form.notes:
            write_note(draft.spec, noted)
    for form in forms:
        if form.finish is not None:
            form.finish(draft)
    try:
        draft.spec.compile()
    except ValueError as error:
        said = " ".join(str(error).split())
        raise InputError(
            f"MuJoCo refuses the fitted model ({said})", remedy="judge by the torques"
        ) from error
    return AugmentedModel(draft.spec.to_xml(), tuple(warnings))


def _turned(gravity: Array, forms: Sequence[Form]) -> Array:
    """Gravity ``(3,)`` as effects turn it [m/s²]."""
    for form in forms:
        gravity = gravity if form.gravity is None else form.gravity(gravity)
    return gravity


def _presliding(baseline: Baseline) -> list[Noted]:
    """What is noted of the baseline's own friction: where it builds up over a deflection."""
    if not COULOMB.asked(baseline.modelled):
        return []
    noted = []
    for j, (joint, sign) in enumerate(zip(baseline.samples.joints, baseline.signs, strict=True)):
        if sign.bent:
            damped = (baseline.bristle_damping(j), sign.damped_below) if sign.damped else (None, None)
            noted.append(Noted(PRESLIDING, joint, BuildUp(sign.breakaway, *damped)))
    return noted


def _spec(robot: Robot, index: Sequence[int], plant: Plant) -> mujoco.MjSpec:
    """Bodies, friction and rotor inertia, a motor for each joint."""
    n = robot.n_joints

    def all_joints(values: Array) -> Array:
        out = np.zeros(n)
        out[list(index)] = values
        return out

    drives = Drives(
        kp=np.ones(n),
        kd=np.zeros(n),
        torque_limit=np.full(n, _NO_LIMIT),
        viscous=all_joints(plant.viscous),
        coulomb=all_joints(plant.coulomb),
        bearing_viscous=np.zeros(n),
        bearing_coulomb=np.zeros(n),
        armature=all_joints(plant.armature),
        rate_hz=1.0 / _TIMESTEP,
    )
    spec = build_spec(robot, plant.phi, drives, World(timestep=_TIMESTEP))
    bias = all_joints(plant.bias)
    for number, name in enumerate(robot.joint_names):
        motor = spec.actuator(name)
        motor.forcelimited = False
        motor.gainprm[0] = 1.0
        motor.biasprm[:3] = [-bias[number], 0.0, 0.0]
        # Positions are the record's: a range would push where the model's is narrower.
        spec.joint(name).limited = False
    return spec


# What roll-outs of the same simulator differ by: replicas whose start and whose torques are as noisy as the
# log's.

# Noise of filtered positions is seen between these shares of the filter's cut-off, above the motion.
_BETWEEN = (0.5, 0.75)
_SEGMENT_S = 1.28


def position_noise(samples: ArmSamples) -> Array:
    """Standard deviation of the white noise of the positions, ``(n_joints,)`` [rad], as if flat below their band.

    Third differences keep the motion from leaking into the spectrum.
    """
    rate = samples.rate_hz
    low, high = (share * min(samples.bands.kinematics_hz, 0.5 * rate) for share in _BETWEEN)
    length = min(round(_SEGMENT_S * rate), *(len(t.time) // 2 for t in samples.trials))
    found = []
    for trial in samples.trials:
        frequency, power = welch_spectrum(
            np.diff(trial.q[:, list(samples.index)], 3, axis=0), rate, length, median=True
        )
        band = (frequency > low) & (frequency < high)
        differenced = (2.0 * np.sin(np.pi * frequency[band] / rate)) ** 6
        found.append(np.median(power[band] / differenced[:, None], axis=0))
    return np.asarray(np.sqrt(0.5 * rate * np.median(found, axis=0)))


def replicated(samples: ArmSamples, plan: Plan, rng: np.random.Generator) -> tuple[ArmSamples, Plan]:
    """The record and its roll-outs' drives with as much noise again as they have.

    Args:
        samples: the record.
        plan: drives; those that are not the log's torques stay as they are.
        rng: source of the noise.

    Returns:
        Record and plan of the replicas.
    """
    sigma, index = position_noise(samples), list(samples.index)
    rate, band = samples.rate_hz, samples.bands.kinematics_hz
    if plan.noise is not None:
        sigma = plan.noise / np.sqrt(noise_bandwidth(rate, band))
    trials, drives = [], dict(plan.drives)
    for trial in samples.trials:
        drawn = sigma * rng.standard_normal((len(trial.time), len(index)))
        q = trial.q.copy()
        q[:, index] += drawn if plan.noise is None else lowpass(drawn, rate, band)
        trials.append(replace(trial, q=q))
        drive = plan.drives[trial.name]
        if plan.torques is not None and isinstance(drive, LoggedTorque):
            noise = plan.torques.noise(trial, drawn, samples.rate_hz, rng)
            drives[trial.name] = replace(drive, tau=drive.tau + noise)
    return replace(samples, trials=tuple(trials)), replace(plan, drives=drives)


# Roll-outs put back where they lie in a trial, for a picture in motion.


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
