"""Identifications made from parameters, without a log."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.identification.changed_segments import Changes
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.judgement import TotalMassReport, check_consistency
from excite.identification.parameter_statistics import ParameterUncertainty
from excite.identification.result import Identification
from excite.robot.robot import Robot


def identification_of(
    robot: Robot, parameters: Array, drives: dict[str, float] | None = None
) -> Identification:
    """What an identification that found ``parameters`` would say."""
    names = tuple(segment.name for segment in robot.segments)
    n = len(parameters) + len(drives or {})
    return Identification(
        robot=robot.name,
        method="lmi",
        status="solved",
        n_samples=1000,
        identified=IdentifiedParameters(
            links=tuple(segment.link for segment in robot.segments),
            segments=names,
            unmeasured=(),
            inertial=parameters,
            nominal=robot.nominal_parameters.copy(),
            drive_names=tuple(drives or {}),
            drives=np.array(list((drives or {}).values())),
        ),
        base=(),
        structural_rank=None,
        essential=(),
        uncertainty=ParameterUncertainty(np.full(n, 0.01), np.linspace(0.0, 1.0, n)),
        consistency=check_consistency(parameters, names),
        fit={},
        validation={},
        changes=Changes((), 1.0, 1.0),
        total_mass=TotalMassReport(float(parameters[::10].sum()), robot.mass, None, None, None),
    )
