"""Base parameters: the combinations of parameters that a regressor determines (Gautier 1991)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dgeqrf

from excite.arrays import Array, Indices
from excite.errors import InputError
from excite.regressor.columns import measured_columns, regressor_rows
from excite.regressor.contact_forces import stance_flags
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Base parameters of a regressor ``Y``: ``Y @ phi == Y[:, independent] @ (matrix @ phi)``.

    Attributes:
        names: of all columns, ``(n,)``.
        independent: ``(n_base,)`` columns that stand for the base parameters, increasing.
        matrix: ``(n_base, n)``: base parameters as combinations of all parameters [SI].
        expressions: each of them in words, such as ``Izz(link1) + Iyy(link2) - 0.41·mx(link3)``.
        smallest_kept: smallest share of an independent column that the earlier ones do not explain.
        largest_dropped: the largest such share of a dependent column; far below, or the rank is in doubt.
    """

    names: tuple[str, ...]
    independent: Indices
    matrix: Array
    expressions: tuple[str, ...]
    smallest_kept: float
    largest_dropped: float

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return len(self.independent)

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of each base parameter's own column, the first term of its expression."""
        return tuple(self.names[column] for column in self.independent)

    def values(self, phi: Array) -> Array:
        """Base parameters ``(n_base,)`` of parameters ``(n,)`` in the order of ``names`` [SI]."""
        return self.matrix @ phi

    def summary(self) -> str:
        """Number of parameters and how clear-cut it is."""
        return (
            f"{self.rank} base parameters of {len(self.names)} "
            f"(weakest kept {self.smallest_kept:.1e}, strongest dropped {self.largest_dropped:.1e})"
        )


