"""What is watched: configurations over time, and what belongs to each joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from excite.arrays import Array


@dataclass(frozen=True, eq=False)
class Curve:
    """Signals of one joint.

    Attributes:
        title: with the unit.
        time: ``(n,)`` [s].
        lines: by what they are, ``(n,)`` each.
    """

    title: str
    time: Array
    lines: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Clip:
    """One motion or trial.

    Attributes:
        title: for reading.
        time: ``(n,)`` [s], from zero.
        q: configurations, ``(n, nq)``.
        ghost: what the other robot is, and its configurations, ``(n, nq)``; None without one.
        curves: by joint, what is shown of it when it is clicked: its residuals where there are any.
        content: the same as a page's replay has it.
    """

    title: str
    time: Array
    q: Array
    ghost: tuple[str, Array] | None
    curves: Mapping[str, tuple[Curve, ...]]
    content: dict[str, Any] = field(repr=False)
