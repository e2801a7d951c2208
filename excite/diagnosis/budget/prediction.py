"""Predictions of a fitted model of the gap: what its columns are made of when they are made again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.joint_fit import Model
from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.fitted_signs import refit_signs
from excite.diagnosis.equations.joint_torque import Solver
from excite.diagnosis.equations.own_columns import own_signals, own_terms


@dataclass(frozen=True, eq=False)
class Prediction:
    """A model's torques, and those of each of its terms.

    Attributes:
        baseline: with all terms in its predictions; delays and lags are readings, which no torque follows.
        torques: by index of the term, full rate ``(n_samples, n_joints)``; what the model begins with is not listed.
        moves: by index of the term, whether it is a torque that gears carry.
    """

    baseline: Baseline
    torques: dict[int, Array]
    moves: dict[int, bool]

    @property
    def context(self) -> Context:
        """With all terms."""
        return Context(self.baseline)

    def context_without(self, *terms: int) -> Context:
        """As terms' own columns need it: a gear's load is not what it makes of it itself."""
        base = self.baseline
        for k in terms:
            if k not in self.torques:
                continue
            torque, total = self.torques[k], base.total - self.torques[k]
            if self.moves[k]:
                base = replace(base, rigid=base.rigid - torque, total=total, added=base.added - torque)
            else:
                base = replace(base, total=total, added_drive=base.added_drive - torque)
        return Context(base)


def predict_model(full: Baseline, model: Model) -> Prediction:
    """Torques of a fitted model.

    Args:
        full: what every model begins with, fitted.
    """
    s = full.samples
    x = model.x[: full.basis.shape[1]]
    phi, rigid = full.phi, full.rigid
    if full.free:
        phi = full.phi + full.basis @ (x - full.fit.shared)
        rigid = s.rigid_torques(phi)
    moved, driven = np.zeros_like(rigid), full.added_drive.copy()
    y, known = full.solver.equations.y.copy(), full.strict > 0.0
    back = np.where(known, full.root_weight, 0.0) / np.where(known, full.strict, 1.0)
    torques, moves = {}, {}
    for k in model.chosen:
        term = model.design.terms[k]
        if term.started:
            continue
        for j, block in term.columns.items():
            y[j] -= (block @ model.term_parameters(k)) * back[j]
        if term.effect.timing:
            continue
        torques[k] = torque_of(term, model.term_parameters(k))
        moves[k] = term.effect.moves
        (moved if moves[k] else driven)[:] += torques[k]
    now = replace(full.fit, equations=replace(full.solver.equations, y=y), shared=x, held=None)
    terms = own_terms(full.modelled)
    own = [own_signals(s, terms, j, sign) @ now.own_coefs[j] for j, sign in enumerate(full.signs)]
    rigid = rigid + moved
    total = rigid + np.column_stack(own) + driven
    base = replace(full, fit=now, phi=phi, rigid=rigid, total=total, added=moved, added_drive=driven)
    return Prediction(base, torques, moves)


def signs_beside(full: Baseline, model: Model) -> Baseline:
    """What every model begins with, its friction's sign changes searched again: a large effect has bent them.

    Args:
        full: what every model begins with, fitted.
        model: the model so far.
    """
    now = predict_model(full, model).baseline
    apart = replace(now, solver=Solver(now.fit.equations))
    return full.with_drives_of(refit_signs(apart.refit()))


def torque_of(term: Term, x: Array) -> Array:
    """What a fitted term adds to the torques at full rate, ``(n_samples, n_joints)``."""
    shape = term.effect.shape(term.context, term.location, term.theta)
    torque = np.zeros_like(term.context.baseline.rigid)
    for j, columns in shape.columns.items():
        torque[:, j] += columns @ term.to_beta(x)
    for j, values in shape.offset.items():
        torque[:, j] += values
    return torque
