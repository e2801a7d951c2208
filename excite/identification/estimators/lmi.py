"""Physically consistent parameters: every pseudo-inertia positive definite, as a cone program.

Wensing, Kim and Slotine (IEEE RA-L 2018): a body of positive density exists exactly where its pseudo-inertia
is positive definite, which the inertia's definiteness alone does not ensure (triangle inequality).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import clarabel
import numpy as np
from scipy import sparse

from excite.identification.constraints.assemble import model_constraints
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.base import Estimate, Estimator, SolveStatus
from excite.identification.estimators.checked import checked_estimate, no_solution
from excite.identification.estimators.ridge import Ridge, ridge
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import iterate_weights, regression
from excite.robot.robot import Array

_UPPER = np.triu_indices(4)
# clarabel's order of a symmetric matrix: upper triangle by columns, off-diagonal terms times √2.
_BY_COLUMNS = tuple(sorted(range(10), key=lambda k: (_UPPER[1][k], _UPPER[0][k])))
_I, _J = _UPPER[0][list(_BY_COLUMNS)], _UPPER[1][list(_BY_COLUMNS)]
_ROOT = np.where(_I == _J, 1.0, np.sqrt(2.0))


@dataclass(frozen=True, eq=False)
class PseudoInertiaCone:
    """``matrix · z + bound`` holds, segment by segment, ten entries of a matrix that must be PSD.

    Attributes:
        matrix: ``(10·n_cones, n_free)``.
        bound: ``(10·n_cones,)``.
    """

    matrix: Array
    bound: Array

    def least_eigenvalue(self, z: Array) -> float:
        """Least eigenvalue over all segments; negative where the cone is left."""
        return float(np.linalg.eigvalsh(_matrices(self.matrix @ z + self.bound))[:, 0].min(initial=np.inf))


class PhysicallyConsistent(Estimator):
    """The objective and linear constraints of ``qp`` with every pseudo-inertia positive definite."""

    name: ClassVar[str] = "lmi"
    title: ClassVar[str] = "as qp, with physically consistent bodies (pseudo-inertia cones)"
    consistent: ClassVar[bool] = True

    def estimate(self, problem: IdentificationProblem, settings: EstimatorSettings) -> Estimate:
        """See :meth:`Estimator.estimate`; uses every setting but ``sphere_subdivisions``."""
        rows = iterate_weights(regression(problem))
        objective = ridge(rows, settings)
        model = model_constraints(rows, settings)
        linear = objective.constraints(model.linear)
        cones = pseudo_inertia_cones(problem, objective, settings.inertia_floor)
        solution = _solve(objective.target, linear, cones)
        z, dual = objective.target + np.array(solution.x), np.array(solution.z)
        best = checked_estimate(
            self.name, rows, objective, z, _distance(objective.target, linear, cones, z, dual), linear
        )
        best = replace(best, total_mass=model.total_mass)
        if "Infeasible" in str(solution.status):
            nothing = LinearConstraints(np.zeros((0, len(z))), np.zeros(0), ())
            best = checked_estimate(self.name, rows, objective, objective.target, 0.0, nothing)
            raise no_solution(SolveStatus.INFEASIBLE, best)
        if best.status is SolveStatus.SOLVED and cones.least_eigenvalue(z) < -1e-6:
            best = replace(best, status=SolveStatus.VIOLATED)
        if best.status is not SolveStatus.SOLVED:
            raise no_solution(best.status, best)
        return best


def pseudo_inertia_cones(problem: IdentificationProblem, objective: Ridge, floor: float) -> PseudoInertiaCone:
    """Cones of all segments that may move, each scaled by its own nominal mass and size.

    With ``D = diag(1/(r√m), 1/(r√m), 1/(r√m), 1/√m)`` the matrix ``D J D`` of a hand is as large as that of
    a trunk. Its least eigenvalue stays above ``floor`` times the nominal one's.
    """
    n_segments = problem.n_inertial // 10
    moving = [k for k in range(n_segments) if k not in problem.unmeasured]
    unit = np.zeros((10, 4, 4))
    for k in range(10):
        unit[k] = pseudo_inertia_matrices(np.eye(10)[k])[0]
    nominal = pseudo_inertia_matrices(problem.prior[: problem.n_inertial])
    rows, bound = np.zeros((10 * len(moving), problem.n_params)), np.zeros(10 * len(moving))
    for place, k in enumerate(moving):
        mass = max(nominal[k, 3, 3], 1e-3)
        radius = np.sqrt(max(np.trace(nominal[k, :3, :3]) / mass, 1e-4))
        d = np.array([1.0 / radius] * 3 + [1.0]) / np.sqrt(mass)
        scale = np.outer(d, d)
        part = slice(10 * place, 10 * place + 10)
        rows[part, 10 * k : 10 * k + 10] = (unit * scale)[:, _I, _J].T * _ROOT[:, None]
        least = floor * max(float(np.linalg.eigvalsh(nominal[k] * scale)[0]), 1e-6)
        bound[part] = -np.where(_I == _J, least, 0.0)
    return PseudoInertiaCone(objective.rotate(rows), bound + rows @ objective.center)


def _solve(target: Array, linear: LinearConstraints, cones: PseudoInertiaCone) -> clarabel.DefaultSolution:
    """``min ½‖w‖²`` over ``w = z − d`` with slacks in ``{0} × ℝ₊ × PSD…``.

    Centred at the unconstrained optimum, where the objective is small: relative tolerances then mean
    something.
    """
    n = len(target)
    matrix = sparse.csc_matrix(np.vstack([-linear.matrix, -cones.matrix]))
    bound = np.concatenate([linear.matrix @ target - linear.bound, cones.matrix @ target + cones.bound])
    kinds = [
        clarabel.ZeroConeT(linear.n_equal),
        clarabel.NonnegativeConeT(len(linear.bound) - linear.n_equal),
        *[clarabel.PSDTriangleConeT(4)] * (len(cones.bound) // 10),
    ]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    solver = clarabel.DefaultSolver(sparse.eye(n, format="csc"), np.zeros(n), matrix, bound, kinds, settings)
    return solver.solve()


def _distance(
    target: Array, linear: LinearConstraints, cones: PseudoInertiaCone, z: Array, dual: Array
) -> float:
    """Bound on the distance to the optimum, as in ``distance_to_optimum``, duals put into their cones."""
    n_linear = len(linear.bound)
    flat = dual[:n_linear].copy()
    flat[linear.n_equal :] = np.maximum(flat[linear.n_equal :], 0.0)
    values, vectors = np.linalg.eigh(_matrices(dual[n_linear:]))
    projected = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
    cone = (projected[:, _I, _J] * _ROOT).ravel()
    stationarity = z - target - linear.matrix.T @ flat - cones.matrix.T @ cone
    slack = flat @ (linear.matrix @ z - linear.bound) + cone @ (cones.matrix @ z + cones.bound)
    return float(np.sqrt(stationarity @ stationarity + 2.0 * abs(slack)))


def _matrices(entries: Array) -> Array:
    """Ten scaled entries a segment as symmetric matrices ``(n, 4, 4)``."""
    ten = entries.reshape(-1, 10) / _ROOT
    matrices = np.empty((len(ten), 4, 4))
    matrices[:, _I, _J] = ten
    matrices[:, _J, _I] = ten
    return matrices
