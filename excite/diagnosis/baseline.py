"""What the log says is modelled, fitted or trusted: rigid bodies, friction, rotor inertia."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from excite.diagnosis.arm_trial import ArmTrial
from excite.diagnosis.drive_terms import WIDTHS, own_names, own_signals
from excite.diagnosis.equations import Equations, Fit, Solver
from excite.diagnosis.samples import ArmSamples
from excite.diagnosis.sign_changes import first_signs
from excite.diagnosis.standstill import standing_share
from excite.identification.inertia import central_inertia_matrices
from excite.regressor.kernels import inverse_dynamics, joint_torque_regressor
from excite.robot.robot import Array

_RELATIVE = 0.5


@dataclass(frozen=True, eq=False)
class Derived:
    """What follows from a motion and inertial parameters alone: worked out when it is asked for, kept with them.

    Attributes:
        trials: the motion.
        phi: the parameters.
        values: by row of the joint and name, full rate; what is of no joint has the row −1.
    """

    trials: tuple[ArmTrial, ...] = ()
    phi: Array | None = None
    values: dict[tuple[int, str], Array] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Baseline:
    """The fitted baseline, with what effects need of it.

    Attributes:
        samples: the samples.
        modelled: words of ``modelled``.
        free: whether inertial parameters are fitted.
        widths: ``(n_joints,)`` width of each joint's sign change [rad/s].
        breakaways: ``(n_joints,)`` deflection over which dry friction builds up [rad]; 0 where it follows the
            velocity alone, over ``widths``.
        solver: the equations, ready for hypotheses.
        fit: the baseline's own fit.
        phi: ``(10·n_segments,)`` inertial parameters after the fit, nominal in blind directions.
        basis: ``(10·n_segments, n_shared)``: change of the inertial parameters per unit of ``x``.
        rigid: full-rate torque of the rigid bodies at ``phi`` ``(n_samples, n_joints)`` [N·m], accepted effects of
            bodies and geometry included.
        total: the same with friction, rotor inertia and all accepted effects.
        root_weight: ``(n_joints, n_rows)`` square root of the rows' weights, by which all rows of ``solver`` are
            multiplied; their mean square is 1.
        strict: the same where hypotheses are judged: standstill counts for next to nothing.
        added: accepted effects' part of ``rigid``.
        added_drive: accepted effects' part of ``total`` that is not in ``rigid``.
        derived: shared by baselines that differ in neither motion nor ``phi``.
    """

    samples: ArmSamples
    modelled: tuple[str, ...]
    free: bool
    widths: Array
    breakaways: Array
    solver: Solver
    fit: Fit
    phi: Array
    basis: Array
    rigid: Array
    total: Array
    root_weight: Array
    strict: Array
    added: Array
    added_drive: Array
    derived: Derived = field(default_factory=Derived)

    def __post_init__(self) -> None:
        if self.derived.trials is not self.samples.trials or self.derived.phi is not self.phi:
            object.__setattr__(self, "derived", Derived(self.samples.trials, self.phi))

    def updated(self, fit: Fit) -> Baseline:
        """The same equations with another fit and predictions at its parameters."""
        s, index = self.samples, list(self.samples.index)
        rigid, phi = self.rigid, self.phi
        if self.free:
            n = self.basis.shape[1]
            phi = phi + self.basis @ (fit.shared[:n] - self.fit.shared[:n])
            q, v, a = (s.stacked(name) for name in ("q", "v", "a"))
            rigid = inverse_dynamics(s.robot.model, q, v, a, phi)[:, index] + self.added
        names = own_names(self.modelled)
        own = [
            own_signals(s, names, j, self.widths[j], self.breakaways[j]) @ o for j, o in enumerate(fit.own)
        ]
        total = rigid + np.column_stack(own) + self.added_drive
        return replace(self, fit=fit, phi=phi, rigid=rigid, total=total)

    def own_rows(self, names: tuple[str, ...], joint: int, width: float, breakaway: float = 0.0) -> Array:
        """Weighted rows of a joint's own terms, ``(n_rows, n_own)``."""
        s = self.samples
        columns = own_signals(s, names, joint, width, breakaway)
        return s.rows(columns) * self.root_weight[joint][:, None]

    def plain(self, residual: Array) -> Array:
        """Residuals without the weights, ``(n_joints, n_rows)`` [N·m]."""
        return residual / self.root_weight

    def judged(self, residual: Array) -> Array:
        """Residuals with the weights that hypotheses are judged by, ``(n_joints, n_rows)`` [N·m]."""
        return residual / self.root_weight * self.strict

    def with_signs(self, widths: Array, breakaways: Array, lead: float) -> Baseline:
        """The equations with other widths, breakaways and lead of the joints' sign changes, not fitted again."""
        names, samples = own_names(self.modelled), self.samples
        if lead != samples.lead:
            samples = replace(samples, lead=lead)
        moved = replace(self, samples=samples, widths=widths, breakaways=breakaways)
        for j, sign in enumerate(zip(widths, breakaways, strict=True)):
            if samples is not self.samples or sign != (self.widths[j], self.breakaways[j]):
                own = moved.own_rows(names, j, float(sign[0]), float(sign[1]))
                moved = replace(moved, solver=moved.solver.with_own(j, own))
        return moved

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.samples.joints)