def base_parameters(rows: Array, names: Sequence[str], tol: float = 1e-8) -> BaseParameters:
    """Base parameters of the given regressor rows.

    Columns are taken one by one, in their order, and kept where the ones before do not explain them:
    parameters of segments near the root stay, those of later segments are grouped with them.

    Args:
        rows: ``(m, n)`` regressor, or an R factor of it.
        names: of the columns, ``(n,)``.
        tol: a column is dependent when less than this share of its norm is left unexplained, and zero when
            its norm is below this share of the largest.

    Returns:
        The base parameters.

    Raises:
        InputError: wrong shape, NaN, or no column with anything in it.
    """
    rows = np.asarray(rows, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != len(names):
        raise InputError(f"regressor of shape {rows.shape} for {len(names)} names")
    if not np.isfinite(rows).all():
        raise InputError("regressor holds NaN or infinity", remedy="check the motion")
    if rows.shape[0] > rows.shape[1]:
        rows = r_factor(rows)
    norms = np.linalg.norm(rows, axis=0)
    present = norms > tol * norms.max(initial=0.0)
    if not present.any():
        raise InputError("regressor is zero", remedy="hand over a motion that moves")
    scaled = np.where(present, rows / np.where(present, norms, 1.0), 0.0)
    basis, shares = _orthonormal_basis(scaled, tol)
    kept = shares > tol
    independent = np.flatnonzero(kept)
    weights = solve_triangular(basis.T @ scaled[:, kept], basis.T @ scaled) * norms / norms[kept, None]
    # Coefficients this close to 0, 1 or -1 are these; what rounding leaves is far smaller.
    nearest = np.clip(np.round(weights), -1.0, 1.0)
    matrix = np.where(np.abs(weights - nearest) < 1e-9, nearest, weights)
    matrix[:, independent] = np.eye(len(independent))
    # A column is explained by the columns before it alone.
    matrix[independent[:, None] > np.arange(len(names))] = 0.0
    dropped = shares[present & ~kept]
    return BaseParameters(
        names=tuple(names),
        independent=independent,
        matrix=matrix,
        expressions=tuple(describe_combination(row, names) for row in matrix),
        smallest_kept=float(shares[kept].min()),
        largest_dropped=float(dropped.max(initial=0.0)),
    )


def structural_base_parameters(
    robot: Robot, drives: Sequence[str] = ("viscous", "coulomb")
) -> BaseParameters:
    """Base parameters of a robot under free motion: what its sensors could determine at best.

    Args:
        robot: the robot; the columns are those of :func:`~excite.regressor.columns.measured_columns`.
        drives: terms of each joint's drive, for an arm.

    Returns:
        The base parameters; they depend on the robot's geometry alone, not on limits, nor on contacts that sensors
        measure; else what all feet down, and one in the air, show together. Where fewer count with joints exactly at
        right angles, which a model has rounded, those are meant.
    """
    exact = _structural_parameters(robot, drives)
    if robot.mechanism is not None:
        # Its loops close with the numbers that they have.
        return exact
    meant = _structural_parameters(_at_right_angles(robot), drives)
    return meant if meant.rank < exact.rank else exact


def draw_configurations(robot: Robot, random: np.random.Generator, n: int) -> Array:
    """Configurations all over the joints' turn, a free base turned in any way ``(n, nq)``."""
    q = random.uniform(-np.pi, np.pi, size=(n, robot.model.nq))
    if robot.floating:
        q[:, 3:7] = random.normal(size=(n, 4))
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    return q


def _structural_parameters(robot: Robot, drives: Sequence[str]) -> BaseParameters:
    """The base parameters of a model with the numbers that it has."""
    columns = measured_columns(robot, drives)
    random = np.random.default_rng(0)
    rows_a_sample = robot.n_equations
    n = 3 * len(columns.names) // rows_a_sample + 1
    if robot.floating and not robot.measures_contacts:
        # As many for each stance.
        n *= 1 + len(robot.feet)
    q = draw_configurations(robot, random, n)
    v = random.normal(size=(n, robot.model.nv))
    a = 5.0 * random.normal(size=(n, robot.model.nv))
    if robot.mechanism is not None:
        # Within limits: beyond, a mechanism cannot be closed.
        base, limits = q[:, : robot.n_base_q], robot.limits
        q = robot.mechanism.draw_configurations(random, limits.position_lower, limits.position_upper, n)
        q[:, : robot.n_base_q] = base
        q, v, a = robot.mechanism.follow_driven(q, v, a)
    rows = regressor_rows(robot, columns, q, v, a, stance_flags(robot, n))
    return base_parameters(rows.reshape(-1, len(columns.names)), columns.names)


def _at_right_angles(robot: Robot) -> Robot:
    """The robot with joints exactly parallel or at right angles where its model says so in few digits."""
    model = pin.Model(robot.model)
    for joint in range(1, model.njoints):
        placement = model.jointPlacements[joint]
        # Elements of a rotation this close to zero come of a right angle that was typed, at worst as 1.57 or 3.14. Left
        # as they are, gravity and other joints' motion reach parameters by a 1e-5th: of SO-101 50 combinations would
        # count instead of 48, of Stretch 52 instead of 50, of a Minitaur 96 instead of 80; of 70 other robots none is
        # another.
        typed = np.where(np.abs(placement.rotation) < 2e-3, 0.0, placement.rotation)
        left, _, right = np.linalg.svd(typed)
        model.jointPlacements[joint] = pin.SE3(left @ right, placement.translation)
    return replace(robot, model=model)


def describe_combination(weights: Array, names: Sequence[str]) -> str:
    """A linear combination in words; terms of weight zero are left out."""
    parts: list[str] = []
    for weight, name in zip(weights, names, strict=True):
        if weight == 0.0:
            continue
        size = abs(weight)
        term = name if size == 1.0 else f"{size:.3g}·{name}"
        sign = "-" if weight < 0.0 else "+"
        parts.append(f"{sign} {term}" if parts else (f"-{term}" if weight < 0.0 else term))
    return " ".join(parts) if parts else "0"


def _orthonormal_basis(columns: Array, tol: float) -> tuple[Array, Array]:
    """Basis of the columns kept one by one, and the unexplained share of each column's norm.

    Gram-Schmidt with a second pass, which keeps the basis orthonormal to rounding.
    """
    basis = np.empty((columns.shape[0], min(columns.shape)), order="F")
    shares, rank = np.zeros(columns.shape[1]), 0
    for j in range(columns.shape[1]):
        rest, known = columns[:, j].copy(), basis[:, :rank]
        for _ in range(2):
            rest -= known @ (known.T @ rest)
        shares[j] = np.linalg.norm(rest)
        if shares[j] > tol and rank < basis.shape[1]:
            basis[:, rank] = rest / shares[j]
            rank += 1
    return basis[:, :rank], shares


# Triangular factors of tall regressors.


def r_factor(rows: Array) -> Array:
    """The R of ``rows = Q R``: ``(min(m, n), n)``, upper triangular, for rows of shape ``(m, n)``.

    It stands for the rows in every least-squares question, and its condition number is theirs, where that of
    the Gram matrix ``rowsᵀ rows`` would be its square.
    """
    n = rows.shape[1]
    # LAPACK refuses nothing at all. numpy's takes as much work space, and twice the time for copies of the rows.
    return np.triu(dgeqrf(rows, lwork=32 * n)[0][:n]) if rows.size else np.zeros((min(rows.shape), n))
