"""Sizes of the accepted effects as a simulator needs them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.gears.gear import contact_stiffness, gear_damping
from excite.diagnosis.effects.gears.gear_effect import GearEffect
from excite.diagnosis.search.attribution import Attribution, Scored
from excite.diagnosis.simulator.augmented_effects import Found

_SMOOTH = 201


def found_effects(attribution: Attribution) -> tuple[Found, ...]:
    """The accepted effects with their sizes as fitted all together."""
    sizes = fitted_sizes(attribution)
    return tuple(_found(item, beta) for item, beta in zip(attribution.accepted, sizes, strict=True))


def fitted_sizes(attribution: Attribution) -> tuple[Array, ...]:
    """Linear parameters of each accepted effect, ``(n_linear,)``, as fitted all together."""
    last, place, made = attribution.final, 0, []
    columns = last.solver.equations.shared
    first = attribution.stages[0].context.baseline.basis.shape[1]
    for item in attribution.accepted:
        extra = item.hypothesis.columns.extra
        count = 0 if extra is None else extra.shape[2]
        here = slice(first + place, first + place + count)
        beta = item.hypothesis.fit.extra
        if extra is not None:
            size = np.linalg.norm(extra, axis=(0, 1))
            scale = np.linalg.norm(columns[:, :, here], axis=(0, 1)) / np.where(size > 0.0, size, 1.0)
            beta = last.fit.shared[here] * scale
        place += count
        made.append(beta)
    return tuple(made)


def _found(item: Scored, beta: Array) -> Found:
    h = item.hypothesis
    context = Context(h.baseline)
    fit = replace(h.fit, extra=beta)
    values = {name: e.value for name, e in h.effect.estimates(context, h.location, h.theta, fit).items()}
    values |= {p.name: float(b) for p, b in zip(h.effect.linear, beta, strict=True)}
    values |= {p.name: float(t) for p, t in zip(h.effect.searched, h.theta, strict=True)}
    if item.name == "joint_elasticity":
        ratio = values["damping_ratio"]
        values["damping"] = gear_damping(context, context.row(h.location), values["stiffness"], ratio)
    if "softness" in values:
        j = context.row(h.location)
        values["stiffness"] = contact_stiffness(context, j, values["contact_hz"])
        values["damping"] = gear_damping(context, j, values["stiffness"], 1.0)
    if item.name == "friction_drift":
        trials = h.baseline.samples.trials
        longest = max(float(trial.time[-1]) for trial in trials)
        values["session_end"] = longest if "in_each_trial" in values else float(context.session.max())
    return Found(item.name, item.location, values)


def drift_growth(attribution: Attribution) -> dict[str, list[Array]]:
    """How far friction that drifts has come at every sample, by joint: its Coulomb column over the sign of motion."""
    grown = {}
    for item in attribution.accepted:
        if item.name != "friction_drift":
            continue
        from scipy.ndimage import uniform_filter1d

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


def gear_deflections(attribution: Attribution) -> dict[str, list[Array]]:
    """Deflections of soft and loose gears and their speeds at every sample, by joint, ``(n, 2)`` a trial."""
    found = {}
    for item in attribution.accepted:
        h = item.hypothesis
        if isinstance(h.effect, GearEffect):
            moved = h.effect.deflection(Context(h.baseline), h.location, h.theta)
            found[item.location] = h.baseline.samples.split(moved[:2].T)
    return found
