"""The excitation of a motion, and its exact gradient in the motion's coefficients."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import InputError, UnknownNameError
from excite.excitation.optimisation.motions import MotionFamily
from excite.excitation.precision import row_noise
from excite.regressor.adjoint import regressor_gradient
from excite.regressor.base_parameters import base_parameters
from excite.regressor.columns import Columns, measured_columns, regressor_rows
from excite.regressor.kernels import base_link_regressor, joint_torque_regressor
from excite.regressor.tree import KinematicTree, read_tree
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot

# Speeds at which Coulomb friction's sign is smoothed, as a share of the joint's limit: the gradient needs a slope.
_SIGN_WIDTH = 0.02
# Base parameters smaller than this are judged as if they had this size (Xu et al. 2020, end of section II.A: what
# is smaller than 0.01 and uncertain is no part of the model) [SI].
LEAST_SIZE = 0.01


@dataclass(frozen=True, eq=False)
class Layout:
    """How decision variables stand for a motion of some joints: offsets first, then each joint's coefficients.

    Attributes:
        robot: the robot.
        family: of the motion.
        joints: indices into ``robot.joint_names`` of the joints that move.
        free_offset: whether the start is chosen too; otherwise it is ``start``.
        start: ``(n_moved,)`` position at the start, or about which it is chosen [rad or m].
        reach: ``(n_moved,)`` unit of the offsets [rad or m].
        unit: ``(n_moved,)`` unit of the coefficients: with all of them 1 a joint is near its limits.
    """

    robot: Robot
    family: MotionFamily
    joints: NDArray[np.int64]
    free_offset: bool
    start: Array
    reach: Array
    unit: Array

    @property
    def n_offsets(self) -> int:
        """Number of offsets among the variables."""
        return len(self.joints) if self.free_offset else 0

    @property
    def size(self) -> int:
        """Number of variables."""
        return self.n_offsets + len(self.joints) * self.family.n_coefficients

    def parts(self, x: Array) -> tuple[Array, Array]:
        """Offsets ``(n_moved,)`` and coefficients ``(n_moved, n_coefficients)`` of variables ``(size,)``."""
        offset = self.start + self.reach * x[: self.n_offsets] if self.free_offset else self.start
        table = x[self.n_offsets :].reshape(len(self.joints), -1)
        return offset, self.unit[:, None] * table

    def gathered(self, by_offset: Array, by_coefficient: Array) -> Array:
        """Gradients in offsets ``(…, n_moved)`` and coefficients ``(…, n_moved, k)`` as gradients ``(…, size)``."""
        scaled = (self.unit[:, None] * by_coefficient).reshape(*by_coefficient.shape[:-2], -1)
        if not self.free_offset:
            return scaled
        return np.concatenate([self.reach * by_offset, scaled], axis=-1)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Positions, velocities and accelerations at the instants, ``(n, …)`` each."""

    q: Array
    v: Array
    a: Array


@dataclass(frozen=True, eq=False)
class Sampling:
    """A layout's basis at given times.

    Attributes:
        layout: the layout.
        time: ``(n,)`` [s].
    """

    layout: Layout
    time: Array

    @cached_property
    def bases(self) -> tuple[Array, ...]:
        """Basis and its first two derivatives, ``(n, k)`` each."""
        family = self.layout.family
        return family.basis(self.time, 0), family.basis(self.time, 1), family.basis(self.time, 2)

    def moved(self, x: Array) -> Trajectory:
        """The motion of the moved joints, ``(n, n_moved)`` each."""
        offset, table = self.layout.parts(x)
        position, velocity, acceleration = (basis @ table.T for basis in self.bases)
        return Trajectory(offset + position, velocity, acceleration)

    def whole(self, x: Array) -> Trajectory:
        """The motion of the whole robot, the rest of it at rest: ``(n, nq)``, ``(n, nv)``, ``(n, nv)``."""
        robot, joints = self.layout.robot, self.layout.joints
        moved = self.moved(x)
        q = np.tile(robot.rest, (len(self.time), 1))
        v, a = np.zeros((2, len(self.time), robot.model.nv))
        q[:, robot.n_base_q + joints] = moved.q
        v[:, robot.n_base_v + joints] = moved.v
        a[:, robot.n_base_v + joints] = moved.a
        return Trajectory(q, v, a)

    def pulled(self, by_q: Array, by_v: Array, by_a: Array) -> Array:
        """Gradient ``(size,)`` from gradients in the moved joints' q, v, a, ``(n, n_moved)`` each."""
        zero, one, two = self.bases
        return self.layout.gathered(by_q.sum(axis=0), by_q.T @ zero + by_v.T @ one + by_a.T @ two)


