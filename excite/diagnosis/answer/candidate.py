"""An effect at a place, with its fitted parameters and how well it explains the gap."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from excite.arrays import Array


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter of an effect.

    Attributes:
        value: in ``unit``.
        std: standard deviation in ``unit``, None where it was not computed.
        unit: SI unit.
    """

    value: float
    std: float | None
    unit: str


@dataclass(frozen=True)
class Candidate:
    """An effect at a place, fitted on the identification trials.

    Attributes:
        effect: name of the effect, a word of ``excite.logs.vocabulary.EFFECTS``.
        location: joint, link, sensor (``SENSOR.AXIS``, ``SENSOR.AXIS->AXIS``), ``base``, ``torque`` or ``wrench``.
        parameters: fitted parameters by name.
        evidence: log-likelihood ratio against the model without it, per effective sample summed, less the
            price of its parameters and of the candidates tried [nats].
        gap_after: root mean square over channels of the normalised gap on the validation trials.
        share_closed: ``1 − (after² − floor²)/(before² − floor²)``.
        tied_locations: places that the data cannot tell from ``location``, itself among them.
        probability: probability that this is the effect and the place; what the candidates' probabilities lack to 1
            is something that none of them is. None unless computed.
        interval: 90 % interval of ``share_closed``; None unless computed.
    """

    effect: str
    location: str | None
    parameters: dict[str, Estimate]
    evidence: float
    gap_after: float
    share_closed: float
    tied_locations: tuple[str, ...] = ()
    probability: float | None = None
    interval: tuple[float, float] | None = None

    def to_json(self) -> dict[str, Any]:
        """The candidate as it stands in the document."""
        return {
            "effect": self.effect,
            "location": self.location,
            "parameters": {
                name: {"value": item.value, "std": item.std, "unit": item.unit}
                for name, item in self.parameters.items()
            },
            "evidence": self.evidence,
            "gap_after": self.gap_after,
            "share_closed": self.share_closed,
            "tied_locations": list(self.tied_locations),
            "probability": self.probability,
            "share_closed_90": None if self.interval is None else list(self.interval),
        }


def measured(item: Estimate) -> str:
    """Value and deviation as they are written in a sentence."""
    spread = "" if item.std is None else f" ± {item.std:.1g}"
    unit = "" if item.unit == "1" else item.unit
    return f"{item.value:.4g}{spread} {unit}".strip()


def sized(item: Candidate) -> str:
    """Effect, place and its size, as they are written in a sentence: the first parameter, a wave's height, or the axis
    that surely differs from zero most."""
    return in_words(item.effect, item.location) + (f" ({size})" if (size := _size(item.parameters)) else "")


def _size(parameters: Mapping[str, Estimate]) -> str:
    if {"cosine", "sine"} <= set(parameters):
        # Of a gear's waves those that grow with its load may be all that is told.
        waves = [_height(parameters, end) for end in ("", "_load", "_2") if f"cosine{end}" in parameters]
        return measured(max(waves, key=lambda wave: wave.value / (wave.std or math.inf)))
    first = next(iter(parameters), "")
    axes = {n: e for n, e in parameters.items() if n[-1] in "xyz" and e.std} if first.endswith("x") else {}
    if len(axes) < 2:
        return measured(parameters[first]) if first else ""
    # Of a sensor's bias of 4 N·m about y the first one is that of the force along x, -0.3 ± 0.2 N.
    axis = max(axes, key=lambda name: abs(axes[name].value) / (axes[name].std or math.inf))
    return f"{axis.replace('_', ' ')} {measured(axes[axis])}"


def _height(parameters: Mapping[str, Estimate], end: str) -> Estimate:
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


def percent(share: float) -> str:
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
