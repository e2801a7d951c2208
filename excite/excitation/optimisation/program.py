"""The nonlinear program, solved through casadi with derivatives from compiled kernels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.excitation.optimisation.limits import JointLimits, LinearRows
from excite.excitation.optimisation.objective import Layout, Sampling
from excite.regressor.adjoint import torque_gradient
from excite.regressor.kernels import inverse_dynamics
from excite.regressor.tree import read_tree
from excite.robot.joint_values import per_joint

# How far rows, in shares of their limits, may be outside and a point still counts.
_ROOM = 1e-3


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a solve ended.

    Attributes:
        x: the best point met at which the rows hold, else where the solver stopped.
        value: objective there.
        feasible: whether they hold there.
        status: the solver's own word.
        evaluations: of objective and gradient.
    """

    x: Array
    value: float
    feasible: bool
    status: str
    evaluations: int


def solve_program(
    objective: ValueAndGradient, rows: LinearRows, start: Array, *, iterations: int
) -> Solution:
    """Minimise a function under linear rows.

    Sequential quadratic programming (Nocedal and Wright 2006, chapter 18) of casadi with a BFGS Hessian, each
    quadratic program by DAQP's dual active set (Arnström, Bemporad, Axehill 2022). With dense rows in few
    variables it takes a fifteenth of an interior-point method's time.

    Args:
        objective: value and exact gradient.
        rows: linear rows.
        start: ``(size,)``.
        iterations: at most.

    Raises:
        KeyboardInterrupt: the user interrupted.
    """
    import casadi

    watched = _Watched(objective, rows)
    callback = _objective_function(watched, len(start))
    x = casadi.MX.sym("x", len(start))
    matrix = casadi.sparsify(casadi.DM(np.where(np.abs(rows.matrix) < 1e-12, 0.0, rows.matrix)))
    options: dict[str, Any] = {
        "hessian_approximation": "limited-memory",
        "lbfgs_memory": max(iterations, 1),
        "max_iter": iterations,
        "max_iter_ls": 8,
        "tol_du": 1e-4,
        "tol_pr": 1e-6,
        "qpsol": "daqp",
        "qpsol_options": {"error_on_fail": False},
        "error_on_fail": False,
        **{f"print_{what}": False for what in ("header", "iteration", "status", "time")},
    }
    problem = {"x": x, "f": callback(x), "g": casadi.mtimes(matrix, x)}
    solver = casadi.nlpsol("excitation", "sqpmethod", problem, options)
    try:
        found = solver(x0=start, lbg=rows.lower, ubg=rows.upper)
    except RuntimeError:
        # casadi turns whatever a callback raises into its own error.
        if watched.raised is not None:
            raise watched.raised from None
        raise
    end = np.asarray(found["x"]).ravel()
    if np.isfinite(end).all():
        watched.look(end)
    return watched.solution(str(solver.stats()["return_status"]), end)


class _Watched:
    """The objective, its last values kept, and the best feasible point at which it was evaluated."""

    def __init__(self, objective: ValueAndGradient, rows: LinearRows) -> None:
        self._objective, self._rows = objective, rows
        self._at: Array | None = None
        self._last: tuple[float, Array] = (np.inf, np.zeros(0))
        self._best: tuple[float, Array | None] = (np.inf, None)
        self.evaluations = 0
        self.raised: BaseException | None = None

    def look(self, x: Array) -> tuple[float, Array]:
        """Value and gradient at ``x``."""
        if self._at is None or not np.array_equal(x, self._at):
            self._last, self._at = self._objective(x), x.copy()
            self.evaluations += 1
            if self._last[0] < self._best[0] and self._rows.excess(x) <= _ROOM:
                self._best = (self._last[0], x.copy())
        return self._last

    def guarded(self, x: Any) -> tuple[float, Array]:
        """The same for a casadi vector; what is raised is kept, since casadi would lose it."""
        try:
            return self.look(np.asarray(x).ravel())
        except BaseException as error:
            self.raised = error
            raise

    def solution(self, status: str, end: Array) -> Solution:
        """What was met."""
        value, best = self._best
        if best is None:
            return Solution(end, self._last[0], False, status, self.evaluations)
        return Solution(best, value, True, status, self.evaluations)


def _gradient_function(watched: _Watched, size: int) -> Any:
    """The gradient as a casadi function; the class is made here, where casadi is loaded."""
    import casadi

    class Gradient(casadi.Callback):
        def __init__(self) -> None:
            casadi.Callback.__init__(self)
            self.construct("gradient", {})

        def get_n_in(self) -> int:
            return 2

        def get_sparsity_in(self, i: int) -> casadi.Sparsity:
            return casadi.Sparsity.dense(size if i == 0 else 1, 1)

        def get_sparsity_out(self, i: int) -> casadi.Sparsity:
            return casadi.Sparsity.dense(1, size)

        def eval(self, arg: Sequence[casadi.DM]) -> Sequence[casadi.DM]:
            return [casadi.DM(watched.guarded(arg[0])[1][None])]

    return Gradient()


