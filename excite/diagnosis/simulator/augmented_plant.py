"""Inertial parameters and drive terms that a simulator accepts, as near to a fit as its rows can tell."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.form import Form
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.friction_sign import sign_of_motion
from excite.diagnosis.equations.known_drives import known_terms
from excite.diagnosis.equations.own_columns import ARMATURE, CONSTANT, COULOMB, VISCOUS, OwnTerm, own_terms
from excite.diagnosis.simulator.physical_bodies import PhysicalBodies, nearest_bodies
from excite.regressor.kernels import joint_torque_regressor
from excite.robot.links import carried_link

_ROWS = 500


@dataclass(frozen=True, eq=False)
class Plant:
    """A rigid-body arm with friction and rotor inertia.

    Attributes:
        phi: ``(10·n_segments,)`` inertial parameters, every segment a physical body.
        viscous: ``(n_joints,)`` viscous friction [N·m·s/rad], not negative.
        coulomb: ``(n_joints,)`` Coulomb friction [N·m], not negative.
        armature: ``(n_joints,)`` rotor inertia [kg·m²], not negative.
        bias: ``(n_joints,)`` constant of the torque channels [N·m].
        mismatch: RMS over rows and joints of the torque by which it differs from the fit, each joint in units of
            the fit's own residual.
    """

    phi: Array
    viscous: Array
    coulomb: Array
    armature: Array
    bias: Array
    mismatch: float = 0.0


def fitted_plant(baseline: Baseline) -> Plant:
    """The plant as fitted: possibly no physical one."""
    terms = own_terms(baseline.modelled)
    values = np.array([o[: len(terms)] for o in baseline.fit.own]).reshape(baseline.n_joints, len(terms))

    def of(term: OwnTerm) -> Array:
        return values[:, terms.index(term)] if term in terms else np.zeros(len(values))

    known = {item.term: item.values for item in known_terms(baseline.samples, baseline.modelled)}
    viscous, coulomb, armature = (of(term) + known.get(term, 0.0) for term in (VISCOUS, COULOMB, ARMATURE))
    return Plant(baseline.phi, viscous, coulomb, armature, of(CONSTANT))


def plant_with(baseline: Baseline, forms: Iterable[tuple[str, Form]]) -> Plant:
    """The plant as fitted, with the bodies and drives of effects.

    A torque channel's factor is told from the bodies' torque; what is its joint's alone was fitted to readings.

    Args:
        baseline: the baseline as fitted together with the effects.
        forms: places and forms of the effects.

    Returns:
        The plant, possibly no physical one.
    """
    plant, several = fitted_plant(baseline), tuple(forms)
    factor = np.ones(baseline.n_joints)
    for location, form in several:
        if form.reads != 1.0:
            factor[baseline.samples.joints.index(location)] *= form.reads
    drives = {name: getattr(plant, name) / factor for name in ("viscous", "coulomb", "armature")}
    plant = replace(plant, **drives)
    for location, form in several:
        plant = _with_effect(plant, baseline, location, form)
    return plant


def _with_effect(plant: Plant, baseline: Baseline, location: str, form: Form) -> Plant:
    """The plant with an effect's bodies and drives."""
    samples = baseline.samples
    changed: dict[str, Any] = {}
    for name in ("viscous", "coulomb", "armature", "bias"):
        if getattr(form, name) != 0.0:
            changed[name] = getattr(plant, name).copy()
            changed[name][samples.joints.index(location)] += getattr(form, name)
    if form.body is not None:
        model = samples.robot.model
        k = [carried_link(model, joint) for joint in range(1, model.njoints)].index(location)
        changed["phi"] = plant.phi.copy()
        changed["phi"][10 * k : 10 * k + 10] += form.body
    return replace(plant, **changed) if changed else plant


def physical_plant(baseline: Baseline, wanted: Plant, gravity: Array | None = None) -> Plant:
    """The nearest physical plant: torques at the identification rows weigh, nominal values break ties.

    Args:
        baseline: the fitted baseline: its samples and each joint's residual σ.
        wanted: x̂.
        gravity: ``(3,)`` [m/s²] where it is not the log's.

    Returns:
        The plant, ``wanted`` itself where that is physical.
    """
    model = baseline.samples.robot.model
    n_phi, n = len(wanted.phi), baseline.n_joints
    nominal_phi = np.concatenate([model.inertias[k].toDynamicParameters() for k in range(1, model.njoints)])
    set_of = PhysicalBodies(nominal_phi, _drive_units(baseline, wanted))
    drives = np.concatenate([wanted.viscous, wanted.coulomb, wanted.armature])
    wish = set_of.coordinates(np.concatenate([wanted.phi, drives]))
    if set_of.holds(wish):
        return wanted
    middle = set_of.coordinates(np.concatenate([nominal_phi, np.maximum(drives, 0.0)]))
    rows = _rows(baseline, gravity).reshape(-1, len(wish)) @ set_of.map
    z, off = nearest_bodies(set_of, rows, wish, middle)
    found = set_of.map @ z
    viscous, coulomb, armature = found[n_phi:].reshape(3, n)
    return Plant(found[:n_phi], viscous, coulomb, armature, wanted.bias, off)


def _drive_units(baseline: Baseline, wanted: Plant) -> Array:
    """Sizes of viscous, Coulomb and rotor terms, ``(3·n_joints,)``."""
    sizes = [np.abs(v).max(initial=0.0) for v in (wanted.viscous, wanted.coulomb, wanted.armature)]
    return np.repeat(np.maximum(np.array(sizes), 1e-3), baseline.n_joints)


def _rows(baseline: Baseline, gravity: Array | None) -> Array:
    """Torque per unit of every parameter in units of each joint's residual, ``(n_rows, n_joints, n)``."""
    s = baseline.samples
    q, v, a = (
        np.concatenate([getattr(t, name)[t.rows] for t in s.trials if t.identification])
        for name in ("q", "v", "a")
    )
    take = slice(None, None, max(1, len(q) // _ROWS))
    q, v, a = q[take], v[take], a[take]
    index = list(s.index)
    n = len(index)
    model = s.robot.model
    if gravity is not None:
        model = model.copy()
        model.gravity.linear = gravity
    bodies = joint_torque_regressor(model, q, v, a)[:, index]
    drives = np.zeros((len(q), n, 3, n))
    for j, i in enumerate(index):
        signs = s.split(sign_of_motion(s, j, baseline.signs[j]))
        dry = np.concatenate([x[t.rows] for x, t in zip(signs, s.trials, strict=True) if t.identification])
        drives[:, j, 0, j], drives[:, j, 1, j] = v[:, i], dry[take]
        drives[:, j, 2, j] = a[:, i]
    rows = np.concatenate([bodies, drives.reshape(len(q), n, 3 * n)], axis=2)
    return rows / baseline.fit.sigma[None, :, None]
