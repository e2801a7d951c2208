"""Roll-outs of validation trials with the simulator as it was and with the effects in it, against the record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter1d

from excite.atomic import write_text
from excite.diagnosis.attribute import Attribution, Scored
from excite.diagnosis.augmented import augmented_model, baseline_model
from excite.diagnosis.augmented_effects import Found
from excite.diagnosis.baseline import Baseline
from excite.diagnosis.effects.deflection import link_inertia
from excite.diagnosis.effects.effect import Context
from excite.diagnosis.result import Rollout
from excite.diagnosis.rollout import Drive, LoggedTorque, Simulator, Window
from excite.diagnosis.samples import ArmSamples, ArmTrial
from excite.errors import InputError
from excite.logs.signals.butterworth import lowpass
from excite.logs.signals.differentiate import central_differences
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Array

MODEL = "augmented.xml"
HORIZON_S = 0.5
_TOTAL_S = 16.0
_STEP_S = 1.25e-3
_START_HZ = 10.0
_EDGE_S = 0.3
_SMOOTH = 201


def simulated(attribution: Attribution, baseline: Baseline, out: Path | None) -> Rollout:
    """Roll-outs before and after the accepted effects; the augmented model is written where there is a folder."""
    try:
        rollout, xml = compared(attribution, baseline)
    except InputError as error:
        # A joint that no simulator has, or a log that leaves joints out, is no reason to say nothing else.
        return Rollout({}, {}, HORIZON_S, None, warnings=(f"no roll-outs: {error}",))
    if out is None:
        return rollout
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / MODEL, xml)
    return replace(rollout, model=MODEL)


def compared(attribution: Attribution, baseline: Baseline, plan: Plan | None = None) -> tuple[Rollout, str]:
    """Roll-outs before and after the accepted effects, and the model's text.

    Every roll-out starts from the record's positions and velocities. By default it runs for half a second with
    the logged torques and no feedback, which would hide the gap.

    Args:
        attribution: the attribution.
        baseline: the baseline before it.
        plan: horizon and drives, where they are others.

    Returns:
        The comparison, its model not written, and the augmented model.
    """
    if len(baseline.samples.joints) < baseline.samples.robot.n_joints:
        raise InputError(
            "some joints of the robot have no torque in the log",
            field="joints",
            remedy="log them all, or give a model without them",
        )
    effects, final = found_effects(attribution), refitted(attribution, baseline)
    before = baseline_model(baseline)
    after = augmented_model(final, effects) if effects else before
    samples = baseline.samples
    plan = replace(plan or torque_plan(samples), growth=_growth(attribution))
    plain = errors(before.xml, samples, baseline.rigid, plan)
    augmented = errors(after.xml, samples, final.rigid, plan) if effects else plain
    warnings = (*after.warnings, *unheard(final, effects, after.xml, plan))
    return (
        Rollout(
            before=_rms(plain, samples.joints),
            after=_rms(augmented, samples.joints),
            horizon_s=plan.horizon_s,
            model=None,
            driven_by=plan.driven_by,
            warnings=warnings,
        ),
        after.xml,
    )


def refitted(attribution: Attribution, baseline: Baseline) -> Baseline:
    """The baseline with inertial parameters and drive terms as fitted together with all accepted effects."""
    final, s = attribution.final, baseline.samples
    n = baseline.basis.shape[1]
    phi = baseline.phi + baseline.basis @ (final.fit.shared[:n] - baseline.fit.shared)
    motion = (s.stacked(name) for name in ("q", "v", "a"))
    rigid = inverse_dynamics(s.robot.model, *motion, phi)[:, list(s.index)]
    return replace(final, phi=phi, rigid=rigid)


def found_effects(attribution: Attribution) -> tuple[Found, ...]:
    """The accepted effects with their sizes as fitted all together."""
    last, place, made = attribution.final, 0, []
    columns = last.solver.equations.shared
    first = attribution.stages[0].context.baseline.basis.shape[1]
    for item in attribution.accepted:
        extra = item.hypothesis.columns.extra
        count = 0 if extra is None else extra.shape[2]
        here = slice(first + place, first + place + count)
        beta = item.hypothesis.fit.extra
        if extra is not None:
            scale = np.linalg.norm(columns[:, :, here], axis=(0, 1)) / np.linalg.norm(extra, axis=(0, 1))
            beta = last.fit.shared[here] * scale
        place += count
        made.append(_found(item, beta))
    return tuple(made)


def _growth(attribution: Attribution) -> dict[str, list[Array]]:
    """How far friction that drifts has come at every sample, by joint: its Coulomb column over the sign of motion."""
    grown = {}
    for item in attribution.accepted:
        if item.name != "friction_drift":
            continue
        h = item.hypothesis
        context = Context(h.baseline)
        j = context.row(item.location)
        columns = h.effect.shape(context, item.location, h.theta).columns[j]
        made = []
        for column, unit in zip(columns.T, (context.sign(j), context.v[:, j]), strict=True):
            parts = zip(*(h.baseline.samples.split(x) for x in (column * unit, unit**2)), strict=True)
            made = [
                uniform_filter1d(a, _SMOOTH) / np.maximum(uniform_filter1d(b, _SMOOTH), 1e-12)
                for a, b in parts
            ]
            if column.any():
                break
        grown[item.location] = made
    return grown


def _found(item: Scored, beta: Array) -> Found:
    h = item.hypothesis
    context = Context(h.baseline)
    fit = replace(h.fit, extra=beta)
    values = {name: e.value for name, e in h.effect.estimates(context, h.location, h.theta, fit).items()}
    values |= {p.name: float(b) for p, b in zip(h.effect.linear, beta, strict=True)}
    values |= {p.name: float(t) for p, t in zip(h.effect.searched, h.theta, strict=True)}
    if item.name == "joint_elasticity":
        inertia = float(link_inertia(context, context.row(h.location)).mean())
        values["damping"] = 2.0 * values["damping_ratio"] * float(np.sqrt(values["stiffness"] * inertia))
    if item.name == "friction_drift":
        values["session_end"] = float(context.session.max())
    return Found(item.name, item.location, values)


@dataclass(frozen=True, eq=False)
class Plan:
    """How roll-outs are run.

    Attributes:
        horizon_s: length of one [s].
        drives: by name of the trial, where its torques come from.
        driven_by: the same in words.
        total_s: simulated time at most: roll-outs are spread evenly over longer records [s].
        growth: by joint, how far friction that drifts has come, one ``(n,)`` a trial.
    """

    horizon_s: float
    drives: dict[str, Drive]
    driven_by: str
    total_s: float = _TOTAL_S
    growth: Mapping[str, list[Array]] = field(default_factory=dict)


def torque_plan(samples: ArmSamples) -> Plan:
    """Half a second with the logged torques."""
    drives: dict[str, Drive] = {t.name: LoggedTorque(t.time, t.tau) for t in samples.trials}
    return Plan(HORIZON_S, drives, "logged torque")


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
    """Windows of the validation trials, of all trials where there are none.

    Args:
        samples: the samples.
        rigid: ``(n_samples, n_joints)`` torque of the rigid bodies, for the deflection of gears [N·m].
        plan: horizon and drives.
    """
    loads = samples.split(rigid)
    outside = [k for k, t in enumerate(samples.trials) if not t.identification]
    chosen = outside or list(range(len(samples.trials)))
    n = round(plan.horizon_s * samples.rate_hz)
    edge = round(_EDGE_S * samples.rate_hz)
    starts = [(k, i) for k in chosen for i in range(edge, len(samples.trials[k].time) - edge - n, n)]
    most = max(1, int(plan.total_s / plan.horizon_s))
    pick = np.unique(np.linspace(0, len(starts) - 1, min(most, len(starts))).round().astype(int))
    smooth = {k: _smooth(samples, samples.trials[k]) for k in chosen}
    return [
        _piece(samples, samples.trials[k], smooth[k], loads[k], i, n, plan)
        for k, i in (starts[p] for p in pick)
    ]


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
    steps = t0 + step * np.arange(n * keep)
    window = Window(smooth[0][i], v, load[i], steps, float(trial.session_s[i]), growth)
    recorded = trial.q[i : i + n + 1][:, list(samples.index)]
    return Piece(window, plan.drives[trial.name], recorded, keep)


def errors(xml: str, samples: ArmSamples, rigid: Array, plan: Plan) -> Array:
    """Simulated less recorded positions, ``(n_windows, n_kept, n_joints)`` [rad]."""
    simulator = Simulator(xml, samples.joints)
    return np.array(
        [simulator.run(p.window, p.drive, p.keep) - p.recorded for p in pieces(samples, rigid, plan)]
    )


def unheard(baseline: Baseline, effects: Sequence[Found], xml: str, plan: Plan) -> tuple[str, ...]:
    """Effects that the written model, loaded again, ignores: half as large again, they move no roll-out."""
    samples = baseline.samples
    few = pieces(samples, baseline.rigid, replace(plan, horizon_s=HORIZON_S, total_s=3.0 * HORIZON_S))
    said = []
    here = Simulator(xml, samples.joints)
    runs = [here.run(p.window, p.drive, p.keep) for p in few] if effects else []
    for k, item in enumerate(effects):
        bigger = replace(item, values={n: 1.5 * v for n, v in item.values.items()})
        other = augmented_model(baseline, [*effects[:k], bigger, *effects[k + 1 :]])
        moved = Simulator(other.xml, samples.joints)
        change = max(
            float(np.abs(moved.run(p.window, p.drive, p.keep) - r).max())
            for p, r in zip(few, runs, strict=True)
        )
        if not change > 0.0:
            said.append(f"the simulator ignores {item.effect} at {item.location}")
    return tuple(said)


def _rms(error: Array, joints: Sequence[str]) -> dict[str, float]:
    values = np.sqrt((error**2).mean(axis=(0, 1)))
    return {name: float(v) for name, v in zip(joints, values, strict=True)}
