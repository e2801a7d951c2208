"""An effect at a place, with its fitted parameters and how well it explains the gap."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from excite.arrays import Array
from excite.results import Interval, Name, Stated, Unbounded, UnboundedPositive, named


@dataclass(frozen=True)
class Estimate(Stated):
    """A fitted parameter of an effect.

    Attributes:
        value: in its unit.
        std: standard deviation in its unit; null where it is not known.
        unit: SI unit; 1 where it has none.
    """

    value: Unbounded
    std: UnboundedPositive | None
    unit: Name


@dataclass(frozen=True)
class Candidate(Stated):
    """An effect at a place, fitted on the identification trials.

    Attributes:
        effect: name of the effect.
        location: joint, link, sensor (``SENSOR.AXIS``, ``SENSOR.AXIS->AXIS``), ``base``, ``torque`` or ``wrench``.
        parameters: fitted parameters by name.
        evidence: log-likelihood ratio against the model without it, per effective sample summed, less the
            price of its parameters and of the candidates tried [nats].
        gap_after: gap with it, as share of the signal: root mean square over channels on the trials that judge.
        share_closed: share of the gap above the noise that it closes, ``1 − (after² − floor²)/(before² − floor²)``: of
            the torques, or wrenches, on the trials that judge; an accepted effect together with those before it, every
            other one alone.
        tied_locations: places that the data cannot tell from ``location``, itself among them.
        probability: probability that this is the effect and the place; what the candidates' probabilities lack to 1
            is something that none of them is; null where it was not computed.
        interval: 90 % interval of the share closed; null where it was not computed.
    """

    effect: Name
    location: Name | None
    parameters: dict[Name, Estimate]
    evidence: Unbounded
    gap_after: UnboundedPositive
    share_closed: Unbounded
    tied_locations: tuple[Name, ...] = ()
    probability: UnboundedPositive | None = None
    interval: Interval | None = field(default=None, metadata=named("share_closed_90"))


def format_estimate(item: Estimate) -> str:
    """Value and deviation as they are written in a sentence."""
    spread = "" if item.std is None else f" ± {item.std:.1g}"
    unit = "" if item.unit == "1" else item.unit
    return f"{item.value:.4g}{spread} {unit}".strip()


def describe_with_size(item: Candidate) -> str:
    """Effect, place and its size, as they are written in a sentence: the first parameter, a wave's height, or the axis
    that surely differs from zero most."""
    return in_words(item.effect, item.location) + (
        f" ({size})" if (size := _format_size(item.parameters)) else ""
    )


def _format_size(parameters: Mapping[str, Estimate]) -> str:
    if {"cosine", "sine"} <= set(parameters):
        # Of a gear's waves those that grow with its load may be all that is told.
        waves = [
            _wave_amplitude(parameters, end) for end in ("", "_load", "_2") if f"cosine{end}" in parameters
        ]
        return format_estimate(max(waves, key=lambda wave: wave.value / (wave.std or math.inf)))
    first = next(iter(parameters), "")
    axes = {n: e for n, e in parameters.items() if n[-1] in "xyz" and e.std} if first.endswith("x") else {}
    if len(axes) < 2:
        return format_estimate(parameters[first]) if first else ""
    # Of a sensor's bias of 4 N·m about y the first one is that of the force along x, -0.3 ± 0.2 N.
    axis = max(axes, key=lambda name: abs(axes[name].value) / (axes[name].std or math.inf))
    return f"{axis.replace('_', ' ')} {format_estimate(axes[axis])}"


def _wave_amplitude(parameters: Mapping[str, Estimate], end: str) -> Estimate:
    """Height of a wave by its two parts: where the phase lies, either may be near zero."""
    parts = [parameters[f"{name}{end}"] for name in ("cosine", "sine")]
    height = math.hypot(*(part.value for part in parts))
    spread = None
    if height > 0.0 and all(part.std is not None for part in parts):
        spread = math.hypot(*(part.value * (part.std or 0.0) for part in parts)) / height
    return Estimate(height, spread, parts[0].unit)


def in_words(effect: str | None, location: str | None) -> str:
    """Effect and place as they are written in a sentence."""
    name = (effect or "unknown").replace("_", " ")
    return name if location is None else f"{name} at {location}"


def format_percent(share: float) -> str:
    """A share for reading, with a digit that is not zero.

    >>> percent(0.123), percent(0.0000637), percent(0.0)
    ('12.3 %', '0.006 %', '0.0 %')
    """
    value = 100.0 * share
    return f"{value:.1f} %" if value == 0.0 or abs(value) >= 0.05 else f"{value:.1g} %"


# What accepted effects change of a robot's description, and what no description holds.


@dataclass(frozen=True, eq=False)
class RobotChanges:
    """A robot's bodies and drives as a diagnosis found them.

    Attributes:
        viscous: viscous friction by joint [N·m·s/rad].
        coulomb: Coulomb friction by joint [N·m].
        armature: rotor inertia by joint [kg·m²].
        bodies: by link, ``(10,)`` inertial parameters that it has more than the model says, about the link's frame.
        beyond: what a description has no place for, a sentence each.
    """

    viscous: Mapping[str, float] = field(default_factory=dict)
    coulomb: Mapping[str, float] = field(default_factory=dict)
    armature: Mapping[str, float] = field(default_factory=dict)
    bodies: Mapping[str, Array] = field(default_factory=dict)
    beyond: tuple[str, ...] = ()


@dataclass(frozen=True)
class Applied(Stated):
    """A robot that was written with the effects of a diagnosis in it.

    Attributes:
        robot: its ``robot.yaml``; in a document from ``--out``, or from the working folder.
        written: what was changed, a sentence each.
        left_out: what the files have no place for, a sentence each.
    """

    robot: Annotated[Path, "path"]
    written: tuple[str, ...]
    left_out: tuple[str, ...]

    def summary(self) -> str:
        """A line each."""
        lines = [f"robot with the effects: {self.robot}"]
        lines += [f"  {text}" for text in self.written or ("nothing was found that it did not have",)]
        lines += [f"  not in it: {text}" for text in self.left_out]
        if self.left_out:
            lines.append("  a diagnosis with this robot finds again what is not in it")
        return "\n".join(lines)
