"""All linear constraints of eq. (4) of Jovic et al., Humanoids 2015, from the settings."""

from __future__ import annotations

from dataclasses import dataclass, replace

from excite.identification.constraints.com_box import com_in_box, equivalent_boxes
from excite.identification.constraints.linear import LinearConstraints, stack_constraints
from excite.identification.constraints.mass import measured_total_mass, non_negative_masses, total_mass
from excite.identification.constraints.symmetry import symmetric_pairs
from excite.identification.estimators.settings import (
    BoxSettings,
    EstimatorSettings,
    SymmetrySettings,
)
from excite.identification.regression import Regression


@dataclass(frozen=True, eq=False)
class ModelConstraints:
    """Constraints on a robot's parameters.

    Attributes:
        linear: all linear rows.
        total_mass: mass that they impose on the sum [kg], None where it is free.
    """

    linear: LinearConstraints
    total_mass: float | None


def body_constraints(rows: Regression, settings: BoxSettings) -> ModelConstraints:
    """The constraints of eq. (4) on masses and centres of mass.

    The total mass is the weighed one, else what the measured forces determine, else free.

    Args:
        rows: condensed and weighted rows.
        settings: boxes of the centres of mass, weighed mass.
    """
    problem = rows.problem
    boxes = settings.com_boxes if settings.com_boxes is not None else equivalent_boxes(problem.robot)
    parts = [non_negative_masses(problem), com_in_box(problem, boxes)]
    mass = known_total_mass(rows, settings)
    if mass is not None:
        parts.append(total_mass(problem, mass))
    return ModelConstraints(stack_constraints(parts, problem.n_params), mass)


def model_constraints(rows: Regression, settings: SymmetrySettings) -> ModelConstraints:
    """All constraints of eq. (4) but the inertia's: those of :func:`body_constraints`, and symmetry if asked for.

    Args:
        rows: condensed and weighted rows.
        settings: those of :func:`body_constraints`, symmetry, and the links that are free of it.

    Raises:
        UnknownNameError: a link that need not mirror its twin is no segment.
    """
    bodies, problem = body_constraints(rows, settings), rows.problem
    if settings.symmetry is None:
        return bodies
    pairs = symmetric_pairs(problem, settings.symmetry, settings.free_of_symmetry(problem.robot))
    return replace(bodies, linear=stack_constraints([bodies.linear, pairs], problem.n_params))


# A total mass is known when its standard deviation is below this share of it: forces under the feet have a tenth of
# that, and what joint torques say of the mass may be worth nothing.
_KNOWN = 0.01


def known_total_mass(rows: Regression, settings: EstimatorSettings) -> float | None:
    """The weighed mass, else what the measured forces determine, else None [kg]."""
    if settings.total_mass is not None:
        return settings.total_mass
    measured = measured_total_mass(rows)
    return measured.value if measured.identifiable and measured.std < _KNOWN * abs(measured.value) else None
