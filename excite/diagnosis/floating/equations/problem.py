"""The Bayesian linear problem that every hypothesis is judged by."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.floating.equations.prior import inertial_scales
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.diagnosis.floating.equations.spectrum import (
    Repeatability,
    Whitening,
    make_whitening,
    scaled_to_repeats,
)
from excite.diagnosis.floating.equations.state import State
from excite.diagnosis.floating.equations.unloaded import UnloadedRows, find_unloaded


@dataclass(frozen=True, eq=False)
class LinearFit:
    """A hypothesis' fit to whitened numbers.

    Attributes:
        theta: parameters, in units of their scales.
        covariance: of the same.
        gain: what it lowers half the sum of squares by, priors included [nats].
        evidence: the same less the price of its parameters: log of the Bayes factor against the baseline.
    """

    theta: Array
    covariance: Array
    gain: float
    evidence: float


@dataclass(frozen=True, eq=False)
class Problem:
    """Whitened residuals of a record with the baseline's freedom taken out.

    Rows: the base's equation in the frequency domain, then mean readings of unloaded sensors. The baseline's
    parameters (inertials where they are identified, those of feet beyond their sensors) have a loose Gaussian
    prior and are integrated out; so the evidence of a hypothesis is that of a linear Gaussian model
    (MacKay 1992, eq. 2.5).

    Attributes:
        record: the record.
        nominal: the logged state.
        whitening: of the base's rows.
        repeatability: what repeated trials say.
        unloaded: unloaded sensors.
        basis: ``(m, r)`` orthonormal basis of what the baseline takes out, scaled by the prior.
        columns: ``(m, p)`` the baseline's columns in units of its scales.
        scales: ``(p,)`` its scales.
        index: ``(p,)`` which inertial parameters they are.
    """

    record: FloatingRecord
    nominal: State
    whitening: Whitening
    repeatability: Repeatability
    unloaded: UnloadedRows
    basis: Array
    columns: Array
    scales: Array
    index: NDArray[np.int64]

    def rows(self, state: State) -> Array:
        """``(m,)`` whitened residual in a state."""
        return np.concatenate([self.whitening(state.residual), self.unloaded.residual(state)])

    def state(self, delta: Array) -> State:
        """The logged state with errors ``delta (10·n_segments,)`` of the inertial parameters.

        What the nominal state has computed and does not depend on them is handed on: the regressor in any case.
        """
        if not delta.any():
            return self.nominal
        _ = self.nominal.regressor
        return self.nominal.replace(phi=self.record.tree.phi + delta)

    @cached_property
    def nominal_rows(self) -> Array:
        """Those of the nominal state."""
        return self.rows(self.nominal)

    @cached_property
    def validation(self) -> NDArray[np.bool_]:
        """``(m,)`` which rows are of validation trials."""
        held_out = np.array(self.record.validation)
        unloaded = np.repeat(held_out[list(self.unloaded.trial)] if self.unloaded.trial else [], 6)
        return np.concatenate([self.whitening.validation_rows(), unloaded.astype(bool)])

    @cached_property
    def identification_only(self) -> Problem:
        """The problem with the validation trials' rows at zero weight; itself where there are no such trials."""
        if not any(self.record.validation) or all(self.record.validation):
            return self
        keep = ~np.array(self.record.validation)
        whitening = replace(
            self.whitening,
            factors=tuple(f * float(k) for f, k in zip(self.whitening.factors, keep, strict=True)),
        )
        unloaded = replace(
            self.unloaded,
            # An infinite standard deviation takes a row out.
            std=tuple(
                std if keep[trial] else np.full(6, np.inf)
                for std, trial in zip(self.unloaded.std, self.unloaded.trial, strict=True)
            ),
        )
        columns = np.where(self.validation[:, None], 0.0, self.columns)
        return replace(
            self, whitening=whitening, unloaded=unloaded, columns=columns, basis=damped_basis(columns)
        )

    def project(self, rows: Array) -> Array:
        """``(r, …)`` components that the baseline takes out."""
        return self.basis.T @ rows

    def baseline_parameters(self, rows: Array) -> Array:
        """Most probable errors of all inertial parameters, ``(10·n_segments,)``, given residual rows."""
        delta = np.zeros(len(self.record.tree.phi))
        if len(self.index):
            delta[self.index] = self.scales * scipy.linalg.cho_solve(
                self._baseline_factor, self.columns.T @ rows
            )
        return delta

    def baseline_rows(self, delta: Array) -> Array:
        """``(m,)`` what errors ``delta (10·n_segments,)`` of the inertial parameters make of the rows."""
        if not len(self.index):
            return np.zeros(len(self.columns))
        return np.asarray(self.columns @ (delta[self.index] / self.scales))

    @cached_property
    def _baseline_factor(self) -> tuple[Array, bool]:
        """Factor of the baseline's normal equations, prior included."""
        return scipy.linalg.cho_factor(self.columns.T @ self.columns + np.eye(len(self.index)))

    def beside(self, columns: Array) -> Problem:
        """The problem in which the parameters of ``columns (m, k)``, of unit prior, are integrated out as well."""
        left = columns - self.basis @ self.project(columns)
        factor = np.linalg.cholesky(np.eye(columns.shape[1]) + columns.T @ left)
        further = scipy.linalg.solve_triangular(factor, left.T, lower=True).T
        return replace(self, basis=np.hstack([self.basis, further]))

    def power(self, rows: Array) -> float:
        """Sum of squares left by the baseline, its prior included."""
        return float(rows @ rows - (self.project(rows) ** 2).sum())

    def fit(self, rows: Array, columns: Array) -> LinearFit:
        """Fit ``columns (m, k)``, in units of their scales, to ``rows (m,)``."""
        return self.fit_each(rows, [columns])[0]

    def fit_each(self, rows: Array, hypotheses: list[Array]) -> list[LinearFit]:
        """Fit each of several sets of columns, by itself."""
        ends = np.cumsum([columns.shape[1] for columns in hypotheses])[:-1]
        projected, shadow = self.project(np.hstack(hypotheses)), self.project(rows)
        return [
            solve(columns.T @ columns - part.T @ part, columns.T @ rows - part.T @ shadow)
            for columns, part in zip(hypotheses, np.split(projected, ends, axis=1), strict=True)
        ]