def fit_baseline(
    samples: ArmSamples, modelled: tuple[str, ...], floor: Array, *, leads: bool = True
) -> Baseline:
    """Fit what ``modelled`` names; what the motion does not show of the inertial parameters stays nominal.

    Args:
        samples: the samples.
        modelled: words of ``modelled`` in ``log.yaml``.
        floor: ``(n_joints,)`` noise in the rows' band [N·m].
        leads: whether friction may change sign before the filtered velocity does; not where a lag of the torques is
            what is asked for.

    Returns:
        The baseline.
    """
    model = samples.robot.model
    q, v, a = (samples.stacked(name) for name in ("q", "v", "a"))
    index = list(samples.index)
    free = "rigid_body" in modelled
    tau = samples.rows([t.tau for t in samples.trials])
    nominal = inverse_dynamics(model, q, v, a)[:, index]
    root, strict = standstill_weights(samples, 2.0, 0.35), standstill_weights(samples, 3.0, 0.02)
    y = (tau - samples.rows(nominal)).T * root
    phi = model_phi(samples)
    shared, basis = _shared(samples, phi, q, v, a) if free else (np.zeros((len(index), y.shape[1], 0)), None)
    shared = shared * root[:, :, None]
    names = own_names(modelled)
    widths, breakaways = np.full(len(index), WIDTHS[2]), np.zeros(len(index))
    own = tuple(
        samples.rows(own_signals(samples, names, j, WIDTHS[2])) * root[j][:, None] for j in range(len(index))
    )
    solver = Solver(Equations(shared, own, y, samples.identification, samples.trial_of_row, floor))
    fit = solver.fit()
    basis = np.zeros((len(phi), 0)) if basis is None else basis
    phi_hat = phi + basis @ fit.shared
    torque = inverse_dynamics(model, q, v, a, phi_hat)[:, index] if free else nominal
    friction = np.column_stack(
        [own_signals(samples, names, j, widths[j], breakaways[j]) @ fit.own[j] for j in range(len(index))]
    )
    nothing = np.zeros_like(torque)
    total = torque + friction
    baseline = Baseline(
        samples,
        modelled,
        free,
        widths,
        breakaways,
        solver,
        fit,
        phi_hat,
        basis,
        torque,
        total,
        root,
        strict,
        nothing,
        nothing,
    )
    return first_signs(baseline, leads=leads) if "coulomb_friction" in names else baseline


def standstill_weights(samples: ArmSamples, slope: float, least: float) -> Array:
    """Square roots of the rows' weights, ``(n_joints, n_rows)``, their mean square 1.

    At rest friction is whatever holds the joint, no function of its motion: rows that the filter mixes with
    standstill weigh little. A fit that gave them no weight at all would leave the change of sign to chance.

    Args:
        samples: the samples.
        slope: loss of weight with the share of standstill in a row.
        least: least root of a weight before normalisation.
    """
    root = np.clip(1.0 - slope * standing_share(samples), least, 1.0)
    return root / np.sqrt((root**2).mean(axis=1, keepdims=True))


def model_phi(samples: ArmSamples) -> Array:
    """Nominal inertial parameters ``(10·n_segments,)``."""
    model = samples.robot.model
    return np.concatenate([model.inertias[k].toDynamicParameters() for k in range(1, model.njoints)])


def _shared(samples: ArmSamples, phi: Array, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Columns of the inertial parameters in units of their prior spread, in a basis without blind directions."""
    index = list(samples.index)
    regressor = samples.of_joints(joint_torque_regressor(samples.robot.model, q, v, a))
    rows = samples.rows(regressor.reshape(len(q), -1))
    rows = rows.reshape(len(rows), len(index), -1) * prior_spread(phi)
    flat = np.concatenate([rows[:, j] / max(rows[:, j].std(), 1e-9) for j in range(len(index))])
    values, vectors = np.linalg.eigh(flat.T @ flat)
    keep = values > 1e-9 * values[-1]
    basis = vectors[:, keep]
    return np.ascontiguousarray((rows @ basis).transpose(1, 0, 2)), prior_spread(phi)[:, None] * basis


def prior_spread(phi: Array) -> Array:
    """Prior standard deviation of the inertial parameters: half of each link's mass put on somewhere."""
    inertial = phi.reshape(-1, 10)
    mass = np.maximum(inertial[:, 0], 0.02)
    centre = inertial[:, 1:4] / mass[:, None]
    gyration = np.trace(central_inertia_matrices(phi), axis1=1, axis2=2) / (2.0 * mass)
    radius = np.maximum(np.sqrt((centre**2).sum(axis=1) + np.maximum(gyration, 0.0)), 0.02)
    powers = np.array([0] + [1] * 3 + [2] * 6)
    return ((_RELATIVE * mass)[:, None] * radius[:, None] ** powers).ravel()
