"""What the baseline was fitted to: sizes that were taken from the record before the first effect was asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from scipy.special import ndtri

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.equations.units import unit_at
from excite.display import span
from excite.results import HIDDEN, Interval, Name, Stated, Unbounded, UnboundedPositive, stated
from excite.robot.robot import Robot


@dataclass(frozen=True)
class Absorbed(Stated):
    """A size of one joint that was taken from the record before the first effect was asked for.

    Attributes:
        joint: its joint.
        parameter: word of modelled, gain of the servo or torque constant.
        size: value, deviation and unit.
        interval90: 90 % interval [unit]; null where it was not computed.
    """

    joint: Name
    parameter: Name
    size: Estimate = field(metadata=HIDDEN)
    interval90: Interval | None = None

    @property
    @stated
    def value(self) -> Unbounded:
        """Fitted [unit]."""
        return self.size.value

    @property
    @stated
    def std(self) -> UnboundedPositive | None:
        """Standard deviation [unit]; null where it is not known."""
        return self.size.std

    @property
    @stated
    def unit(self) -> Name:
        """SI unit."""
        return self.size.unit

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """See :meth:`Stated.from_json`."""
        size, between = Estimate.from_json(content), content["interval90"]
        return cls(content["joint"], content["parameter"], size, None if between is None else tuple(between))


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