def solve(gram: Array, right: Array, overdispersion: float = 1.0) -> LinearFit:
    """Ridge solution with unit prior, and its evidence, from normal equations.

    Args:
        gram: ``(k, k)``.
        right: ``(k,)``.
        overdispersion: variance of the noise over that expected.
    """
    information = np.eye(len(gram)) + gram / overdispersion
    factor = scipy.linalg.cho_factor(information)
    theta = scipy.linalg.cho_solve(factor, right / overdispersion)
    gain = 0.5 * float(right @ theta) / overdispersion
    price = float(np.log(np.diag(factor[0])).sum())
    return LinearFit(theta, scipy.linalg.cho_solve(factor, np.eye(len(gram))), gain, gain - price)


def damped_basis(columns: Array) -> Array:
    """Orthonormal basis of ``columns (m, p)`` scaled by what a unit prior on their parameters leaves of each.

    Of the stacked [columns; 1] the upper part of Q, which carries the prior's damping.
    """
    if not columns.size:
        return columns
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u * (s / np.sqrt(1.0 + s**2)))


def build_problem(record: FloatingRecord) -> Problem:
    """Whiten the record's nominal residual and prepare the baseline."""
    nominal = State.logged(record)
    whitening, repeatability = scaled_to_repeats(make_whitening(record, nominal), nominal.residual)
    unloaded = find_unloaded(record, nominal)
    blocks, scales, index = [], [], []
    feet = np.flatnonzero(unloaded.scales)
    n_base, n_unloaded = whitening.n_rows, 6 * len(unloaded.sensors)
    if record.inertials_free:
        own = inertial_scales(record.tree.phi)
        for segment in record.unmeasured:
            own[10 * segment : 10 * segment + 10] = 0.0
        free = np.flatnonzero(own)
        blocks.append(
            np.vstack(
                [whitening(nominal.regressor[:, :, free]) * own[free], np.zeros((n_unloaded, len(free)))]
            )
        )
        scales.append(own[free])
        index.append(free)
    if len(feet) and n_unloaded:
        blocks.append(np.vstack([np.zeros((n_base, len(feet))), unloaded.foot_columns()]))
        scales.append(unloaded.scales[feet])
        index.append(feet)
    if not blocks:
        empty = np.zeros((n_base + n_unloaded, 0))
        return Problem(
            record, nominal, whitening, repeatability, unloaded, empty, empty, np.zeros(0), np.zeros(0, int)
        )
    columns = np.hstack(blocks)
    return Problem(
        record,
        nominal,
        whitening,
        repeatability,
        unloaded,
        damped_basis(columns),
        columns,
        np.concatenate(scales),
        np.concatenate(index),
    )
