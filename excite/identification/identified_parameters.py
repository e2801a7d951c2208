"""The parameters that were identified, segment by segment and drive by drive, beside the nominal ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.identification.problem import IdentificationProblem


@dataclass(frozen=True, eq=False)
class IdentifiedParameters:
    """Parameters of bodies and drives.

    Attributes:
        links: links of the segments, in model order.
        segments: readable names of the segments.
        unmeasured: links that the sensors do not see; their parameters are nominal.
        inertial: ``(10·n_segments,)`` identified, pinocchio's order, joint frames [SI].
        nominal: ``(10·n_segments,)`` of the model.
        drive_names: names of the drives' parameters.
        drives: ``(n_drives,)`` identified [SI].
    """

    links: tuple[str, ...]
    segments: tuple[str, ...]
    unmeasured: tuple[str, ...]
    inertial: Array
    nominal: Array
    drive_names: tuple[str, ...]
    drives: Array

    @property
    def all(self) -> Array:
        """Inertial and drives' parameters, ``(n_params,)``, in the order of the problem's columns."""
        return np.concatenate([self.inertial, self.drives])

    @property
    def masses(self) -> Array:
        """Identified masses of the segments, ``(n_segments,)`` [kg]."""
        return self.inertial[::10].copy()

    def by_drive(self) -> dict[str, float]:
        """Parameters of the drives by name [SI]."""
        return dict(zip(self.drive_names, self.drives.tolist(), strict=True))


def identified_parameters(problem: IdentificationProblem, parameters: Array) -> IdentifiedParameters:
    """An estimator's answer as parameters of bodies and drives.

    Args:
        problem: the rows that it comes from.
        parameters: the answer, ``(n_params,)``, in the order of their columns.
    """
    n, robot = problem.n_inertial, problem.robot
    return IdentifiedParameters(
        links=tuple(segment.link for segment in robot.segments),
        segments=tuple(segment.name for segment in robot.segments),
        unmeasured=tuple(robot.segments[k].link for k in problem.unmeasured),
        inertial=parameters[:n].copy(),
        nominal=problem.prior[:n].copy(),
        drive_names=problem.parameter_names[n:],
        drives=parameters[n:].copy(),
    )