class Objective:
    """A criterion of the motion that variables stand for.

    Args:
        layout: what the variables stand for.
        criterion: what is minimised.
        time: ``(n,)`` at which the regressor is taken [s].
        drives: terms of each joint's drive, for an arm.
        independent: columns that stand for the base parameters; those of the moved joints if None.

    Raises:
        InputError: a criterion that needs the sensors' noise, of a robot that does not state it.
    """

    def __init__(
        self,
        layout: Layout,
        criterion: Criterion,
        time: Array,
        drives: tuple[str, ...],
        independent: NDArray[np.int64] | None = None,
    ) -> None:
        robot = layout.robot
        self._tree: KinematicTree = read_tree(robot.model)
        self._sampling = Sampling(layout, time)
        self._columns: Columns = measured_columns(robot, drives)
        self._criterion = criterion
        self.independent, size = _base_columns(layout, self._columns, independent)
        n_rows = robot.n_equations
        noise = row_noise(robot) if criterion.weighted else np.ones(n_rows)
        self._weights = 1.0 / noise
        rate = robot.description.sensors.rate_hz
        self._scale = ParameterScale(size, 1.0 / np.sqrt(rate * layout.family.length))
        self._width = _SIGN_WIDTH * np.concatenate([np.ones(robot.n_base_v), robot.limits.velocity])
        self._inertial = self._columns.inertial
        self._joints = np.arange(robot.n_joints)
        terms = self._columns.drives
        self._drives = {term: len(self._inertial) + k * robot.n_joints for k, term in enumerate(terms)}

    @property
    def n_base(self) -> int:
        """Number of base parameters."""
        return len(self.independent)

    def value(self, x: Array) -> float:
        """The figure that a person reads, of variables ``(size,)``, with Coulomb friction's sign as it is."""
        whole = self._sampling.whole(x)
        q, v, a = whole.q, whole.v, whole.a
        rows = self._rows(q, v, a, np.sign(v))
        return self._criterion.exact(rows.T @ rows / len(q), self._scale)

    def smooth(self, x: Array, sharpness: float) -> tuple[float, Array]:
        """The smoothed criterion and its gradient ``(size,)``."""
        whole = self._sampling.whole(x)
        q, v, a = whole.q, whole.v, whole.a
        sign = np.tanh(v / self._width)
        rows = self._rows(q, v, a, sign)
        result = self._criterion.smooth(rows.T @ rows / len(q), self._scale, sharpness)
        slope = (2.0 / len(q)) * (rows @ result.gradient).reshape(len(q), -1, self.n_base)
        pull = np.zeros((*slope.shape[:2], len(self._columns.names)))
        pull[:, :, self.independent] = slope * self._weights[:, None]
        weights = np.zeros((*slope.shape[:2], 10 * self._tree.n_segments))
        weights[:, :, self._inertial] = pull[:, :, : len(self._inertial)]
        gradient = regressor_gradient(self._tree, q, v, a, weights)
        for term, first in self._drives.items():
            by_drive = pull[:, self._joints, first + self._joints]
            if term == "viscous":
                gradient.v[:] += by_drive
            elif term == "coulomb":
                gradient.v[:] += by_drive * (1.0 - sign**2) / self._width
            elif term == "armature":
                gradient.a[:] += by_drive
        robot = self._sampling.layout.robot
        moved = robot.n_base_v + self._sampling.layout.joints
        return result.value, self._sampling.pulled(
            gradient.q[:, moved], gradient.v[:, moved], gradient.a[:, moved]
        )

    def _rows(self, q: Array, v: Array, a: Array, sign: Array) -> Array:
        """Weighted base columns, ``(n·n_rows, n_base)``."""
        model_rows = base_link_regressor if self._sampling.layout.robot.floating else joint_torque_regressor
        rows = np.zeros((len(q), len(self._weights), len(self._columns.names)))
        rows[:, :, : len(self._inertial)] = model_rows(self._tree, q, v, a)[:, :, self._inertial]
        values = {"viscous": v, "coulomb": sign, "offset": np.ones_like(v), "armature": a}
        for term, first in self._drives.items():
            rows[:, self._joints, first + self._joints] = values[term]
        return (rows[:, :, self.independent] * self._weights[:, None]).reshape(-1, self.n_base)


