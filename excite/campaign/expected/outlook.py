"""What motions promise for each base parameter: whether it can be excited, is excited, and how precisely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.campaign.expected.prediction import predict_statistics
from excite.excitation.excitability import determined_columns, excitable_parameters
from excite.excitation.precision import nominal_values
from excite.identification.judgement.poor import said_rsd
from excite.motion.motion import Motion
from excite.regressor.base_parameters import structural_base_parameters
from excite.regressor.columns import DRIVE_TERMS
from excite.robot.robot import Robot
from excite.threads import one_blas_thread

# As in excite.excitation.weakness: feet stay on the ground to the tolerance of a solver only.
_UNEXCITED = 1e-6
_NAMED = 6


@dataclass(frozen=True)
class ParameterOutlook:
    """What is to be expected of one base parameter.

    Attributes:
        name: of its own column.
        expression: the whole combination.
        excitable: whether any motion can show it, within joint limits and with a foot on the ground.
        excited: whether the motions at hand do.
        value: in the model [SI].
        rsd_percent: predicted relative standard deviation; None where it is not excited, or is zero.
        essential: whether identification is expected to keep it.
    """

    name: str
    expression: str
    excitable: bool
    excited: bool
    value: float
    rsd_percent: float | None
    essential: bool

    def to_json(self) -> dict[str, Any]:
        """Its entry in ``excite.plan/1``."""
        return {
            "name": self.name,
            "expression": self.expression,
            "excitable": self.excitable,
            "excited": self.excited,
            "value": self.value,
            "predicted_rsd_percent": self.rsd_percent,
            "essential": self.essential,
        }


@dataclass(frozen=True)
class Outlook:
    """What is to be expected of an experiment.

    Attributes:
        parameters: one a structural base parameter.
    """

    parameters: tuple[ParameterOutlook, ...]

    @property
    def essential_rsd(self) -> dict[str, float]:
        """Predicted RSD of the parameters expected to be essential, by name [percent]."""
        return {p.name: p.rsd_percent for p in self.parameters if p.essential and p.rsd_percent is not None}

    def summary(self) -> str:
        """Two lines for a person."""
        found = self.essential_rsd
        lines = []
        if found:
            middle = float(np.median(list(found.values())))
            worst = max(found, key=lambda name: found[name])
            lines.append(
                f"predicted RSD of {len(found)} essential parameters: median {said_rsd(middle)}, "
                f"largest {said_rsd(found[worst])} ({worst})"
            )
        never = [p.name for p in self.parameters if not p.excitable]
        missed = [p.name for p in self.parameters if p.excitable and not p.excited]
        if not never and not missed:
            rotors = any(p.name.startswith("armature(") for p in self.parameters)
            among = " (rotor inertias among them)" if rotors else ""
            lines.append(f"all {len(self.parameters)} base parameters{among} can be excited, and are")
        if never:
            lines.append("no motion with these contacts excites: " + _name_some(never))
        if missed:
            lines.append("not excited by the chosen motions, though some motion could: " + _name_some(missed))
        return "\n".join(lines)


def is_predictable(robot: Robot) -> bool:
    """Whether ``robot.yaml`` says enough of the sensors: joint torques, or wrenches, with their noise."""
    sensors = robot.description.sensors
    if robot.measures_contacts:
        return all(s.noise_force > 0.0 and s.noise_moment > 0.0 for s in robot.sensors)
    noise = sensors.noise_torque
    stated = noise is not None and (noise.default is not None or set(robot.driven_names) <= set(noise.joints))
    return sensors.joint_torque is not None and stated


@one_blas_thread
def outlook(robot: Robot, motions: Sequence[Motion]) -> Outlook:
    """Judge motions before anything is measured.

    Args:
        robot: the robot, which has to be :func:`is_predictable`.
        motions: all that will be run for identification.

    Raises:
        InputError: the noise of the robot's sensors is not stated.
        LogError: the motions leave no rows.
    """
    predicted = predict_statistics(robot, motions)
    drives = tuple(term for term in DRIVE_TERMS if f"{term}({robot.joint_names[0]})" in predicted.labels)
    base = structural_base_parameters(robot, drives)
    own = [predicted.labels.index(label) for label in base.labels]
    excited = determined_columns(predicted.whole[:, own], _UNEXCITED)
    able = excitable_parameters(robot, base)
    values = nominal_values(robot, base)
    found = dict(zip(predicted.base.labels, predicted.rsd_percent, strict=True))
    kept = predicted.essential_rsd().keys()
    parameters = []
    for i, name in enumerate(base.labels):
        rsd = float(found.get(name, np.inf))
        parameters.append(
            ParameterOutlook(
                name=name,
                expression=base.expressions[i],
                excitable=bool(able[i]),
                excited=bool(excited[i]),
                value=float(values[i]),
                rsd_percent=rsd if excited[i] and np.isfinite(rsd) else None,
                essential=name in kept,
            )
        )
    return Outlook(tuple(parameters))


def _name_some(names: Sequence[str]) -> str:
    rest = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {rest} more" if rest > 0 else "")
