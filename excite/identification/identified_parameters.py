"""The parameters that were identified, segment by segment and drive by drive, beside the nominal ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.identification.inertia import FILE_ORDER
from excite.identification.judgement.uncertainty import ParameterUncertainty
from excite.identification.problem import IdentificationProblem
from excite.regressor.columns import PARAMETERS


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

    def to_json(self, uncertainty: ParameterUncertainty | None) -> dict[str, Any]:
        """Its blocks of the document.

        Args:
            uncertainty: of all parameters, which stands beside the values; None leaves it out.
        """
        return {
            "standard_parameters": self._standard_parameters(uncertainty),
            "drive_parameters": self.by_drive(),
            "unmeasured": list(self.unmeasured),
        }

    def rows(self, uncertainty: ParameterUncertainty | None) -> list[dict[str, Any]]:
        """A row for each parameter of each link, about its joint's frame [SI]; ``std`` is None where not known."""
        n = len(self.inertial)
        std = [None] * n if uncertainty is None else [float(value) for value in uncertainty.std[:n]]
        share = [None] * n if uncertainty is None else [float(value) for value in uncertainty.determined[:n]]
        return [
            {
                "link": link,
                "parameter": name,
                "nominal": float(self.nominal[10 * k + j]),
                "value": float(self.inertial[10 * k + j]),
                "std": std[10 * k + j],
                "determined": share[10 * k + j],
            }
            for k, link in enumerate(self.links)
            for j, name in enumerate(PARAMETERS)
        ]

    def _standard_parameters(self, uncertainty: ParameterUncertainty | None) -> dict[str, Any]:
        columns = {"": self.inertial, "nominal": self.nominal}
        if uncertainty is not None:
            n = len(self.inertial)
            columns |= {"std": uncertainty.std[:n], "determined": uncertainty.determined[:n]}
        ten = {key: values.reshape(-1, 10) for key, values in columns.items()}
        found = {}
        for k, (link, name) in enumerate(zip(self.links, self.segments, strict=True)):
            blocks = {key: _parameter_block(rows[k]) for key, rows in ten.items()}
            found[link] = {
                **blocks.pop(""),
                "nominal_mass": blocks["nominal"]["mass"],
                "name": name,
                **blocks,
            }
        return found


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


def _parameter_block(row: Array) -> dict[str, Any]:
    return {
        "mass": float(row[0]),
        "first_moment": row[1:4].tolist(),
        "inertia": row[4:][list(FILE_ORDER)].tolist(),
    }
