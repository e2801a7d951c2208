"""Inertial parameters and drive terms that a simulator accepts, as near to a fit as its rows can tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.diagnosis.baseline import Baseline
from excite.diagnosis.drive_terms import own_names
from excite.diagnosis.sign_change import sign_of_motion
from excite.identification.inertia import pseudo_inertia_matrices
from excite.regressor.kernels import joint_torque_regressor
from excite.robot.robot import Array

_ROWS = 500
_PRIOR = 1e-3
_ITERATIONS = 1500
_RELAXATION = 1.6
# Least eigenvalue of a body's pseudo-inertia, relative to its nominal trace, lengths in its own radius.
_INSIDE = 1e-4
_UPPER = np.triu_indices(4)
_WEIGHT = np.where(_UPPER[0] == _UPPER[1], 1.0, np.sqrt(2.0))


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
    own = dict.fromkeys(("viscous_friction", "coulomb_friction", "armature", "torque_bias"))
    names = own_names(baseline.modelled)
    values = np.array([o[: len(names)] for o in baseline.fit.own]).reshape(baseline.n_joints, len(names))
    found = {name: values[:, names.index(name)] if name in names else np.zeros(len(values)) for name in own}
    return Plant(
        baseline.phi,
        found["viscous_friction"],
        found["coulomb_friction"],
        found["armature"],
        found["torque_bias"],
    )


def physical_plant(baseline: Baseline, wanted: Plant, gravity: Array | None = None) -> Plant:
    """The nearest physical plant: torques at the identification rows weigh, nominal values break ties.

    Minimises ``Σ_j |A_j (x − x̂)|²/σ_j² + λ |x − x_nominal|²`` over bodies of positive density and drive terms
    that are not negative, by the alternating direction method of multipliers (Boyd et al. 2011, section 3).

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
    set_of = _Bodies(nominal_phi, _drive_units(baseline, wanted))
    drives = np.concatenate([wanted.viscous, wanted.coulomb, wanted.armature])
    wish = set_of.coordinates(np.concatenate([wanted.phi, drives]))
    if np.allclose(set_of.nearest(wish), wish, rtol=1e-9, atol=1e-9):
        return wanted
    middle = set_of.coordinates(np.concatenate([nominal_phi, np.maximum(drives, 0.0)]))
    rows = _rows(baseline, gravity).reshape(-1, len(wish)) @ set_of.map
    gram = rows.T @ rows / max(len(rows), 1)
    right = gram @ wish + _PRIOR * middle
    penalty = float(np.sqrt(_PRIOR * np.linalg.eigvalsh(gram)[-1]))
    inverse = np.linalg.inv(gram + (_PRIOR + penalty) * np.eye(len(wish)))
    z, u = set_of.nearest(wish), np.zeros(len(wish))
    for _ in range(_ITERATIONS):
        x = _RELAXATION * inverse @ (right + penalty * (z - u)) + (1.0 - _RELAXATION) * z
        z = set_of.nearest(x + u)
        u = u + x - z
    found = set_of.map @ z
    viscous, coulomb, armature = found[n_phi:].reshape(3, n)
    off = float(np.sqrt(np.mean((rows @ (z - wish)) ** 2)))
    return Plant(found[:n_phi], viscous, coulomb, armature, wanted.bias, off)


class _Bodies:
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