def _base_columns(
    layout: Layout, columns: Columns, independent: NDArray[np.int64] | None
) -> tuple[NDArray[np.int64], Array]:
    """Base columns when only the layout's joints move, and the sizes of their parameters."""
    robot = layout.robot
    random = np.random.default_rng(0)
    n_rows = robot.n_equations
    n = 3 * len(columns.names) // n_rows + 1
    q = np.tile(robot.rest, (n, 1))
    v, a = np.zeros((2, n, robot.model.nv))
    q[:, robot.n_base_q + layout.joints] = random.uniform(-np.pi, np.pi, size=(n, len(layout.joints)))
    v[:, robot.n_base_v + layout.joints] = random.normal(size=(n, len(layout.joints)))
    a[:, robot.n_base_v + layout.joints] = 5.0 * random.normal(size=(n, len(layout.joints)))
    rows = regressor_rows(robot, columns, q, v, a).reshape(-1, len(columns.names))
    order = np.arange(len(columns.names))
    if independent is not None:
        first = np.asarray(independent, dtype=np.int64)
        order = np.concatenate([first, np.setdiff1d(order, first)])
    base = base_parameters(rows[:, order], [columns.names[i] for i in order])
    if independent is not None and base.independent.tolist() != list(range(len(independent))):
        raise InputError(
            "columns that do not stand for the base parameters",
            field="independent",
            remedy=f"give {base.rank} independent ones",
        )
    nominal = np.zeros(len(columns.names))
    nominal[columns.parameter >= 0] = robot.nominal_parameters[columns.inertial]
    for term in columns.drives:
        block = getattr(robot.description.drives, term, None)
        if block is not None:
            column = len(columns.inertial) + columns.drives.index(term) * robot.n_joints
            own = per_joint(block, robot.joint_names, np.zeros(robot.n_joints))
            nominal[column : column + robot.n_joints] = own
    size = np.maximum(np.abs(base.values(nominal[order])), LEAST_SIZE)
    return order[base.independent], size


# What an excitation is optimised for: smooth functions of the information matrix, with their derivatives.

# Eigenvalues below this share of the largest are rounding; at the floor the criterion is flat.
_FLOOR = 1e-15


@dataclass(frozen=True, eq=False)
class CriterionValue:
    """A criterion at one information matrix.

    Attributes:
        value: what is minimised, a logarithm.
        gradient: ``(n, n)``, symmetric, its derivative in the information matrix.
    """

    value: float
    gradient: Array


@dataclass(frozen=True, eq=False)
class ParameterScale:
    """What the largest relative standard deviation is relative to.

    Attributes:
        size: ``(n_base,)`` magnitude of each base parameter [SI].
        std: factor from ``(YᵀY/n)^(-1/2)`` to standard deviations: the noise over the root of the number of
            samples that one repetition takes.
    """

    size: Array
    std: float


