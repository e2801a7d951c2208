"""Series that are searched for: families of motions, criteria, and what a search is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from excite.arrays import Array, Indices
from excite.errors import InputError, NoSolutionError, UnknownNameError
from excite.excitation.design_rows import ArmRows
from excite.motion.generators.curves import Curve, FourierCurve
from excite.motion.generators.joint_motions import start_conditions
from excite.robot.joint_values import Limits
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class MotionFamily:
    """Motions ``q_j(t) = offset_j + Σ_k basis_k(t) c_jk``, from rest at the offset to rest, all joints alike.

    Attributes:
        length: duration [s].
        fastest_hz: frequency of the fastest part of the basis [Hz]: what a grid in time has to resolve.
        n_coefficients: of one joint.
        curve: the motion of offsets ``(n_joints,)`` and coefficients ``(n_joints, n_coefficients)``.
        is_periodic: whether it is a trigonometric polynomial, whose derivatives its values bound.
    """

    length: float
    fastest_hz: float
    n_coefficients: int
    curve: Callable[[Array, Array], Curve]
    is_periodic: bool = False

    def basis(self, time: Array, order: int) -> Array:
        """Values or derivatives of the basis, ``(n, n_coefficients)``, by evaluating the curves of the unit vectors."""
        unit = self.curve(np.zeros(self.n_coefficients), np.eye(self.n_coefficients))
        return unit.evaluate(time, order)

    def grid(self, per_cycle: float) -> Array:
        """Times ``(n,)`` with that many samples in a cycle of the fastest part; the end, like the start, is rest."""
        n = max(16, int(np.ceil(self.length * self.fastest_hz * per_cycle)))
        return np.arange(n) * self.length / n


def fourier_family(period: float, harmonics: int) -> MotionFamily:
    """One period of finite Fourier series (Ni et al. 2024, eq. 8) that start and end at rest.

    The conditions on the coefficients are solved once and for all: what is left to choose are coordinates in
    their null space, those of sines first.

    Raises:
        InputError: no positive period [s], or fewer than three harmonics, which cannot start at rest.
    """
    if not 0.0 < period < np.inf:
        raise InputError(f"period of {period} s", field="period", remedy="give a positive one")
    if harmonics < 3:
        raise InputError(
            f"{harmonics} harmonics", field="harmonics", remedy="a start at rest needs at least 3"
        )
    omega = 2.0 * np.pi / period
    sine, cosine = (np.linalg.svd(rows)[2][len(rows) :].T for rows in start_conditions(omega, harmonics))
    curve = partial(_fourier_curve, omega, sine, cosine)
    return MotionFamily(period, harmonics / period, sine.shape[1] + cosine.shape[1], curve, True)


def _fourier_curve(
    omega: float, sine: Array, cosine: Array, offset: Array, coefficients: Array
) -> FourierCurve:
    a, b = np.split(coefficients, [sine.shape[1]], axis=1)
    return FourierCurve(np.asarray(offset, dtype=float), a @ sine.T, b @ cosine.T, omega)


# Criteria of the information A = YᵀY/n on the base columns: what is made small, a logarithm, and its slope dA.
# Maxima are p-norms (Boyd and Vandenberghe 2004, section 3.1.5): the larger p, the closer and the less smooth.

# Eigenvalues below this share of the largest are rounding; at the floor a criterion is flat.
_FLOOR = 1e-15


@dataclass(frozen=True)
class CriterionValue:
    """A criterion at one information matrix: its value, and its derivative in the matrix ``(n, n)``, symmetric."""

    value: float
    slope: Array


def _condition(values: Array, vectors: Array, p: float, size: Array) -> CriterionValue:
    """``½ log(‖λ‖_p ‖λ⁻¹‖_p)``, the condition number of the base regressor (Gautier and Khalil 1992)."""
    high, low = (values / values[-1]) ** p, (values[0] / values) ** p
    value = 0.5 * (np.log(values[-1] / values[0]) + (np.log(high.sum()) + np.log(low.sum())) / p)
    slope = 0.5 * (high / high.sum() - low / low.sum()) / values
    return CriterionValue(float(value), (vectors * slope) @ vectors.T)


def _log_det(values: Array, vectors: Array, p: float, size: Array) -> CriterionValue:
    """``−log det A / n``, the volume of the confidence ellipsoid by parameter (D-optimality)."""
    return CriterionValue(float(-np.log(values).mean()), -(vectors / (len(values) * values)) @ vectors.T)


def _largest_rsd(values: Array, vectors: Array, p: float, size: Array) -> CriterionValue:
    """``½ log ‖diag(A⁻¹)/size²‖_p``, the largest relative standard deviation (Xu et al. 2020, eq. 7)."""
    inverse = (vectors / values) @ vectors.T
    ratio = np.diag(inverse) / size**2
    power = (ratio / ratio.max()) ** p
    value = 0.5 * (np.log(ratio.max()) + np.log(power.sum()) / p)
    slope = 0.5 * power / (power.sum() * ratio * size**2)
    return CriterionValue(float(value), -(inverse * slope) @ inverse)


CRITERIA: dict[str, Callable[[Array, Array, float, Array], CriterionValue]] = {
    "condition": _condition,
    "log_det": _log_det,
    "largest_rsd": _largest_rsd,
}


def check_criterion(name: str) -> None:
    """Raise UnknownNameError where no criterion has this name."""
    if name not in CRITERIA:
        raise UnknownNameError("criterion", name, sorted(CRITERIA))


def criterion_value(name: str, information: Array, p: float, size: Array) -> CriterionValue:
    """A criterion of ``CRITERIA`` at an information matrix.

    Args:
        name: its name.
        information: ``(n_base, n_base)``.
        p: exponent of the norms that stand for maxima; infinite for the maxima themselves.
        size: ``(n_base,)`` magnitude of each base parameter [SI], which largest_rsd is relative to.
    """
    values, vectors = np.linalg.eigh(information)
    return CRITERIA[name](np.maximum(values, _FLOOR * values[-1]), vectors, p, size)


@dataclass(frozen=True, eq=False)
class ExcitationTask:
    """A series to search for.

    Attributes:
        robot: an arm with a motor in every joint.
        family: of motions to search in.
        criterion: name in :data:`~excite.excitation.series.CRITERIA`.
        limits: the robot's own if None; jerk and tables do not count.
        start: ``(n_joints,)`` where the motion starts and ends [rad or m]; it is chosen if None.
        drives: terms of each joint's drive that count as parameters.
        independent: columns that stand for the base parameters; the first independent ones if None.
        further: limits in place of the linear ones: of a layout, an object with ``rows(x)``, what is left of them
            ``(m,)`` and its Jacobian, and ``shares(x)``, the largest share that each joint uses.
        avoid_collisions: keep bodies apart, and from the table.
    """

    robot: Robot
    family: MotionFamily
    criterion: str = "condition"
    limits: Limits | None = None
    start: Array | None = None
    drives: tuple[str, ...] = ("viscous", "coulomb")
    independent: Indices | None = None
    further: Callable[[Layout], Any] | None = None
    avoid_collisions: bool = True

    def __post_init__(self) -> None:
        """Check the names and shapes; raises UnknownNameError or InputError."""
        check_criterion(self.criterion)
        if self.start is not None and np.shape(self.start) != (self.robot.n_joints,):
            raise InputError(
                f"start of shape {np.shape(self.start)}", field="start", remedy="give one number a joint"
            )

    @cached_property
    def rows(self) -> ArmRows:
        """Rows of the base parameters; raises InputError for a robot without gradients."""
        return ArmRows(self.robot, self.drives, self.criterion != "condition", self.independent)

    def layout(self) -> Layout:
        """Variables of the task; raises NoSolutionError where the limits leave no room."""
        limits, family = self.limits or self.robot.limits, self.family
        half = 0.5 * (limits.position_upper - limits.position_lower)
        start = limits.position_lower + half if self.start is None else np.asarray(self.start, dtype=float)
        for kind, width in (
            ("position", 2.0 * half),
            ("velocity", limits.velocity),
            ("acceleration", limits.acceleration),
        ):
            for name, room in zip(self.robot.joint_names, width, strict=True):
                if not (np.isfinite(room) and room > 0.0):
                    raise NoSolutionError(
                        f"joint {name!r} has no room to move: {kind} limits leave it {room:.3g}",
                        remedy="widen the limits",
                    )
        for name, at, low, high in zip(
            self.robot.joint_names, start, limits.position_lower, limits.position_upper, strict=True
        ):
            if not low < at < high:
                raise NoSolutionError(
                    f"joint {name!r} starts at {at:.3g}, outside {low:.3g} to {high:.3g}",
                    remedy="move the start, or let it be chosen",
                )
        tops = [np.abs(family.basis(family.grid(20.0), order)).max() for order in range(3)]
        rates = np.stack([half / tops[0], limits.velocity / tops[1], limits.acceleration / tops[2]])
        unit = rates.min(axis=0) / np.sqrt(0.5 * family.n_coefficients)
        return Layout(family, limits, start, half if self.start is None else np.zeros(0), unit)


@dataclass(frozen=True, eq=False)
class Layout:
    """How decision variables stand for a motion: offsets first, then each joint's coefficients.

    Attributes:
        family: of the motion.
        limits: of the joints.
        start: ``(n_joints,)`` position at the start, or about which it is chosen [rad or m].
        reach: ``(n_joints,)`` unit of the offsets [rad or m]; empty where the start is given.
        unit: ``(n_joints,)`` unit of the coefficients: with all of them 1 a joint is near its limits.
    """

    family: MotionFamily
    limits: Limits
    start: Array
    reach: Array
    unit: Array

    @property
    def size(self) -> int:
        """Number of variables."""
        return len(self.reach) + len(self.start) * self.family.n_coefficients

    def parts(self, x: Array) -> tuple[Array, Array]:
        """Offsets ``(n_joints,)`` and coefficients ``(n_joints, n_coefficients)`` of variables ``(size,)``."""
        n = len(self.reach)
        offset = self.start + self.reach * x[:n] if n else self.start
        return offset, self.unit[:, None] * x[n:].reshape(len(self.start), -1)

    def gathered(self, by_offset: Array, by_coefficient: Array) -> Array:
        """Gradients in offsets ``(…, n_joints)`` and coefficients ``(…, n_joints, k)`` as gradients ``(…, size)``."""
        scaled = (self.unit[:, None] * by_coefficient).reshape(*by_coefficient.shape[:-2], -1)
        return np.concatenate([self.reach * by_offset, scaled], axis=-1) if len(self.reach) else scaled

    def scaled(self, x: Array, factors: Array | float) -> Array:
        """Variables with the coefficients of each joint multiplied."""
        n = len(self.reach)
        table = x[n:].reshape(len(self.start), -1)
        return np.concatenate([x[:n], (np.reshape(factors, (-1, 1)) * table).ravel()])

    def curve(self, x: Array) -> Curve:
        """The motion of variables."""
        return self.family.curve(*self.parts(x))

    def shares(self, x: Array) -> Array:
        """Largest share of its limits that each joint uses, ``(n_joints,)``; the start's share is 0.

        Shares are those by which the coefficients may grow, so that ``coefficients / share`` just fits.
        """
        offset, limits = self.parts(x)[0], self.limits
        time = np.append(self.family.grid(200.0), self.family.length)
        away, speed, rate = (self.curve(x).evaluate(time, order) for order in range(3))
        away = away - offset
        shares = (
            away.max(axis=0) / (limits.position_upper - offset),
            -away.min(axis=0) / (offset - limits.position_lower),
            np.abs(speed).max(axis=0) / limits.velocity,
            np.abs(rate).max(axis=0) / limits.acceleration,
        )
        return np.asarray(np.max(shares, axis=0))