def _objective_function(watched: _Watched, size: int) -> Any:
    """The objective as a casadi function with its gradient."""
    import casadi

    gradient = _gradient_function(watched, size)

    class Value(casadi.Callback):
        def __init__(self) -> None:
            casadi.Callback.__init__(self)
            self.construct("value", {})

        def get_sparsity_in(self, i: int) -> casadi.Sparsity:
            return casadi.Sparsity.dense(size, 1)

        def has_jacobian(self) -> bool:
            return True

        def get_jacobian(
            self, name: str, inames: Sequence[str], onames: Sequence[str], options: Mapping[str, Any]
        ) -> Any:
            return gradient

        def eval(self, arg: Sequence[casadi.DM]) -> Sequence[casadi.DM]:
            return [casadi.DM(watched.guarded(arg[0])[0])]

    return Value()


# Nonlinear limits by an augmented Lagrangian, so that the program itself keeps only linear rows.

ValueAndGradient = Callable[[Array], tuple[float, Array]]
RowsAndJacobian = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class AugmentedLagrangian:
    """``f(x) + (μ/2) Σ (max(0, λ/μ − g(x))² − (λ/μ)²)`` for rows ``g(x) ≥ 0`` (Nocedal and Wright 2006, 17.4).

    A random start violates rows by much, which leaves a sequence of quadratic programs without a feasible one;
    a penalty pulls it in, and multipliers make the penalty's bias vanish.

    Attributes:
        objective: ``f`` and its gradient.
        rows: ``g`` and its Jacobian, None where there are none.
        multipliers: ``λ``, one a row.
        weight: ``μ``.
    """

    objective: ValueAndGradient
    rows: RowsAndJacobian | None
    multipliers: Array
    weight: float

    def __call__(self, x: Array) -> tuple[float, Array]:
        """Value and gradient."""
        value, gradient = self.objective(x)
        if self.rows is None:
            return value, gradient
        left, jacobian = self.rows(x)
        lack = np.maximum(0.0, self.multipliers / self.weight - left)
        value += 0.5 * self.weight * float((lack**2).sum() - ((self.multipliers / self.weight) ** 2).sum())
        return value, gradient - self.weight * (lack @ jacobian)

    def updated(self, x: Array) -> Array:
        """Multipliers for the next solve, from where this one ended."""
        if self.rows is None:
            return self.multipliers
        return np.maximum(0.0, self.multipliers - self.weight * self.rows(x)[0])


# Torque limits as smooth constraints, with their gradients.

# The norm that stands for the maximum over time exceeds it by n^(1/EXPONENT) at most.
_EXPONENT = 100.0


class TorqueLimits:
    """The largest drive torque of each moved joint over time, as a share of its limit.

    Torques are those of the rigid bodies with the drives' own viscous friction and inertia; Coulomb friction
    takes its share of the limit. The base of a floating robot stands still and contacts do not matter, since no
    leg moves.

    Args:
        layout: what the variables stand for.
        limits: joint limits.
        time: ``(n,)`` at which torques are taken [s].
    """

    def __init__(self, layout: Layout, limits: JointLimits, time: Array) -> None:
        robot, joints = layout.robot, layout.joints
        self._sampling, self._tree = Sampling(layout, time), read_tree(robot.model)
        drives, nothing = robot.description.drives, np.zeros(robot.n_joints)
        blocks = (drives.viscous, drives.coulomb, drives.armature)
        viscous, coulomb, armature = (per_joint(block, robot.joint_names, nothing) for block in blocks)
        self._viscous, self._armature = viscous[joints], armature[joints]
        self._room = np.maximum(limits.torque[joints] - coulomb[joints], 1e-6)

    def torques(self, x: Array) -> Array:
        """Torques in shares of what the limits leave, ``(n, n_moved)``."""
        whole = self._sampling.whole(x)
        return self._torques(whole.q, whole.v, whole.a)

    def peaks(self, x: Array) -> Array:
        """Their largest magnitudes, ``(n_moved,)``."""
        return np.asarray(np.abs(self.torques(x)).max(axis=0))

    def rows(self, x: Array, chosen: NDArray[np.intp]) -> tuple[Array, Array]:
        """What is left of the limits of the moved joints ``chosen``, ``(m,)``, and its gradient ``(m, size)``."""
        whole = self._sampling.whole(x)
        q, v, a = whole.q, whole.v, whole.a
        layout = self._sampling.layout
        robot, first = layout.robot, layout.robot.n_base_v
        share = self._torques(q, v, a)
        left, slopes = np.empty(len(chosen)), np.empty((len(chosen), layout.size))
        for row, i in enumerate(chosen):
            top = np.abs(share[:, i]).max()
            power = (np.abs(share[:, i]) / top) ** (_EXPONENT - 1.0)
            total = (power * np.abs(share[:, i]) / top).sum()
            left[row] = 1.0 - top * total ** (1.0 / _EXPONENT)
            pull = power * total ** (1.0 / _EXPONENT - 1.0) * np.sign(share[:, i]) / self._room[i]
            weights = np.zeros((len(q), robot.n_joints))
            weights[:, layout.joints[i]] = pull
            found = torque_gradient(self._tree, q, v, a, weights)
            by_q, by_v, by_a = (part[:, first + layout.joints] for part in (found.q, found.v, found.a))
            by_v[:, i] += pull * self._viscous[i]
            by_a[:, i] += pull * self._armature[i]
            slopes[row] = -self._sampling.pulled(by_q, by_v, by_a)
        return left, slopes

    def _torques(self, q: Array, v: Array, a: Array) -> Array:
        columns = self._sampling.layout.robot.n_base_v + self._sampling.layout.joints
        tau = inverse_dynamics(self._tree, q, v, a)[:, columns]
        return np.asarray((tau + self._viscous * v[:, columns] + self._armature * a[:, columns]) / self._room)
