"""Physically consistent bodies that fit into ellipsoids (CLS-3 of Golluccio et al. 2020)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.assemble import known_total_mass
from excite.identification.constraints.body import pseudo_inertia_cones
from excite.identification.constraints.com_box import equivalent_boxes
from excite.identification.constraints.ellipsoid import (
    body_ellipsoids,
    com_ellipsoids,
    com_in_ellipsoids,
    mass_in_ellipsoids,
)
from excite.identification.constraints.linear import stack_constraints
from excite.identification.constraints.mass import non_negative_masses, total_mass
from excite.identification.constraints.stated_bounds import stated_bounds
from excite.identification.estimators.base import Estimate, Estimator
from excite.identification.estimators.conic.conic import ConicSolver, interior_point
from excite.identification.estimators.conic.conic_estimate import conic_estimate, consistent_or_raised
from excite.identification.estimators.ridge import ridge
from excite.identification.estimators.setting import stated
from excite.identification.estimators.settings import (
    EstimatorSettings,
    PullSettings,
    StatedBoundsSettings,
)
from excite.identification.physical.default_bounds import default_bounds
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, condense_problem, iterate_weights


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


class DensityRealisable(Estimator[Cls3Settings]):
    """Least squares with a pull to nominal; every body has a density that is not negative inside its ellipsoid.

    Pseudo-inertias positive definite (eq. 4), centres of mass in ellipsoids (eq. 6), mass distributions in
    ellipsoids (``tr(J Q) ≥ 0``, Wensing, Kim and Slotine 2018), and the total mass where it is known. Ellipsoids
    that are not given come from the boxes of the centres of mass: inscribed for these, least circumscribed
    for the bodies, each grown until the nominal model fits.
    """

    name: ClassVar[str] = "cls3"
    title: ClassVar[str] = "physically consistent bodies inside ellipsoids (CLS-3)"
    consistent: ClassVar[bool] = True
    use: ClassVar[str] = (
        "models to simulate or to hand over: every body can exist with its mass inside its ellipsoid; keeps stated "
        "bounds"
    )
    settings_class: ClassVar[type[EstimatorSettings]] = Cls3Settings
    guarantees: ClassVar[str] = (
        "within the stated distance of the global optimum; every body can exist with its mass inside its ellipsoid "
        "(least eigenvalue of its pseudo-inertia at least -1e-9, recomputed) and its centre of mass in its own"
    )

    def __init__(self, solver: ConicSolver = interior_point):
        self._solver = solver

    def estimate(self, problem: IdentificationProblem, settings: Cls3Settings) -> Estimate:
        """See :meth:`Estimator.estimate`."""
        return self.solve(iterate_weights(condense_problem(problem)), settings)

    def solve(self, rows: Regression, settings: Cls3Settings) -> Estimate:
        """Estimate from rows that have been condensed and weighted.

        Args:
            rows: the rows.
            settings: of this method.

        Raises:
            InputError: matrices that are not those of ellipsoids.
            NoSolutionError: no parameters meet the constraints, or an answer fails its recomputation.
        """
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
        mass = known_total_mass(rows, settings)
        if mass is not None:
            parts.append(total_mass(problem, mass))
        if settings.bounds is not None:
            parts.append(stated_bounds(problem, settings.bounds, default_bounds(problem.robot, settings)))
        cones = (pseudo_inertia_cones(problem, settings.inertia_floor), com_in_ellipsoids(problem, centers))
        linear = stack_constraints(parts, problem.n_params)
        best = conic_estimate(self.name, rows, ridge(rows, settings), linear, cones, self._solver)
        return replace(consistent_or_raised(best), total_mass=mass)
