"""What the log says is modelled, fitted or trusted: rigid bodies, friction, rotor inertia."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.dry_friction.friction_sign import SignChange
from excite.diagnosis.equations.joint_torque import Fit, Solver
from excite.diagnosis.equations.own_columns import ARMATURE, OwnTerm, own_rows, own_signals, own_terms
from excite.diagnosis.equations.samples import ArmSamples


@dataclass(frozen=True, eq=False)
class Derived:
    """What follows from a motion and inertial parameters alone: worked out when it is asked for, kept with them.

    Attributes:
        trials: the motion.
        phi: the parameters.
        values: by row of the joint and name, full rate.
        rows: by effect, place and non-linear parameters, what an effect that follows nothing else adds.
    """

    trials: tuple[ArmTrial, ...] = ()
    phi: Array | None = None
    values: dict[tuple[int, str], NDArray[Any]] = field(default_factory=dict)
    rows: dict[Hashable, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Baseline:
    """The fitted baseline, with what effects need of it.

    Attributes:
        samples: the samples.
        modelled: words of ``modelled``.
        free: whether inertial parameters are fitted.
        signs: how the dry friction of each joint changes sign.
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
        rotorless: by joint, whether its rotor is left out: that would make all inertia negative.
        late: delay of the torques beside which the sign changes of friction were told [s]; 0 for none.
        derived: shared by baselines that differ in neither motion nor ``phi``.
    """

    samples: ArmSamples
    modelled: tuple[str, ...]
    free: bool
    signs: tuple[SignChange, ...]
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
    rotorless: tuple[bool, ...]
    late: float = 0.0
    derived: Derived = field(default_factory=Derived)

    def __post_init__(self) -> None:
        if self.derived.trials is not self.samples.trials or self.derived.phi is not self.phi:
            object.__setattr__(self, "derived", Derived(self.samples.trials, self.phi))

    def with_fit(self, fit: Fit) -> Baseline:
        """The same equations with another fit and predictions at its parameters."""
        s = self.samples
        rigid, phi = self.rigid, self.phi
        if self.free:
            n = self.basis.shape[1]
            phi = phi + self.basis @ (fit.shared[:n] - self.fit.shared[:n])
            rigid = s.rigid_torques(phi) + self.added
        terms = own_terms(self.modelled)
        own = [
            own_signals(s, terms, j, sign) @ o
            for j, (sign, o) in enumerate(zip(self.signs, fit.own_coefs, strict=True))
        ]
        total = rigid + np.column_stack(own) + self.added_drive
        return replace(self, fit=fit, phi=phi, rigid=rigid, total=total)

    def own_rows(self, terms: Sequence[OwnTerm], joint: int, sign: SignChange) -> Array:
        """Weighted rows of a joint's own terms, ``(n_rows, n_own)``."""
        return self.rows_of_signs(terms, joint, (sign,))[0]

    def rows_of_signs(self, terms: Sequence[OwnTerm], joint: int, signs: Sequence[SignChange]) -> list[Array]:
        """:meth:`own_rows` at each of several sign changes."""
        return self.weighted_own_rows(terms, joint, signs, self.root_weight)

    def weighted_own_rows(
        self, terms: Sequence[OwnTerm], joint: int, signs: Sequence[SignChange], weight: Array
    ) -> list[Array]:
        """Rows of a joint's own terms at several sign changes, zero of rotors left out, ``(n_rows, n_own)`` each.

        Args:
            weight: ``(n_joints, n_rows)`` square roots of the rows' weights.
        """
        made = [rows * weight[joint][:, None] for rows in own_rows(self.samples, terms, joint, signs)]
        if self.rotorless[joint] and ARMATURE in terms:
            for rows in made:
                rows[:, terms.index(ARMATURE)] = 0.0
        return made

    def bristle_damping(self, joint: int) -> float:
        """Damping of a joint's bristles as fitted, not negative; 0 where they have none [N·m·s]."""
        return max(float(self.fit.own_coefs[joint][-1]), 0.0) if self.signs[joint].has_damping else 0.0

    def plain_residual(self, residual: Array) -> Array:
        """Residuals without the weights, ``(n_joints, n_rows)`` [N·m]; none in rows that hold no known torque."""
        return np.where(self.strict > 0.0, residual / self.root_weight, 0.0)

    def judging_residual(self, residual: Array) -> Array:
        """Residuals with the weights that hypotheses are judged by, ``(n_joints, n_rows)`` [N·m]."""
        return residual / self.root_weight * self.strict

    def relative_gap(self, residual: Array, scale: Array) -> float:
        """RMS of residuals ``(n_joints, n_rows)`` in the rows that judge, over scales of the joints ``(n_joints,)``."""
        squares = self.samples.squared_residuals(self.plain_residual(residual))[:, self.samples.judging_rows]
        return float(np.sqrt(np.mean(squares.mean(axis=1) / scale**2)))

    def with_signs(self, signs: Sequence[SignChange], rotorless: Sequence[bool] | None = None) -> Baseline:
        """The equations with other sign changes of the joints, or other rotors left out, not fitted again."""
        left_out = self.rotorless if rotorless is None else tuple(bool(one) for one in rotorless)
        terms, moved = own_terms(self.modelled), replace(self, signs=tuple(signs), rotorless=left_out)
        for j, sign in enumerate(moved.signs):
            if sign != self.signs[j] or left_out[j] != self.rotorless[j]:
                own = moved.own_rows(terms, j, sign)
                moved = replace(moved, solver=moved.solver.with_own(j, own))
        return moved

    def with_drives_of(self, other: Baseline) -> Baseline:
        """Fitted with the sign changes and the rotors of another fit of the same samples; itself where it has them."""
        if self.signs == other.signs and self.rotorless == other.rotorless:
            return self
        moved = self.with_signs(other.signs, other.rotorless)
        return moved.with_fit(moved.solver.fit_columns())

    def refit(self) -> Baseline:
        """The equations fitted, without rotors that would make all inertia that a motor turns negative.

        Such a rotor is a spring in a motion of one frequency, and hides it. One of a little less than none stays: noise
        of accelerations makes bodies lighter than they are.
        """
        terms = own_terms(self.modelled)
        found = self.with_signs(self.signs, [False] * self.n_joints)
        fit = found.solver.fit_columns()
        if ARMATURE not in terms:
            return found.with_fit(fit)
        while True:
            rotors = np.array([own[terms.index(ARMATURE)] for own in fit.own_coefs])
            none = rotors + self.samples.motor_inertias < 0.0
            if not none.any():
                return found.with_fit(fit)
            found = found.with_signs(found.signs, (none | found.rotorless).tolist())
            fit = found.solver.fit_columns()

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.samples.joints)
