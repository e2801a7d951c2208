"""A problem condensed for estimation: triangular factors, channel weights, scaled parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import lstsq, qr, solve_triangular

from excite.arrays import Array
from excite.errors import InputError
from excite.identification.inertia import central_inertia_matrices
from excite.identification.noise import NoiseModel, TrialGrid, estimate_noise, trial_grids
from excite.identification.problem import IdentificationProblem, row_blocks
from excite.regressor.base_parameters import r_factor
from excite.threads import one_blas_thread

# Singular values of the column-scaled rows below this share of the greatest are structural zeros.
RANK_TOLERANCE = 1e-8
# Jovic 2016 expects masses of CAD to be off by up to 50 %.
USUAL_SPREAD = 0.5
_SMALLEST_MASS = 0.02
_SMALLEST_RADIUS = 0.02


@dataclass(frozen=True, eq=False)
class Regression:
    """A problem reduced to small matrices; every estimator works on these.

    Attributes:
        problem: the problem.
        grids: time grids of its trials.
        channel_factors: per channel, ``R`` of ``[Y y] = Q R``, ``(n_channels, n_params+1, n_params+1)``.
        std: standard deviation of each channel's noise ``(n_channels,)`` [N or N·m].
        noise: noise model of the last residuals, None before weights have been iterated.
    """

    problem: IdentificationProblem
    grids: tuple[TrialGrid, ...]
    channel_factors: Array
    std: Array
    noise: NoiseModel | None = None

    @cached_property
    def factor(self) -> Array:
        """``R`` of the rows divided by ``std``, measurement last, ``(n_params+1, n_params+1)``."""
        scaled = self.channel_factors / self.std[:, None, None]
        return square_factor(np.vstack(list(scaled)))

    @property
    def independent_factor(self) -> Array:
        """``R`` of the rows divided by ``std`` and by the root of the noise's integrated autocorrelation, likewise.

        Its squares count independent numbers, and not rows whose noise is that of their neighbours.
        """
        inflation = np.ones(len(self.std)) if self.noise is None else self.noise.inflation
        scaled = self.channel_factors / (self.std * np.sqrt(inflation))[:, None, None]
        return square_factor(np.vstack(list(scaled)))

    def weighted(self, std: Array, noise: NoiseModel | None = None) -> Regression:
        """The same rows with other channel weights ``1/std``.

        Args:
            std: noise of each channel, ``(n_channels,)`` [the channels' units].
            noise: its correlation, None where it is taken to be white.
        """
        return replace(self, std=np.asarray(std, dtype=float), noise=noise)

    def residual_variances(self, parameters: Array) -> Array:
        """Square residual of each channel per independent number, ``(n_channels,)``, from the channel factors."""
        tail = np.append(parameters, -1.0)
        squares = np.einsum("cij,j->ci", self.channel_factors, tail)
        return np.asarray((squares**2).sum(axis=1) / np.maximum(self.problem.numbers(), 1.0))


@one_blas_thread
def condense_problem(problem: IdentificationProblem) -> Regression:
    """Condense a problem, all channels weighted alike (the unweighted least squares of eq. 3, Jovic 2015).

    Raises:
        InputError: a row is not finite; names its channel and trial.
    """
    bad = np.flatnonzero(~np.isfinite(problem.y) | ~np.isfinite(problem.Y).all(axis=1))
    if len(bad):
        row = bad[0]
        raise InputError(
            f"{len(bad)} rows are not finite, the first at {problem.time[row]:.3f} s",
            source=problem.trial_names[problem.trial[row]],
            field=problem.channel_names[problem.channel[row]],
            remedy="check the log's channels",
        )
    width = problem.n_params + 1
    factors = np.zeros((len(problem.channel_names), width, width))
    for c in range(len(problem.channel_names)):
        rows = np.flatnonzero(problem.channel == c)
        r = np.zeros((0, width))
        for part in row_blocks(len(rows)):
            block = rows[part]
            r = r_factor(np.vstack([r, np.column_stack([problem.Y[block], problem.y[block]])]))
        factors[c, : len(r)] = r
    return Regression(problem, trial_grids(problem), factors, np.ones(len(problem.channel_names)))


@one_blas_thread
def iterate_weights(rows: Regression, *, iterations: int = 10) -> Regression:
    """Weight each channel by one over the standard deviation of its own least-squares residual.

    Where least squares leave fewer numbers than they take, the residual of the most probable parameters says it.

    Starts from the weights that the problem states; stops when no weight moves by more than a thousandth.
    The noise model of the final residuals comes with the result, scaled up for the degrees of freedom that
    the fit has taken.

    Args:
        iterations: rounds at most; 0 keeps the stated weights.
    """
    problem = rows.problem
    std = stated_std(problem)
    scarce = iterations > 0 and not leaves_freedom(rows)
    if scarce:
        std = np.sqrt(rows.residual_variances(problem.prior))
    for _ in range(iterations):
        rows = rows.weighted(std)
        new = np.sqrt(
            _probable_variances(rows) if scarce else rows.residual_variances(least_squares(rows.factor))
        )
        # A channel that is fitted exactly must not take all the weight.
        new = np.maximum(new, 1e-6 * max(float(new.max()), 1e-12))
        change = np.max(np.abs(new - std) / std)
        std = new
        if change < 1e-3:
            break
    rows = rows.weighted(std)
    parameters = _most_probable(rows)[0] if scarce else least_squares(rows.factor)
    return rows.weighted(std, estimate_noise(problem, rows.grids, problem.residual(parameters)))


def leaves_freedom(rows: Regression) -> bool:
    """Whether least squares leave at least as many numbers as they take; else their residuals do not tell the noise."""
    scale = np.linalg.norm(rows.factor[:, :-1], axis=0)
    scaled = rows.factor[:, :-1] / np.where(scale > 0.0, scale, 1.0)
    rank = int(np.linalg.matrix_rank(scaled, tol=RANK_TOLERANCE * max(1.0, float(np.linalg.norm(scaled)))))
    return float(rows.problem.numbers().sum()) >= 2 * rank


def _most_probable(rows: Regression) -> tuple[Array, Array]:
    """Parameters as far from the nominal ones as their usual spread lets them, and ``(AᵀA + S⁻²)⁻¹`` about them."""
    problem = rows.problem
    scales = prior_std(problem, USUAL_SPREAD)
    a, b = rows.factor[:, :-1] * scales, rows.factor[:, -1] - rows.factor[:, :-1] @ problem.prior
    covariance = np.linalg.inv(a.T @ a + np.eye(problem.n_params))
    return problem.prior + scales * (covariance @ (a.T @ b)), scales[:, None] * covariance * scales


def log_evidence(rows: Regression, relative: float | Array) -> float:
    """Logarithm of the rows' probability, parameters scattered about nominal ones, up to a constant [nats].

    ``y ~ N(Yθ₀, I + Y S² Yᵀ)`` in units of independent noise (MacKay, Neural Computation 1992).

    Args:
        relative: see :func:`prior_std`.
    """
    factor = rows.independent_factor
    target = factor[:, -1] - factor[:, :-1] @ rows.problem.prior
    scaled = factor[:, :-1] * prior_std(rows.problem, relative)
    root = np.linalg.cholesky(np.eye(len(scaled)) + scaled @ scaled.T)
    left = solve_triangular(root, target, lower=True)
    return -0.5 * float(left @ left) - float(np.log(np.diag(root)).sum())


def _probable_variances(rows: Regression) -> Array:
    """Square residual of each channel per number that the most probable parameters leave, ``(n_channels,)``.

    MacKay (Neural Computation 1992): ``‖r‖²/(n − γ)`` with ``γ`` the numbers that the channel's rows determine.
    """
    parameters, covariance = _most_probable(rows)
    columns = rows.channel_factors[:, :, :-1] / rows.std[:, None, None]
    taken = ((columns @ covariance) * columns).sum(axis=(1, 2))
    numbers = np.maximum(rows.problem.numbers(), 1.0)
    left = np.maximum(numbers - taken, np.finfo(float).eps)
    return np.asarray(rows.residual_variances(parameters) * numbers / left)


def stated_std(problem: IdentificationProblem) -> Array:
    """Noise of each channel as the problem's weights state it, ``(n_channels,)``."""
    n_channels = len(problem.channel_names)
    sums = np.bincount(problem.channel, weights=1.0 / problem.weights, minlength=n_channels)
    counts = np.bincount(problem.channel, minlength=n_channels)
    return np.where(counts > 0, sums / np.maximum(counts, 1), 1.0)


def least_squares(factor: Array, *, center: Array | None = None, scales: Array | None = None) -> Array:
    """Least-squares parameters nearest to ``center`` in units of ``scales``.

    Args:
        factor: ``R`` with the measurement as last column.
        center: ``(n_params,)``, zero by default (the minimum-norm solution ``Y⁺f``, eq. 5 of Jovic 2016).
        scales: ``(n_params,)``, one by default.

    Returns:
        ``(n_params,)``.
    """
    n = factor.shape[1] - 1
    center = np.zeros(n) if center is None else center
    scales = np.ones(n) if scales is None else scales
    a, b = factor[:, :n] * scales, factor[:, n] - factor[:, :n] @ center
    return center + scales * minimum_norm(a, b)


def minimum_norm(a: Array, b: Array) -> Array:
    """Minimum-norm least-squares solution of ``a x ≈ b`` by a complete orthogonal factorisation.

    No iteration that could fail to converge, as the singular value decompositions of LAPACK do now and then.

    Args:
        a: ``(m, n)``.
        b: ``(m,)`` or ``(m, k)``.

    Returns:
        ``(n,)`` or ``(n, k)``; singular values below ``RANK_TOLERANCE`` of the largest count as zero.
    """
    return np.asarray(lstsq(a, b, cond=RANK_TOLERANCE, lapack_driver="gelsy", check_finite=False)[0])


def square_factor(rows: Array) -> Array:
    """``R`` of ``(m, n)`` ``rows = Q R`` as a triangle ``(n, n)``, zero rows added where there are too few."""
    r = r_factor(rows)
    square = np.zeros((rows.shape[1], rows.shape[1]))
    square[: len(r)] = r
    return square


def prior_std(problem: IdentificationProblem, relative: float | Array) -> Array:
    """How far each parameter may lie from its nominal value, ``(n_params,)``, one standard deviation.

    A segment of mass ``m`` and radius ``r`` (distance of the centre of mass from the joint frame's origin,
    and radius of gyration, added as squares) gets ``relative·m`` for its mass, ``relative·m·r`` for its
    first moments and ``relative·m·r²`` for its inertias: a body of that share of the segment's mass put on
    somewhere. Drives' parameters get the problem's ``drive_spread``, else what would
    explain all of their channel's signal.

    Args:
        relative: share of a segment's mass, for example 0.5 (Jovic 2016: CAD off by up to 50 %), or one for
            each segment ``(n_segments,)``.
    """
    inertial = problem.prior[: problem.n_inertial].reshape(-1, 10)
    mass = np.maximum(inertial[:, 0], _SMALLEST_MASS)
    center = inertial[:, 1:4] / mass[:, None]
    central = central_inertia_matrices(inertial.ravel())
    gyration = np.nan_to_num(np.trace(central, axis1=1, axis2=2) / (2.0 * mass))
    radius = np.maximum(np.sqrt((center**2).sum(axis=1) + np.maximum(gyration, 0.0)), _SMALLEST_RADIUS)
    powers = np.array([0] + [1] * 3 + [2] * 6)
    spread = np.broadcast_to(np.asarray(relative, dtype=float), mass.shape)
    body = (spread * mass)[:, None] * radius[:, None] ** powers
    drives = problem.Y[:, problem.n_inertial :]
    signal = max(float(np.sqrt(np.mean(problem.y**2))), 1e-9)
    power = np.sqrt((drives**2).sum(axis=0) / max(1, problem.n_rows // len(problem.channel_names)))
    usual = signal / np.where(power > 0.0, power, 1.0)
    if problem.drive_spread is not None:
        usual = np.where(np.isnan(problem.drive_spread), usual, problem.drive_spread)
    return np.concatenate([body.ravel(), usual])


# A matrix split into what it determines and what it does not, without iterations that could fail.


@dataclass(frozen=True, eq=False)
class RowSpace:
    """``A = Q · y-map``: for ``x = inverse · y + null · n`` the product ``A x`` is ``image · y``.

    ``image`` has orthonormal columns, so ``‖A x − b‖² = ‖y − imageᵀ b‖² + const``; ``null`` is an orthonormal
    basis of what ``A`` does not see, orthogonal to ``inverse``.

    Attributes:
        image: ``(m, rank)``.
        inverse: ``(n, rank)``.
        null: ``(n, n - rank)``.
    """

    image: Array
    inverse: Array
    null: Array

    @property
    def rank(self) -> int:
        """Number of independent rows."""
        return int(self.image.shape[1])


def row_space(matrix: Array, tolerance: float = RANK_TOLERANCE) -> RowSpace:
    """Complete orthogonal factorisation ``A P = Q [R; 0]``, ``Rᵀ = V [T; 0]`` (Golub and Van Loan, 5.4.7).

    Args:
        matrix: ``(m, n)``, columns of comparable units.
        tolerance: pivots below this share of the first are zero.
    """
    m, n = matrix.shape
    if not matrix.size:
        return RowSpace(np.zeros((m, 0)), np.zeros((n, 0)), np.eye(n))
    q, r, pivots = qr(matrix, mode="economic", pivoting=True, check_finite=False)
    diagonal = np.abs(np.diag(r))
    rank = int(np.count_nonzero(diagonal > tolerance * max(float(diagonal[0]), 1e-300)))
    top = np.empty((n, rank))
    top[pivots] = r[:rank].T
    v, t = qr(top, mode="full", check_finite=False) if rank else (np.eye(n), np.zeros((n, 0)))
    inverse = v[:, :rank] @ solve_triangular(t[:rank], np.eye(rank), trans="T") if rank else np.zeros((n, 0))
    return RowSpace(q[:, :rank], inverse, v[:, rank:])
