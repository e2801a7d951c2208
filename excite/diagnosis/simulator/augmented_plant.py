"""Inertial parameters and drive terms that a simulator accepts, as near to a fit as its rows can tell."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import RobotChanges
from excite.diagnosis.attribution import Attribution
from excite.diagnosis.effects.form import Form
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import model_phi
from excite.diagnosis.equations.dry_friction.friction_sign import sign_of_motion
from excite.diagnosis.equations.known_drives import known_terms
from excite.diagnosis.equations.own_columns import ARMATURE, CONSTANT, COULOMB, VISCOUS, OwnTerm, own_terms
from excite.diagnosis.simulator.model_text import MODEL, Found, found_effects
from excite.identification.inertia import pseudo_inertia_matrices
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


# Bodies that can exist, as near to fitted inertial parameters as rows of a regressor can tell.

_PRIOR = 1e-3
_ITERATIONS = 1500
_RELAXATION = 1.6
# Steps of the coordinates, which are of order one, that nothing is left to be found in.
_DONE = 1e-12
_NOTABLE = 1.0
# Least eigenvalue of a body's pseudo-inertia, relative to its nominal trace, lengths in its own radius.
_INSIDE = 1e-4
_UPPER = np.triu_indices(4)
_WEIGHT = np.where(_UPPER[0] == _UPPER[1], 1.0, np.sqrt(2.0))


class PhysicalBodies:
    """Bodies of positive density and drive terms that are not negative, in coordinates that need no units.

    A body's coordinates are its pseudo-inertia, lengths in its radius and masses in half its nominal one, stacked
    so that their Euclidean norm is the matrix's Frobenius norm: the nearest body is then a matter of eigenvalues.

    Attributes:
        map: ``(n, n)`` from coordinates to parameters.
    """

    def __init__(self, nominal: Array, drives: Array):
        mass = np.maximum(nominal.reshape(-1, 10)[:, 0], 0.02)
        pseudo = pseudo_inertia_matrices(nominal)
        radius = np.sqrt(np.trace(pseudo[:, :3, :3], axis1=1, axis2=2) / mass)
        self.size = len(nominal)
        self.inverse_radius = 1.0 / np.maximum(radius, 0.02)
        self.mass = 0.5 * mass
        blocks = [self._stacked(np.eye(10)[k]).T for k in range(10)]
        forward = np.stack(blocks, axis=2).transpose(1, 0, 2)
        total = np.zeros((self.size + len(drives),) * 2)
        for k, block in enumerate(forward):
            total[10 * k : 10 * k + 10, 10 * k : 10 * k + 10] = np.linalg.inv(block)
        total[self.size :, self.size :] = np.diag(drives)
        self.map = total
        self._inverse = np.linalg.inv(total)
        self.least = _INSIDE * np.trace(self._scaled(pseudo), axis1=1, axis2=2)

    def coordinates(self, x: Array) -> Array:
        """Coordinates of parameters ``(n,)``."""
        return self._inverse @ x

    def holds(self, y: Array) -> bool:
        """Whether these coordinates are those of bodies and drive terms that can be."""
        return bool(np.allclose(self.nearest(y), y, rtol=1e-9, atol=1e-9))

    def nearest(self, y: Array) -> Array:
        """Coordinates of the nearest bodies and drive terms."""
        out = np.maximum(y, 0.0)
        bodies = y[: self.size].reshape(-1, 10)
        full = np.zeros((len(bodies), 4, 4))
        full[:, _UPPER[0], _UPPER[1]] = full[:, _UPPER[1], _UPPER[0]] = bodies / _WEIGHT
        values, vectors = np.linalg.eigh(full)
        raised = np.maximum(values, self.least[:, None])
        near = np.einsum("kij,kj,klj->kil", vectors, raised, vectors)
        out[: self.size] = (near[:, _UPPER[0], _UPPER[1]] * _WEIGHT).ravel()
        return out

    def _scaled(self, pseudo: Array) -> Array:
        d = np.ones((len(pseudo), 4))
        d[:, :3] = self.inverse_radius[:, None]
        return pseudo * d[:, :, None] * d[:, None, :] / self.mass[:, None, None]

    def _stacked(self, ten: Array) -> Array:
        """Coordinates ``(n_segments, 10)`` of the same ten parameters in every segment."""
        pseudo = np.tile(pseudo_inertia_matrices(ten), (len(self.mass), 1, 1))
        return self._scaled(pseudo)[:, _UPPER[0], _UPPER[1]] * _WEIGHT


def nearest_bodies(bodies: PhysicalBodies, rows: Array, wish: Array, middle: Array) -> tuple[Array, float]:
    """Coordinates of the nearest physical bodies: rows weigh, nominal values break ties.

    Minimises ``|A (x − x̂)|²/m + λ |x − x_nominal|²`` over bodies of positive density and drive terms that are not
    negative, by the alternating direction method of multipliers (Boyd et al. 2011, section 3).

    Args:
        bodies: the set.
        rows: A ``(m, n)`` in its coordinates, each row in units of what it is known to.
        wish: x̂ ``(n,)``.
        middle: nominal values ``(n,)``.

    Returns:
        The coordinates, and by how much rows are off with them (RMS).
    """
    gram = rows.T @ rows / max(len(rows), 1)
    right = gram @ wish + _PRIOR * middle
    penalty = float(np.sqrt(_PRIOR * np.linalg.eigvalsh(gram)[-1]))
    inverse = np.linalg.inv(gram + (_PRIOR + penalty) * np.eye(len(wish)))
    z, u = bodies.nearest(wish), np.zeros(len(wish))
    for _ in range(_ITERATIONS):
        x = _RELAXATION * inverse @ (right + penalty * (z - u)) + (1.0 - _RELAXATION) * z
        last, z = z, bodies.nearest(x + u)
        u = u + x - z
        if max(np.abs(z - last).max(), np.abs(x - z).max()) < _DONE:
            break
    return z, float(np.sqrt(np.mean((rows @ (z - wish)) ** 2)))


def unphysical(mismatch: float, unit: str) -> tuple[str, ...]:
    """What is to be said of bodies that are off a fit by so many times a ``unit``; nothing where that is little."""
    if mismatch <= _NOTABLE:
        return ()
    return (
        "the fitted inertial parameters are no bodies' that can exist; the nearest ones are off by "
        f"{mismatch:.1f} times the {unit}",
    )


# Accepted effects as changes of a robot's description.


def robot_changes(attribution: Attribution, baseline: Baseline) -> tuple[RobotChanges, ...]:
    """What the first none, one, two … of the accepted effects change.

    Friction and rotor inertia are all that the model of the record has, with what ``modelled`` had fitted; bodies are
    the effects' alone, as near to them as bodies can be.

    Args:
        attribution: the attribution.
        baseline: the baseline before it.
    """
    effects = found_effects(attribution)
    made = [_changes(baseline, ())]
    for count in range(1, len(effects) + 1):
        last = count == len(effects)
        beside = attribution.final if last else attribution.stages[count].context.baseline
        made.append(_changes(beside, effects[:count]))
    return tuple(made)


def _changes(baseline: Baseline, effects: Sequence[Found]) -> RobotChanges:
    samples = baseline.samples
    forms = [item.form(samples.joints) for item in effects]
    wanted = plant_with(baseline, ((item.location, form) for item, form in zip(effects, forms, strict=True)))
    said = [line for item, form in zip(effects, forms, strict=True) for line in _beyond(item, form)]
    links = {item.location for item, form in zip(effects, forms, strict=True) if form.body is not None}
    plant = physical_plant(baseline, wanted) if links else wanted
    drives = [
        {name: max(float(v), 0.0) for name, v in zip(samples.joints, values, strict=True)}
        for values in (plant.viscous, plant.coulomb, plant.armature)
    ]
    viscous, coulomb, armature = drives
    return RobotChanges(viscous, coulomb, armature, _bodies(baseline, plant, links), beyond=tuple(said))


def _bodies(baseline: Baseline, plant: Plant, links: Collection[str]) -> dict[str, Array]:
    """What each of these links has more than the nominal model, which stands where bodies have effects."""
    model = baseline.samples.robot.model
    change = (plant.phi - model_phi(baseline.samples)).reshape(-1, 10)
    names = [carried_link(model, k) for k in range(1, model.njoints)]
    return {name: row for name, row in zip(names, change, strict=True) if name in links}


def _beyond(item: Found, form: Form) -> list[str]:
    """Parts of an effect that a description has no place for."""
    what = _named(item.effect.name, item.location)
    if form.absent is not None:
        return [f"{what}: in no file, {form.absent}"]
    said = []
    if form.bias != 0.0:
        said.append(f"{what}: of the reading ({form.bias:.3g}), not of the robot; take it off the log")
    if form.gravity is not None:
        said.append(f"{what}: gravity stands in log.yaml, which is left as it is")
    if form.elements is not None or form.finish is not None or form.notes:
        all_of_it = not (form.viscous or form.coulomb or form.armature)
        more = f"{what}: how it builds up and changes stands in {MODEL} alone"
        said.append(in_no_description(item.effect.name, item.location) if all_of_it else more)
    return said


def in_no_description(effect: str, location: str) -> str:
    """The sentence for an effect that a simulator has and no description of a robot."""
    return f"{_named(effect, location)}: it stands in {MODEL} alone"


def _named(effect: str, location: str) -> str:
    return f"{effect.replace('_', ' ')} at {location}"
