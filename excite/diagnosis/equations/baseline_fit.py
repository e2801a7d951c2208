"""The baseline fitted: what ``modelled`` names, with priors where the motion shows nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.fitted_signs import fit_first_signs
from excite.diagnosis.equations.dry_friction.friction_sign import WIDTHS, SignChange
from excite.diagnosis.equations.joint_torque import Equations, Solver
from excite.diagnosis.equations.own_columns import COULOMB, own_rows, own_signals, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.standing_joints import standing_share
from excite.identification.inertia import central_inertia_matrices

_RELATIVE = 0.5
# Root of the weight of a row that says nothing: rows are divided by it again.
_NOTHING = 1e-6


def fit_baseline(
    samples: ArmSamples,
    modelled: tuple[str, ...],
    floor: Array,
    *,
    late: bool = True,
    like: Baseline | None = None,
) -> Baseline:
    """Fit what ``modelled`` names; what the motion does not show of the inertial parameters stays nominal.

    Args:
        modelled: words of ``modelled`` in ``log.yaml``.
        floor: ``(n_joints,)`` noise in the rows' band [N·m].
        late: whether friction that seems to remember may be friction without memory beside torques that are late; not
            where a lag of the torques is what is asked for.
        like: another fit of the same samples, whose columns and sign changes of friction this one has; None to search
            for these.

    Returns:
        The baseline.
    """
    joints = range(len(samples.joints))
    free = "rigid_body" in modelled
    tau, nominal = samples.to_rows([t.tau for t in samples.trials], joints), samples.nominal_torques
    root, strict = standstill_weights(samples, 2.0, 0.35), standstill_weights(samples, 3.0, 0.02)
    if (told := samples.known_torque_rows) is not None:
        root, strict = within_range(root, told, _NOTHING), within_range(strict, told, 0.0)
    y = (tau - samples.to_rows(nominal, joints)).T * root
    phi = model_phi(samples)
    if free and like is not None and like.free:
        shared, basis = like.solver.equations.shared, like.basis
    elif free:
        shared, basis = _inertial_columns(samples, phi)
        shared = shared * root[:, :, None]
    else:
        shared, basis = np.zeros((len(joints), y.shape[1], 0)), np.zeros((len(phi), 0))
    terms = own_terms(modelled)
    sign = SignChange(WIDTHS[2])
    own = tuple(own_rows(samples, terms, j, [sign])[0] * root[j][:, None] for j in joints)
    solver = Solver(Equations(shared, own, y, samples.identification_rows, samples.trial_of_row, floor))
    fit = solver.fit_columns()
    phi_hat = phi + basis @ fit.shared
    torque = samples.rigid_torques(phi_hat) if free else nominal
    friction = np.column_stack([own_signals(samples, terms, j, sign) @ fit.own_coefs[j] for j in joints])
    nothing = np.zeros_like(torque)
    known = _known_torque(samples, nothing)
    total = torque + friction + known
    baseline = Baseline(
        samples,
        modelled,
        free,
        (sign,) * len(joints),
        solver,
        fit,
        phi_hat,
        basis,
        torque,
        total,
        root,
        strict,
        nothing,
        known,
        (False,) * len(joints),
    ).refit()
    if COULOMB not in terms:
        return baseline
    if like is None:
        return fit_first_signs(baseline, late=late)
    return baseline.with_signs(like.signs).refit()


def _known_torque(samples: ArmSamples, nothing: Array) -> Array:
    """Full-rate torque of what is known of the drives, ``(n_samples, n_joints)``; ``nothing`` where that is none."""
    parts = [trial.known for trial in samples.trials if trial.known is not None]
    return np.concatenate(parts) if parts else nothing


def standstill_weights(samples: ArmSamples, slope: float, least: float) -> Array:
    """Square roots of the rows' weights, ``(n_joints, n_rows)``, their mean square 1.

    At rest friction is whatever holds the joint, no function of its motion: rows that the filter mixes with
    standstill weigh little. A fit that gave them no weight at all would leave the change of sign to chance.

    Args:
        slope: loss of weight with the share of standstill in a row.
        least: least root of a weight before normalisation.
    """
    root = np.clip(1.0 - slope * standing_share(samples), least, 1.0)
    return root / np.sqrt((root**2).mean(axis=1, keepdims=True))


def within_range(root: Array, told: NDArray[np.bool_], least: float) -> Array:
    """Roots of weights, ``(n_joints, n_rows)``, of which those of rows that hold no known torque are next to nothing.

    Args:
        root: of the weights without that.
        told: which rows hold known torques.
        least: what the others are multiplied by.
    """
    root = np.where(told, root, least * root)
    return root / np.maximum(np.sqrt((root**2).mean(axis=1, keepdims=True)), least)


def model_phi(samples: ArmSamples) -> Array:
    """Nominal inertial parameters ``(10·n_segments,)``."""
    model = samples.robot.model
    return np.concatenate([model.inertias[k].toDynamicParameters() for k in range(1, model.njoints)])


def _inertial_columns(samples: ArmSamples, phi: Array) -> tuple[Array, Array]:
    """Columns of the inertial parameters in units of their prior spread, in a basis without blind directions."""
    rows = samples.body_rows() * prior_spread(phi)
    flat = np.concatenate([block / max(block.std(), 1e-9) for block in rows])
    values, vectors = np.linalg.eigh(flat.T @ flat)
    keep = values > 1e-9 * values[-1]
    basis = vectors[:, keep]
    return np.ascontiguousarray(rows @ basis), prior_spread(phi)[:, None] * basis


def prior_spread(phi: Array) -> Array:
    """Prior standard deviation of the inertial parameters: half of each link's mass put on somewhere."""
    inertial = phi.reshape(-1, 10)
    mass = np.maximum(inertial[:, 0], 0.02)
    centre = inertial[:, 1:4] / mass[:, None]
    gyration = np.trace(central_inertia_matrices(phi), axis1=1, axis2=2) / (2.0 * mass)
    radius = np.maximum(np.sqrt((centre**2).sum(axis=1) + np.maximum(gyration, 0.0)), 0.02)
    powers = np.array([0] + [1] * 3 + [2] * 6)
    return ((_RELATIVE * mass)[:, None] * radius[:, None] ** powers).ravel()
