"""Bounds for robots without a file of them: wide ones about the nominal model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.errors import RobotError
from excite.identification.constraints.linear import (
    LinearConstraints,
    bounds_about_nominal,
    equivalent_boxes,
    speaks_of,
    stack_constraints,
    stated_bounds,
    within_bounds,
)
from excite.identification.estimators.settings import BodySettings, ParameterBoundsSettings
from excite.identification.inertia import DIAGONAL, physical_parameters
from excite.identification.physical.bounds import InertiaRules, PhysicalBounds
from excite.identification.problem import NEVER_NEGATIVE
from excite.identification.regression import Regression, prior_std
from excite.robot.robot import Robot
from excite.robot.shapes.collision import com_boxes

# A segment may be this much lighter or heavier than nominal, and carry this share of the robot besides.
_LIGHTEST, _HEAVIEST, _CARRIED = 0.1, 3.0, 0.15
_SMALLEST_MASS = 1e-3
_LARGEST_INERTIA = 10.0
_SCALE_ERROR = 1e-6
_WIDE = 3.0


def derived_boxes(robot: Robot) -> tuple[Array, RobotError | None]:
    """Boxes of the centres of mass from the geometry, else from the nominal inertias, with what the first lacks."""
    try:
        return com_boxes(robot), None
    except RobotError as error:
        return equivalent_boxes(robot), error


def default_bounds(robot: Robot, settings: BodySettings) -> PhysicalBounds:
    """Bounds that a modified robot still meets.

    Masses lie between a tenth and three times the nominal one plus 15 % of the whole robot's; centres of mass
    in the settings' boxes, else in boxes of the nominal mass and inertia; moments of inertia above the
    settings' ``inertia_floor`` and below that of the heaviest mass at the far end of its box. The rules of
    eq. (18) of Xu et al. 2020 that depend on how the frames lie are left out; principal moments obey the
    triangle inequality.

    Args:
        settings: boxes, inertia floor and weighed total mass.
    """
    nominal = physical_parameters(robot.nominal_parameters)
    nominal = np.where(np.isfinite(nominal), nominal, 0.0)
    boxes = settings.com_boxes if settings.com_boxes is not None else equivalent_boxes(robot)
    mass = np.maximum(nominal[:, 0], _SMALLEST_MASS)
    heaviest = _HEAVIEST * mass + _CARRIED * robot.mass
    moments = nominal[:, 4:][:, DIAGONAL]
    least = np.maximum(settings.inertia_floor * moments.min(axis=1), 1e-9)
    side = np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1)
    greatest = heaviest * side**2 + _LARGEST_INERTIA * moments.max(axis=1)
    lower, upper = np.zeros((len(mass), 10)), np.zeros((len(mass), 10))
    lower[:, 0], upper[:, 0] = _LIGHTEST * mass, heaviest
    lower[:, 1:4], upper[:, 1:4] = boxes[:, 0], boxes[:, 1]
    lower[:, 4:], upper[:, 4:] = -greatest[:, None], greatest[:, None]
    lower[:, [4 + k for k in DIAGONAL]] = least[:, None]
    bounds = PhysicalBounds(
        links=tuple(segment.link for segment in robot.segments),
        lower=lower,
        upper=upper,
        drives={},
        total_mass=(float(lower[:, 0].sum()), float(upper[:, 0].sum())),
        rules=InertiaRules(diagonal_ratio=None, off_diagonal_share=None),
        source=f"derived from the nominal model of {robot.name}",
    )
    return tie_total_mass(bounds, settings.total_mass)


def tie_total_mass(bounds: PhysicalBounds, mass: float | None) -> PhysicalBounds:
    """The same bounds with the total mass tied to what a scale says [kg]; None leaves them."""
    if mass is None:
        return bounds
    return replace(bounds, total_mass=(mass * (1.0 - _SCALE_ERROR), mass * (1.0 + _SCALE_ERROR)))


def with_drives(bounds: PhysicalBounds, names: tuple[str, ...], usual: Array) -> PhysicalBounds:
    """The same bounds with one for every drive parameter, and for no other.

    Args:
        bounds: those that it has stay.
        names: ``viscous.joint1`` and so on; friction and armature cannot be negative.
        usual: what would explain all of the signal, ``(n_drives,)``; three times that bounds the rest.
    """
    drives = {}
    for name, size in zip(names, usual.tolist(), strict=True):
        positive = name.partition(".")[0] in NEVER_NEGATIVE
        drives[name] = bounds.drives.get(name, (0.0 if positive else -_WIDE * size, _WIDE * size))
    return replace(bounds, drives=drives)


# Bounds of the standard parameters themselves, as rows.


def parameter_bounds(rows: Regression, settings: ParameterBoundsSettings) -> Array:
    """Bounds from the settings, ``(2, n_params)``, else some spreads about nominal.

    Those spreads give way where the settings state bounds of the parameter.
    """
    if settings.parameter_bounds is not None:
        return np.asarray(settings.parameter_bounds, dtype=float)
    problem = rows.problem
    spread = prior_std(problem, settings.spreads(problem.robot))
    bounds = bounds_about_nominal(problem, spread, settings.bound_width)
    if settings.bounds is not None:
        bounds[:, speaks_of(problem, settings.bounds)] = [[-np.inf], [np.inf]]
    return bounds


def bound_rows(
    rows: Regression, settings: ParameterBoundsSettings, places: tuple[int, ...] | None = None
) -> LinearConstraints:
    """Rows of the bounds of parameters and of those that the settings state.

    Args:
        places: which of a segment's ten parameters get bounds that are not stated, all and the drives if None.
    """
    problem = rows.problem
    bounds = within_bounds(problem, parameter_bounds(rows, settings), places)
    if settings.bounds is None:
        return bounds
    usual = default_bounds(problem.robot, settings)
    return stack_constraints([bounds, stated_bounds(problem, settings.bounds, usual)], problem.n_params)
