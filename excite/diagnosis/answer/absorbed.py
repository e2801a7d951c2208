"""What the baseline was fitted to: sizes that were taken from the record before the first effect was asked for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.equations.units import unit_at
from excite.display import span
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
    robot: Robot,
    joints: Sequence[str],
    name: str,
    unit: str,
    values: Array,
    estimated: Sequence[bool],
    spread: Array | None = None,
) -> Iterator[Absorbed]:
    """Gains that were not stated and are the record's therefore.

    Args:
        robot: the robot.
        joints: of the values.
        name: of the gain.
        unit: of it at a joint that turns.
        values: ``(n_joints,)`` [unit].
        estimated: which of them were not stated.
        spread: ``(n_joints,)`` standard deviations of the values [unit]; None where they were not computed.
    """
    stds = [None] * len(joints) if spread is None else np.asarray(spread).tolist()
    wide = float(ndtri(0.95))
    for joint, value, guessed, std in zip(joints, np.asarray(values).tolist(), estimated, stds, strict=True):
        if guessed:
            between = None if std is None else (value - wide * std, value + wide * std)
            yield Absorbed(joint, name, Estimate(value, std, unit_at(robot, joint, unit)), between)


def absorbed_lines(items: Sequence[Absorbed]) -> list[str]:
    """A line for each parameter that was fitted, with its value and 90 % interval at every joint."""
    kinds = dict.fromkeys((item.parameter, item.size.unit) for item in items)
    lines = []
    for name, unit in kinds:
        each = [item for item in items if (item.parameter, item.size.unit) == (name, unit)]
        lines.append(f"{name.replace('_', ' ')} [{unit}]: " + ", ".join(_in_words(item) for item in each))
    return ["", "fitted to the record before any effect, with 90 % intervals:", *lines] if lines else []


def _in_words(item: Absorbed) -> str:
    between = ""
    if item.interval90 is not None:
        low, high = (f"{end:.3g}" for end in item.interval90)
        between = f" ({span(low, high, '…')})"
    return f"{item.joint} {item.size.value:.3g}{between}"
