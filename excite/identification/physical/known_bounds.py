"""Bounds that somebody states for some of the physical parameters, and what becomes of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.identification.physical.bounds import PhysicalBounds
from excite.identification.physical.coordinates import NAMES, physical_parameters

Interval = tuple[float, float]

# What rounding leaves at a bound, as share of the interval.
_AT = 1e-6


@dataclass(frozen=True)
class BoundReached:
    """A parameter and the bound that was stated for it.

    Attributes:
        name: such as ``link1.m`` or ``viscous.joint1`` or ``total_mass``.
        value: what was identified [SI].
        lower: [SI].
        upper: [SI].
    """

    name: str
    value: float
    lower: float
    upper: float

    @property
    def outside(self) -> float:
        """How far the value lies outside; 0 where it does not, infinite where it is not defined."""
        if not np.isfinite(self.value):
            return float("inf")
        return max(0.0, self.lower - self.value, self.value - self.upper)

    @property
    def inside(self) -> float:
        """How far the value lies from the nearer bound, as share of the interval; negative outside."""
        nearest = min(self.value - self.lower, self.upper - self.value)
        return nearest / (self.upper - self.lower) if np.isfinite(nearest) else -np.inf


@dataclass(frozen=True)
class BoundsReport:
    """Stated bounds against identified parameters, recomputed from these.

    Attributes:
        source: the file.
        stated: number of parameters with a stated bound.
        reached: those that lie at their bound.
        broken: those that lie outside, the worst first.
    """

    source: str
    stated: int
    reached: tuple[BoundReached, ...]
    broken: tuple[BoundReached, ...]

    def to_json(self) -> dict[str, Any]:
        """The block ``bounds`` of the document."""

        def entry(item: BoundReached) -> dict[str, Any]:
            return {"parameter": item.name, "value": item.value, "bounds": [item.lower, item.upper]}

        return {
            "file": self.source,
            "stated": self.stated,
            "at_bound": [entry(item) for item in self.reached],
            "outside": [{**entry(item), "by": item.outside} for item in self.broken],
        }

    def summary(self) -> str:
        """One line."""
        text = f"bounds of {self.source}: {self.stated} stated, {len(self.reached)} reached"
        if self.broken:
            worst = self.broken[0]
            text += f", {len(self.broken)} broken, {worst.name} by {worst.outside:.3g}"
        return text


@dataclass(frozen=True, eq=False)
class KnownBounds:
    """Bounds of some physical parameters; all others are left to a default.

    Attributes:
        parameters: by ``LINK.NAME`` with ``m, cx, cy, cz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz``, inertias about the
            centre of mass along the joint frame's axes [kg, m, kg·m²].
        drives: of the drives' parameters, by name such as ``viscous.joint1``.
        total_mass: of all segments together [kg].
        rules: those of :class:`~excite.identification.physical.bounds.InertiaRules` that are stated, by field.
        source: where they come from.
    """

    parameters: Mapping[str, Interval] = field(default_factory=dict)
    drives: Mapping[str, Interval] = field(default_factory=dict)
    total_mass: Interval | None = None
    rules: Mapping[str, Any] = field(default_factory=dict)
    source: str = "bounds"

    def of(self, link: str) -> dict[str, Interval]:
        """What is stated of a link, by parameter."""
        names = ((name, f"{link}.{name}") for name in NAMES)
        return {name: self.parameters[key] for name, key in names if key in self.parameters}

    def over(self, usual: PhysicalBounds) -> PhysicalBounds:
        """All bounds: those that are stated, the usual ones for the rest.

        Raises:
            InputError: nothing lies between two bounds.
        """
        lower, upper = usual.lower.copy(), usual.upper.copy()
        for i, link in enumerate(usual.links):
            for name, (low, high) in self.of(link).items():
                lower[i, NAMES.index(name)], upper[i, NAMES.index(name)] = low, high
        total = self.total_mass or (float(lower[:, 0].sum()), float(upper[:, 0].sum()))
        return PhysicalBounds(
            links=usual.links,
            lower=lower,
            upper=upper,
            drives={**usual.drives, **self.drives},
            total_mass=total,
            rules=replace(usual.rules, **self.rules),
            source=self.source,
        )

    def boxes(self, links: tuple[str, ...], usual: Array) -> Array:
        """Boxes of the centres of mass ``(n_segments, 2, 3)`` [m] with what is stated put in."""
        boxes = usual.copy()
        for i, link in enumerate(links):
            stated = self.of(link)
            for axis, name in enumerate(NAMES[1:4]):
                if name in stated:
                    boxes[i, :, axis] = stated[name]
        return boxes

    def judge(self, links: tuple[str, ...], inertial: Array, drives: Mapping[str, float]) -> BoundsReport:
        """Compare identified parameters with what is stated.

        Args:
            links: links of all segments, in the robot's order.
            inertial: ``(10·n_segments,)`` standard parameters.
            drives: identified drives' parameters; bounds of others say nothing.
        """
        found = list(self._values(links, inertial, drives))
        broken = sorted((item for item in found if item.inside < -_AT), key=lambda item: item.inside)
        reached = tuple(item for item in found if abs(item.inside) <= _AT)
        return BoundsReport(self.source, len(found), reached, tuple(broken))

    def _values(
        self, links: tuple[str, ...], inertial: Array, drives: Mapping[str, float]
    ) -> Iterator[BoundReached]:
        physical = physical_parameters(inertial)
        for link, row in zip(links, physical, strict=True):
            for name, bounds in self.of(link).items():
                yield BoundReached(f"{link}.{name}", float(row[NAMES.index(name)]), *bounds)
        for name, bounds in self.drives.items():
            if name in drives:
                yield BoundReached(name, drives[name], *bounds)
        if self.total_mass is not None:
            yield BoundReached("total_mass", float(physical[:, 0].sum()), *self.total_mass)
