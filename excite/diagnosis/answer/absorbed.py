"""What the baseline was fitted to: sizes that were taken from the record before the first effect was asked for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.equations.units import unit_at
from excite.robot.robot import Robot


@dataclass(frozen=True)
class Absorbed:
    """A size of one joint that the record decided, and that is no effect therefore.

    Attributes:
        joint: its joint.
        parameter: what it is: a word of ``modelled``, a gain of the servo, a torque constant.
        size: value, deviation and unit.
        interval90: of the value; None where it was not computed.
    """

    joint: str
    parameter: str
    size: Estimate
    interval90: tuple[float, float] | None = None

    def to_json(self) -> dict[str, Any]:
        """As it stands in the document."""
        return {
            "joint": self.joint,
            "parameter": self.parameter,
            "value": self.size.value,
            "std": self.size.std,
            "unit": self.size.unit,
            "interval90": None if self.interval90 is None else list(self.interval90),
        }


def estimated_gains(
    robot: Robot, joints: Sequence[str], name: str, unit: str, values: Array, estimated: Sequence[bool]
) -> Iterator[Absorbed]:
    """Gains that were not stated and are the record's therefore.

    Args:
        robot: the robot.
        joints: of the values.
        name: of the gain.
        unit: of it at a joint that turns.
        values: ``(n_joints,)`` [unit].
        estimated: which of them were not stated.
    """
    for joint, value, guessed in zip(joints, np.asarray(values), estimated, strict=True):
        if guessed:
            yield Absorbed(joint, name, Estimate(float(value), None, unit_at(robot, joint, unit)))