class Criterion(ABC):
    """A function of the information matrix ``A = YᵀY/n`` on the base columns.

    ``sharpness`` is the exponent p of the norms that stand for maxima: the larger, the closer to the maximum
    and the less smooth. At most ``log(n_base)/p`` is lost (Boyd and Vandenberghe 2004, section 3.1.5).

    Attributes:
        name: name in :data:`CRITERIA`.
        summary: one line for a person.
        weighted: whether rows are to be divided by the sensors' noise.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    weighted: ClassVar[bool]

    @abstractmethod
    def smooth(self, information: Array, scale: ParameterScale, sharpness: float) -> CriterionValue:
        """The criterion in logarithm, smoothed, with its derivative."""

    @abstractmethod
    def exact(self, information: Array, scale: ParameterScale) -> float:
        """The figure that a person reads."""


class ConditionNumber(Criterion):
    """Condition number of the base regressor, ``σ_max/σ_min`` (Gautier and Khalil 1992)."""

    name: ClassVar[str] = "condition"
    summary: ClassVar[str] = "condition number of the base regressor, unscaled"
    weighted: ClassVar[bool] = False

    def smooth(self, information: Array, scale: ParameterScale, sharpness: float) -> CriterionValue:
        """``½ log(‖λ‖_p ‖λ⁻¹‖_p)`` of the eigenvalues λ of A."""
        values, vectors = _eigen_decomposition(information)
        high = (values / values[-1]) ** sharpness
        low = (values[0] / values) ** sharpness
        value = 0.5 * (np.log(values[-1] / values[0]) + (np.log(high.sum()) + np.log(low.sum())) / sharpness)
        slope = 0.5 * (high / high.sum() - low / low.sum()) / values
        return CriterionValue(float(value), (vectors * slope) @ vectors.T)

    def exact(self, information: Array, scale: ParameterScale) -> float:
        """The condition number."""
        values = _eigen_decomposition(information)[0]
        return float(np.sqrt(values[-1] / values[0]))


class LogDeterminant(Criterion):
    """``-log det A`` by parameter: the volume of the confidence ellipsoid (D-optimality)."""

    name: ClassVar[str] = "log_det"
    summary: ClassVar[str] = "minus the log-determinant of the information matrix, by base parameter"
    weighted: ClassVar[bool] = True

    def smooth(self, information: Array, scale: ParameterScale, sharpness: float) -> CriterionValue:
        """``-log det A / n``; it needs no smoothing."""
        values, vectors = _eigen_decomposition(information)
        n = len(values)
        return CriterionValue(float(-np.log(values).mean()), -(vectors / (n * values)) @ vectors.T)

    def exact(self, information: Array, scale: ParameterScale) -> float:
        """``-log det A / n``."""
        return float(-np.log(_eigen_decomposition(information)[0]).mean())


class LargestRsd(Criterion):
    """Largest predicted relative standard deviation of a base parameter (Xu et al. 2020, eq. 7)."""

    name: ClassVar[str] = "largest_rsd"
    summary: ClassVar[str] = "largest predicted relative standard deviation of a base parameter [percent]"
    weighted: ClassVar[bool] = True

    def smooth(self, information: Array, scale: ParameterScale, sharpness: float) -> CriterionValue:
        """``½ log ‖diag(A⁻¹)/size²‖_p``."""
        values, vectors = _eigen_decomposition(information)
        inverse = (vectors / values) @ vectors.T
        ratio = np.diag(inverse) / scale.size**2
        top = ratio.max()
        power = (ratio / top) ** sharpness
        total = power.sum()
        value = 0.5 * (np.log(top) + np.log(total) / sharpness)
        slope = 0.5 * power / (total * ratio * scale.size**2)
        return CriterionValue(float(value), -(inverse * slope) @ inverse)

    def exact(self, information: Array, scale: ParameterScale) -> float:
        """Percent, of one repetition of the motion."""
        values, vectors = _eigen_decomposition(information)
        variance = ((vectors**2) / values).sum(axis=1)
        return float(100.0 * scale.std * (np.sqrt(variance) / scale.size).max())


CRITERIA: dict[str, type[Criterion]] = {
    criterion.name: criterion for criterion in (ConditionNumber, LogDeterminant, LargestRsd)
}


def make_criterion(name: str) -> Criterion:
    """The criterion of that name; raises UnknownNameError."""
    if name not in CRITERIA:
        raise UnknownNameError("criterion", name, sorted(CRITERIA))
    return CRITERIA[name]()


def _eigen_decomposition(information: Array) -> tuple[Array, Array]:
    """Eigenvalues, rising, none below rounding, and eigenvectors as columns."""
    values, vectors = np.linalg.eigh(information)
    return np.maximum(values, _FLOOR * values[-1]), vectors
