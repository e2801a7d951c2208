"""Retrieval of physical parameters by global optimisation (Xu et al., IEEE Access 2020, eq. 15 to 18)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.errors import InputError, NoSolutionError
from excite.identification.estimators.estimator import (
    Estimate,
    Estimator,
    SolveStatus,
    estimate_at,
    no_solution,
)
from excite.identification.estimators.settings import EstimatorSettings, StatedBoundsSettings
from excite.identification.inertia import NAMES, ROUNDING, physical_parameters
from excite.identification.physical.bounds import AT_BOUND, PhysicalBounds
from excite.identification.physical.default_bounds import default_bounds, tie_total_mass, with_drives
from excite.identification.physical.feasible_set import FeasibleSet, base_objective, essential_objective
from excite.identification.physical.retrieval import RetrievalSettings, retrieve_parameters
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import RANK_TOLERANCE, Regression, prior_std, square_factor
from excite.identification.statistics import parameter_labels
from excite.regressor.base_parameters import base_parameters

_UNITS = {
    "mass": "kg",
    "com": "m",
    "inertia": "kg·m²",
    "drive": "SI",
    "total_mass": "kg",
    "inertia_rules": "kg·m²",
    "principal_triangle": "kg·m²",
}


class PhysicalRetrieval(Estimator[StatedBoundsSettings]):
    """Mass, centre of mass and inertia of each segment, within bounds, that explain the torques best.

    The objective is eq. (15): the unweighted residual of the essential parameters. The bounds (16), the total
    mass (17) and the rules of the inertias (18) are those of a file, else wide ones about the nominal model,
    see :func:`~excite.identification.physical.default_bounds.default_bounds`. Of equally good parameters
    those nearest to the nominal model are taken.

    Args:
        bounds: bounds and rules; None derives them from the robot, and puts in what the settings state.
        effort: number of starts, seed, and gap at which the search ends.
        essential: whether the objective leaves out the base parameters that the elimination cancels, as
            eq. (15) does; None does so for joint torques. On a floating base, whose hundreds of small
            parameters matter together, thresholds that were chosen for an arm cost accuracy.
    """

    name = "physical"
    title = "physical parameters within bounds, globally optimal (Xu et al. 2020)"
    weighted = False
    consistent = True
    use = (
        "arms of which much is known beforehand, from data sheets or a scale: keeps stated bounds exactly, and proves "
        "that nothing within them explains the torques better"
    )
    settings_class = StatedBoundsSettings
    guarantees = (
        "bounds, total mass and rules of the inertias hold exactly; no other parameters that meet them have an "
        "objective below the certificate's lower bound"
    )

    def __init__(
        self,
        bounds: PhysicalBounds | None = None,
        effort: RetrievalSettings | None = None,
        *,
        essential: bool | None = None,
    ):
        self._bounds, self._effort, self._essential = bounds, effort or RetrievalSettings(), essential

    def solve(self, rows: Regression, settings: StatedBoundsSettings) -> Estimate:
        """See :meth:`Estimator.solve`.

        Raises:
            InputError: the bounds are of another robot.
            NoSolutionError: the bounds contradict each other; ``best`` breaks them least.
        """
        problem = rows.problem
        allowed = feasible_set(problem, self._bounds_for(problem, settings), settings)
        n = problem.n_inertial
        base = base_parameters(rows.factor[:, :-1], parameter_labels(problem), RANK_TOLERANCE)
        factor = square_factor(rows.factor[:, [*base.independent, problem.n_params]])
        leaves_out = problem.channel_names[0] != "fx" if self._essential is None else self._essential
        objective = (
            essential_objective(factor, base.matrix, problem.n_rows)
            if leaves_out
            else base_objective(factor, base.matrix)
        )
        nominal = np.nan_to_num(physical_parameters(problem.prior[:n]))
        try:
            found = retrieve_parameters(
                objective, allowed, allowed.coordinates(nominal, problem.prior[n:]), self._effort
            )
        except NoSolutionError as error:
            raise self._describe_contradiction(error, rows, allowed) from error
        parameters, certificate = found.parameters, found.certificate
        violations = _measure_violations(problem, allowed, parameters)
        noise = objective.floor / np.sqrt(max(problem.n_rows - len(objective.kept), 1))
        missing = np.sqrt(max(certificate.objective**2 - certificate.lower_bound**2, 0.0))
        # Parameters of free segments that lie at a bound.
        lower, upper = allowed.bounds.lower, allowed.bounds.upper
        physical = physical_parameters(parameters[:n])
        near = np.minimum(physical - lower, upper - physical) <= AT_BOUND * (upper - lower)
        best = replace(
            estimate_at(self.name, rows, parameters, SolveStatus.SOLVED, violations),
            distance=missing / noise if noise > 0.0 else 0.0,
            active=tuple(
                f"bounds:{allowed.bounds.links[k]}.{name}"
                for k in allowed.free
                for name, reached in zip(NAMES, near[k], strict=True)
                if reached
            ),
            total_mass=settings.total_mass,
            certificate=certificate,
        )
        if not np.isfinite(parameters).all():
            raise no_solution(SolveStatus.NOT_FINITE, best)
        if max(violations.values()) > 0.0:
            raise no_solution(SolveStatus.VIOLATED, replace(best, status=SolveStatus.VIOLATED))
        return best

    def _describe_contradiction(
        self, error: NoSolutionError, rows: Regression, allowed: FeasibleSet
    ) -> NoSolutionError:
        """The error with the parameters that break the bounds least, and what they break."""
        if error.best is None:
            return error
        problem = rows.problem
        parameters = allowed.standard(np.asarray(error.best))
        violations = _measure_violations(problem, allowed, parameters)
        broken = {kind: value for kind, value in violations.items() if not value <= ROUNDING}
        best = estimate_at(self.name, rows, parameters, SolveStatus.INFEASIBLE, violations)
        missed = ", ".join(f"{kind} by {value:.3g} {_UNITS[kind]}" for kind, value in broken.items())
        what = f"{error.what}: at best {missed or 'nothing is left'} outside"
        return NoSolutionError(what, best=best, remedy=error.remedy)

    def _bounds_for(self, problem: IdentificationProblem, settings: StatedBoundsSettings) -> PhysicalBounds:
        links = tuple(segment.link for segment in problem.robot.segments)
        if self._bounds is None:
            usual = default_bounds(problem.robot, settings)
            stated = settings.bounds
            return usual if stated is None else tie_total_mass(stated.over(usual), settings.total_mass)
        if self._bounds.links != links:
            raise InputError(
                f"bounds links {', '.join(self._bounds.links)}",
                source=self._bounds.source or None,
                remedy=f"the links of {problem.robot.name} are " + ", ".join(links),
            )
        return tie_total_mass(self._bounds, settings.total_mass)


def _measure_violations(
    problem: IdentificationProblem, allowed: FeasibleSet, parameters: Array
) -> dict[str, float]:
    n = problem.n_inertial
    drives = dict(zip(problem.parameter_names[n:], parameters[n:].tolist(), strict=True))
    return allowed.bounds.violations(physical_parameters(parameters[:n]), drives, allowed.free)


def feasible_set(
    problem: IdentificationProblem, bounds: PhysicalBounds, settings: EstimatorSettings
) -> FeasibleSet:
    """The set that bounds and rules allow; segments that the sensors do not see stay nominal."""
    names = problem.parameter_names[problem.n_inertial :]
    usual = prior_std(problem, settings.spreads(problem.robot))[problem.n_inertial :]
    segments = range(len(bounds.links))
    return FeasibleSet(
        bounds=with_drives(bounds, names, usual),
        drive_names=names,
        free=np.array([k for k in segments if k not in problem.unmeasured], dtype=np.int64),
        frozen=problem.prior[: problem.n_inertial].copy(),
    )
