"""Estimators by cone programs: bodies that exist, within bounds."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, cast

import clarabel
import numpy as np
from scipy import sparse
from scipy.linalg import LinAlgError, lu_factor, lu_solve

from excite.arrays import Array
from excite.identification.constraints.cones import (
    Cones,
    body_ellipsoids,
    com_ellipsoids,
    com_in_ellipsoids,
    feasibility_cones,
    inertia_cones,
    mass_in_ellipsoids,
    pseudo_inertia_cones,
)
from excite.identification.constraints.linear import (
    MASS_AND_FIRST_MOMENT,
    LinearConstraints,
    equivalent_boxes,
    known_total_mass,
    model_constraints,
    non_negative_masses,
    stack_constraints,
    stated_bounds,
    total_mass,
)
from excite.identification.estimators.estimator import (
    VIOLATION_TOLERANCE,
    Estimate,
    Estimator,
    SettingsT,
    SolveStatus,
    best_known,
    checked_estimate,
    no_solution,
)
from excite.identification.estimators.projection import ProjectionAnswer
from excite.identification.estimators.scaled_problem import Ridge, build_ridge, pullback_metric
from excite.identification.estimators.settings import (
    BodySettings,
    EstimatorSettings,
    ParameterBoundsSettings,
    PullSettings,
    StatedBoundsSettings,
    SymmetrySettings,
    stated,
)
from excite.identification.inertia import ROUNDING, pseudo_inertia_matrices
from excite.identification.physical.cone_program import solve_clarabel
from excite.identification.physical.default_bounds import bound_rows, default_bounds
from excite.identification.regression import Regression, prior_std
from excite.rows.settings import number, word

# Nearest points under linear constraints and cones: clarabel's answer, refined and judged without its word.

_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class ConicProblem:
    """``min ½ ‖z − target‖²`` with linear constraints and cones.

    Attributes:
        target: ``(n,)``.
        linear: rows on ``z``, of unit length.
        cones: blocks on ``z``.
    """

    target: Array
    linear: LinearConstraints
    cones: tuple[Cones, ...]


ConicSolver = Callable[[ConicProblem], ProjectionAnswer]


def stack_rows(problem: ConicProblem) -> tuple[Array, Array]:
    """All rows ``M`` and offsets ``c``: ``M z + c`` lies in ``{0} × ℝ₊ × cones``."""
    matrices = [
        problem.linear.matrix,
        *(cones.matrix.reshape(-1, cones.matrix.shape[2]) for cones in problem.cones),
    ]
    bounds = [-problem.linear.bound, *(cones.bound.ravel() for cones in problem.cones)]
    return np.vstack(matrices), np.concatenate(bounds)


def interior_point(problem: ConicProblem, tolerance: float = _TOLERANCE) -> ProjectionAnswer:
    """Clarabel on one thread.

    Centred at the unconstrained optimum, where the objective is small: relative tolerances then mean
    something.
    """
    matrix, offset = stack_rows(problem)
    linear, n = problem.linear, len(problem.target)
    kinds = [
        clarabel.ZeroConeT(linear.n_equal),
        clarabel.NonnegativeConeT(len(linear.bound) - linear.n_equal),
    ]
    for cones in problem.cones:
        kind = clarabel.PSDTriangleConeT(cones.order) if cones.order else clarabel.SecondOrderConeT(4)
        kinds += [kind] * len(cones.bound)
    found = solve_clarabel(
        np.ones(n),
        np.zeros(n),
        sparse.csc_matrix(-matrix),
        matrix @ problem.target + offset,
        kinds,
        tolerance,
    )
    return ProjectionAnswer(problem.target + found.x, found.dual, found.infeasible)


def refine_answer(problem: ConicProblem, answer: ProjectionAnswer) -> ProjectionAnswer:
    """Newton's steps on ``λ = Π(λ − M z(λ) − c)`` with ``z = target + Mᵀλ`` (Qi and Sun 1993).

    From an interior-point answer they converge quadratically to rounding where the constraints are not
    redundant; a shorter step is taken where the full one does not help. The answer whose recomputed
    distance to the optimum is smaller is returned.
    The default method compares solves with one another: with clarabel's own answers, at tolerances of 1e-12, it
    chose other settings for a simulated Jaco2.
    """
    matrix, offset = stack_rows(problem)
    gram = matrix @ matrix.T
    start = matrix @ problem.target + offset

    def residual_of(dual: Array) -> tuple[Array, Array]:
        value = dual - start - gram @ dual
        return value, dual - _project_dual(problem, value)

    dual = _project_dual(problem, answer.multipliers)
    value, residual = residual_of(dual)
    error = float(np.linalg.norm(residual))
    for _ in range(12):
        if error < 1e-14 * max(1.0, float(np.linalg.norm(dual))):
            break
        factor = lu_factor(_projection_jacobian(problem, value, gram), overwrite_a=True, check_finite=False)
        change = lu_solve(factor, residual, check_finite=False)
        for share in (1.0, 0.3, 0.1, 0.03):
            tried = dual - share * change
            value_there, residual_there = residual_of(tried)
            size = float(np.linalg.norm(residual_there))
            if size < error:
                break
        else:
            break
        dual, value, residual, error = tried, value_there, residual_there, size
    better = ProjectionAnswer(problem.target + matrix.T @ dual, dual)
    return better if conic_distance(problem, better) < conic_distance(problem, answer) else answer


def _split_vector(problem: ConicProblem, vector: Array) -> tuple[Array, list[Array]]:
    place = len(problem.linear.bound)
    head, rest = vector[:place], []
    for cones in problem.cones:
        rest.append(vector[place : place + cones.bound.size].reshape(cones.bound.shape))
        place += cones.bound.size
    return head, rest


def _project_dual(problem: ConicProblem, vector: Array) -> Array:
    """Nearest point of the dual cone; multipliers of equalities are free."""
    head, rest = _split_vector(problem, vector)
    flat = np.maximum(head, 0.0)
    flat[: problem.linear.n_equal] = head[: problem.linear.n_equal]
    blocks = (cones.projected(part).ravel() for cones, part in zip(problem.cones, rest, strict=True))
    return np.concatenate([flat, *blocks])


def _projection_jacobian(problem: ConicProblem, vector: Array, gram: Array) -> Array:
    """Derivative of ``λ − Π(λ − c − gram·λ)``, block by block."""
    head, rest = _split_vector(problem, vector)
    flat = (head > 0.0).astype(float)
    flat[: problem.linear.n_equal] = 1.0
    full = np.eye(len(vector))
    part = np.arange(len(head))
    full[part] += flat[:, None] * gram[: len(head)]
    full[part, part] -= flat
    place = len(head)
    for cones, values in zip(problem.cones, rest, strict=True):
        for block in cones.derivative(values):
            rows = slice(place, place + cones.size)
            full[rows] += block @ gram[rows]
            full[rows, rows] -= block
            place += cones.size
    # Keeps redundant constraints, whose multipliers are not unique, from making the refinement's matrix singular.
    full[np.diag_indices_from(full)] += 1e-11
    return full


def conic_violations(problem: ConicProblem, z: Array) -> dict[str, float]:
    """Largest violation of each kind of constraint at a point, from the point alone."""
    worst = problem.linear.worst_violations(z)
    for cones in problem.cones:
        for label, margin in zip(cones.labels, cones.margin(cones.values(z)), strict=True):
            kind = label.partition(":")[0]
            worst[kind] = max(worst.get(kind, 0.0), -float(margin))
    return worst


def conic_distance(problem: ConicProblem, answer: ProjectionAnswer) -> float:
    """Bound on the distance from an answer to the optimum, from its duality gap.

    Multipliers are put into their cones first; nothing that the solver says of itself is used. Infinite where they are
    not finite.
    """
    if not np.isfinite(answer.multipliers).all():
        return np.inf
    matrix, offset = stack_rows(problem)
    dual = _project_dual(problem, answer.multipliers)
    stationarity = answer.z - problem.target - matrix.T @ dual
    slack = float(dual @ (matrix @ answer.z + offset))
    return float(np.sqrt(stationarity @ stationarity + 2.0 * abs(slack)))


# From an objective, constraints and a conic solver to an estimate that has been checked.


@dataclass(frozen=True, eq=False)
class Program:
    """What a method asks of a solver: the objective's least value under constraints on the parameters.

    Attributes:
        objective: the objective.
        linear: linear rows.
        cones: cones of bodies.
    """

    objective: Ridge
    linear: LinearConstraints
    cones: tuple[Cones, ...]


Limits = tuple[list[LinearConstraints], tuple[Cones, ...]]
"""Linear rows and cones that parameters ``θ`` have to meet."""


class ConicEstimator(Estimator[SettingsT]):
    """A pull to the nominal model under linear rows and cones; what its solver finds is recomputed.

    Args:
        solver: finds the optimum; not trusted.

    Attributes:
        ties_mass: whether the total mass is a further row, where it was weighed or the rows tell it.
    """

    ties_mass: ClassVar[bool] = True

    def __init__(self, solver: ConicSolver = interior_point):
        self._solver = solver

    @abstractmethod
    def limits(self, rows: Regression, settings: SettingsT) -> Limits:
        """What parameters have to meet, beside the total mass.

        Args:
            rows: condensed and weighted rows.

        Raises:
            InputError: bounds or ellipsoids that leave nothing or are none.
        """

    def objective(self, rows: Regression, settings: SettingsT) -> Ridge:
        """What is to be small."""
        return build_ridge(rows, cast(PullSettings, settings))

    def solve(self, rows: Regression, settings: SettingsT) -> Estimate:
        """See :meth:`Estimator.solve`."""
        problem = rows.problem
        mass = known_total_mass(rows, settings) if self.ties_mass else None
        parts, cones = self.limits(rows, settings)
        linear = stack_constraints([total_mass(problem, mass), *parts], problem.n_params)
        program = Program(self.objective(rows, settings), linear, cones)
        best = replace(conic_estimate(self.name, rows, program, self._solver), total_mass=mass)
        return consistent_or_raised(best) if self.consistent else best


def conic_estimate(method: str, rows: Regression, program: Program, solver: ConicSolver) -> Estimate:
    """The answer to a program, checked.

    Args:
        method: name of the estimator.
        solver: finds the optimum; not trusted.

    Raises:
        NoSolutionError: no point, or an answer that its recomputation refuses; ``best`` is the best point known
            that meets the constraints, the unconstrained optimum where there is none.
    """
    objective, linear = program.objective, program.linear
    problem = ConicProblem(
        objective.target,
        objective.constraints(linear),
        tuple(objective.cones(part) for part in program.cones),
    )
    answer, goals = solver(problem), list[Array]()
    if answer.infeasible:
        status = SolveStatus.INFEASIBLE if _is_ray(problem, answer) else SolveStatus.NOT_OPTIMAL
    else:
        if np.isfinite(answer.z).all() and np.isfinite(answer.multipliers).all():
            # Where that fails the answer stands as it is; its distance decides.
            with suppress(LinAlgError):
                answer = refine_answer(problem, answer)
        distance = conic_distance(problem, answer)
        worst = conic_violations(problem, answer.z) if np.isfinite(distance) else {}
        reached = problem.linear.labels_reached(answer.z, VIOLATION_TOLERANCE)
        best = checked_estimate(method, rows, objective, answer.z, distance, worst)
        if best.status is SolveStatus.SOLVED:
            return replace(best, active=reached)
        status, goals = best.status, [answer.z]
    known = best_known(method, rows, objective, linear, goals, partial(conic_violations, problem))
    raise no_solution(status, replace(known, status=status))


def consistent_or_raised(best: Estimate) -> Estimate:
    """The estimate if every pseudo-inertia, recomputed, is positive semidefinite; raises NoSolutionError otherwise."""
    least = np.linalg.eigvalsh(pseudo_inertia_matrices(best.parameters[: best.regression.problem.n_inertial]))
    moving = np.ones(len(least), dtype=bool)
    moving[list(best.regression.problem.unmeasured)] = False
    if least[moving, 0].min(initial=0.0) < -ROUNDING:
        raise no_solution(SolveStatus.VIOLATED, replace(best, status=SolveStatus.VIOLATED))
    return best


def _is_ray(problem: ConicProblem, answer: ProjectionAnswer) -> bool:
    """Whether multipliers prove that there is no point: ``λ`` in the dual cone, ``Mᵀλ = 0``, ``λᵀc < 0``."""
    matrix, offset = stack_rows(problem)
    ray = answer.multipliers
    if not np.isfinite(ray).all():
        return False
    value = float(ray @ offset)
    return value < 0.0 and float(np.linalg.norm(matrix.T @ ray)) < 1e-6 * abs(value)


# The default: bodies that can exist, believed as far as the log supports the nominal model.


@dataclass(frozen=True)
class AdaptiveSettings(EstimatorSettings):
    """Settings of ``adaptive``.

    Attributes:
        alpha: the α of eq. (4) of Jovic et al. 2015, in units in which prior and noise have unit variance; None has
            :func:`~excite.identification.identify.identify` choose it for an arm, and is 1 elsewhere.
        terms: whether identify may add terms of drives and sensors to an arm's equations.
        inertia_floor: relative, so that it fits hands and trunks.
    """

    alpha: float | None = number(
        None, "1", 1e-12, 1e12, "weight of the nominal model against the data", optional=True
    )
    terms: str = word(
        "chosen",
        ("chosen", "stated"),
        "terms beside rigid bodies: those that the log asks for, or stated ones only",
    )
    inertia_floor: float = number(
        0.01, "1", 0.0, 0.9, "least moment of inertia, as share of the nominal least one of the segment"
    )


class Adaptive(ConicEstimator[AdaptiveSettings]):
    """Pseudo-inertias positive definite (Wensing, Kim and Slotine 2018), near the nominal ones, and nothing else.

    Unlike ``lmi`` it keeps no centre of mass in a box of the link's shape, since people hang things on links, and no
    sign of a friction. What rigid bodies cannot explain is left to terms of drives and sensors where blocks of the
    log that are left out ask for them (:mod:`excite.identification.adaptation`): without these, bodies that can
    exist predict worse than least squares, and bodies that cannot take their place.
    """

    name = "adaptive"
    title = (
        "bodies that can exist, with the nominal model's weight and terms of drives and "
        "sensors that the log asks for"
    )
    consistent = True
    adapts = True
    use = (
        "most logs: bodies that can exist, so that a model is always written, and predictions at least as good as "
        "least squares'"
    )
    settings_class = AdaptiveSettings
    guarantees = (
        "within the stated distance of the global optimum; every body can exist (least eigenvalue of its "
        "pseudo-inertia at least -1e-9, recomputed), and the total mass holds where it was weighed or the "
        "record tells it"
    )

    def limits(self, rows: Regression, settings: AdaptiveSettings) -> Limits:
        """See :meth:`ConicEstimator.limits`."""
        return [], (pseudo_inertia_cones(rows.problem, settings.inertia_floor),)

    def objective(self, rows: Regression, settings: AdaptiveSettings) -> Ridge:
        """See :meth:`ConicEstimator.objective`."""
        alpha = 1.0 if settings.alpha is None else settings.alpha
        problem = rows.problem
        if problem.drive_spread is not None:
            # Drives keep their expected spread whatever the weight of the nominal bodies is.
            problem = replace(problem, drive_spread=np.sqrt(alpha) * problem.drive_spread)
            rows = replace(rows, problem=problem)
        pull = PullSettings(
            prior_spread=settings.prior_spread, segment_spread=settings.segment_spread, alpha=alpha
        )
        return build_ridge(rows, pull)


# Physically feasible inertias within bounds of mass and first moment (CLS-2 of Golluccio et al. 2020).


@dataclass(frozen=True)
class Cls2Settings(ParameterBoundsSettings, PullSettings):
    """Settings of ``cls2``: the pull, the bounds of masses and first moments, the least inertia."""


class PhysicallyFeasible(ConicEstimator[Cls2Settings]):
    """Least squares with a pull to nominal under eq. (3): ``m > 0`` and inertia about the centre of mass ``≻ 0``.

    Sousa and Cortesão's linear matrix inequality, with bounds on masses and first moments. The regularisation
    that the paper asks for is the pull of eq. (4) of Jovic et al. 2015, weight ``alpha``.
    """

    name = "cls2"
    title = "physically feasible inertias, bounded masses and first moments (CLS-2)"
    use = (
        "comparison with published CLS-2 results: masses and first moments within bounds; bodies may break the "
        "triangle inequality"
    )
    settings_class = Cls2Settings
    guarantees = (
        "within the stated distance of the global optimum; masses positive, inertias about the centres of mass "
        "positive definite, masses and first moments within their bounds; the triangle inequality need not hold"
    )

    ties_mass = False

    def limits(self, rows: Regression, settings: Cls2Settings) -> Limits:
        """See :meth:`ConicEstimator.limits`."""
        problem = rows.problem
        parts = [non_negative_masses(problem), bound_rows(rows, settings, MASS_AND_FIRST_MOMENT)]
        return parts, (feasibility_cones(problem, settings.inertia_floor),)


# Physically consistent bodies that fit into ellipsoids (CLS-3 of Golluccio et al. 2020).


@dataclass(frozen=True)
class Cls3Settings(StatedBoundsSettings, PullSettings):
    """Settings of ``cls3``.

    Attributes:
        com_ellipsoids: where each centre of mass lies, ``(n_segments, 4, 4)``: ``[x; 1]ᵀ Q [x; 1] ≥ 0`` for
            points ``x`` [m] of the ellipsoid in the joint frame (eq. 6 of Golluccio et al. 2020); None derives them
            from the boxes.
        body_ellipsoids: where each body's mass lies, likewise.
    """

    com_ellipsoids: Array | None = field(default=None, metadata=stated("m", "where each centre of mass lies"))
    body_ellipsoids: Array | None = field(default=None, metadata=stated("m", "where each body's mass lies"))


class DensityRealisable(ConicEstimator[Cls3Settings]):
    """Least squares with a pull to nominal; every body has a density that is not negative inside its ellipsoid.

    Pseudo-inertias positive definite (eq. 4), centres of mass in ellipsoids (eq. 6), mass distributions in
    ellipsoids (``tr(J Q) ≥ 0``, Wensing, Kim and Slotine 2018), and the total mass where it is known. Ellipsoids
    that are not given come from the boxes of the centres of mass: inscribed for these, least circumscribed
    for the bodies, each grown until the nominal model fits.
    """

    name = "cls3"
    title = "physically consistent bodies inside ellipsoids (CLS-3)"
    consistent = True
    use = (
        "models to simulate or to hand over: every body can exist with its mass inside its ellipsoid; keeps stated "
        "bounds"
    )
    settings_class = Cls3Settings
    guarantees = (
        "within the stated distance of the global optimum; every body can exist with its mass inside its ellipsoid "
        "(least eigenvalue of its pseudo-inertia at least -1e-9, recomputed) and its centre of mass in its own"
    )

    def limits(self, rows: Regression, settings: Cls3Settings) -> Limits:
        """See :meth:`ConicEstimator.limits`."""
        problem = rows.problem
        nominal = problem.prior[: problem.n_inertial]
        boxes = settings.com_boxes if settings.com_boxes is not None else equivalent_boxes(problem.robot)
        if settings.bounds is not None:
            # Ellipsoids inside a stated box would cut its corners off; they grow with it, its sides stay.
            wider = settings.bounds.boxes(tuple(segment.link for segment in problem.robot.segments), boxes)
            boxes = np.stack(
                [np.minimum(boxes[:, 0], wider[:, 0]), np.maximum(boxes[:, 1], wider[:, 1])], axis=1
            )
        centers, bodies = settings.com_ellipsoids, settings.body_ellipsoids
        centers = com_ellipsoids(nominal, boxes) if centers is None else centers
        bodies = body_ellipsoids(nominal, boxes) if bodies is None else bodies
        parts = [non_negative_masses(problem), mass_in_ellipsoids(problem, bodies)]
        if settings.bounds is not None:
            parts.append(stated_bounds(problem, settings.bounds, default_bounds(problem.robot, settings)))
        cones = (pseudo_inertia_cones(problem, settings.inertia_floor), com_in_ellipsoids(problem, centers))
        return parts, cones


# The constrained quadratic program of eq. (4), Jovic et al., Humanoids 2015.


@dataclass(frozen=True)
class QpSettings(SymmetrySettings, BodySettings, PullSettings):
    """Settings of ``qp``: the pull, boxes, symmetry, and the least inertia."""


class QuadraticProgram(ConicEstimator[QpSettings]):
    """Least squares with a pull to the nominal model, under the constraints of Jovic et al. 2015.

    Channels are weighted as in ``wls``. Inertias about the joint frames are positive definite as matrices, which holds
    on every vector and not only on the 10 242 of the paper. Scaling of the pull: see
    :class:`~excite.identification.estimators.scaled_problem.Ridge`.
    """

    name = "qp"
    title = "constrained quadratic program of Jovic et al. 2015"
    use = (
        "comparison with the paper: standard parameters near the nominal model, from short motions too; bodies that "
        "cannot exist are named in the result"
    )
    settings_class = QpSettings
    guarantees = (
        "within the stated distance of the global optimum; masses not negative, boxes of the centres of mass and "
        "positive definite inertias about the joint frames hold, the total mass where it was weighed or the record "
        "tells it, symmetry where it is asked for; the triangle inequality need not"
    )

    def limits(self, rows: Regression, settings: QpSettings) -> Limits:
        """See :meth:`ConicEstimator.limits`."""
        cones = (inertia_cones(rows.problem, settings.inertia_floor),)
        return [model_constraints(rows.problem, settings)], cones


# Physically consistent parameters: every pseudo-inertia positive definite, as a cone program.
#
# Wensing, Kim and Slotine (IEEE RA-L 2018): a body of positive density exists exactly where its pseudo-
# inertia is positive definite, which the inertia's definiteness alone does not ensure (triangle inequality).


@dataclass(frozen=True)
class LmiSettings(SymmetrySettings, BodySettings, PullSettings):
    """Settings of ``lmi``.

    Attributes:
        regulariser: distance from the nominal model; ``pullback`` is that of Lee, Wensing and Park 2020, which does not
            depend on units or frames.
    """

    regulariser: str = word("euclidean", ("euclidean", "pullback"), "distance from the nominal model")


class PhysicallyConsistent(ConicEstimator[LmiSettings]):
    """The objective and linear constraints of ``qp`` with every pseudo-inertia positive definite.

    ``regulariser`` chooses the distance from the nominal model: ``euclidean`` in units of the spreads, or ``pullback``.
    """

    name = "lmi"
    title = "as qp, with physically consistent bodies (pseudo-inertia cones)"
    consistent = True
    use = "models to simulate or to control with: near the nominal model, and every body can exist"
    settings_class = LmiSettings
    guarantees = (
        "within the stated distance of the global optimum; every body can exist (least eigenvalue of its "
        "pseudo-inertia at least -1e-9, recomputed), and masses and boxes hold, the total mass where it "
        "was weighed or the record tells it, symmetry where it is asked for"
    )

    def limits(self, rows: Regression, settings: LmiSettings) -> Limits:
        """See :meth:`ConicEstimator.limits`."""
        cones = (pseudo_inertia_cones(rows.problem, settings.inertia_floor),)
        return [model_constraints(rows.problem, settings)], cones

    def objective(self, rows: Regression, settings: LmiSettings) -> Ridge:
        """See :meth:`ConicEstimator.objective`."""
        problem, spreads = rows.problem, settings.spreads(rows.problem.robot)
        pullback = settings.regulariser == "pullback"
        metric = pullback_metric(problem, spreads, prior_std(problem, spreads)) if pullback else None
        return build_ridge(rows, settings, metric)
