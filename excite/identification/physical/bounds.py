"""Bounds of the physical parameters and rules between them (Xu et al. 2020, eq. 16 to 18)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from excite.arrays import Array, Indices
from excite.errors import InputError
from excite.identification.inertia import DIAGONAL, NAMES, OFF_DIAGONAL, inertia_matrices, physical_parameters
from excite.results import Name, Stated, Unbounded, named, stated

_Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class InertiaRules(BaseModel):
    """Rules between the moments of inertia about each centre of mass, along the joint frame's axes (eq. 18).

    The diagonal moments always obey the triangle inequality.

    Attributes:
        diagonal_ratio: the largest diagonal moment is at most this many times the smallest; None for no rule.
        off_diagonal_share: products of inertia are at most this share of the smallest diagonal moment; None
            for no rule.
        slenderness: the moment about the own axis of each link in ``slender``, times this, is at most each of
            the others.
        slender: own axis of slender links, by link.
        principal_triangle: whether the principal moments obey the triangle inequality too, without which no
            body of positive density exists; eq. (18) asks it of the diagonal ones alone.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    diagonal_ratio: _Positive | None = 100.0
    off_diagonal_share: _Positive | None = 0.1
    slenderness: _Positive = 3.0
    slender: dict[str, Literal["x", "y", "z"]] = {}
    principal_triangle: Annotated[bool, Field(strict=True)] = True

    def rows(self, link: str) -> Array:
        """Rows ``R`` of ``R · (Ixx, Ixy, Iyy, Ixz, Iyz, Izz) ≥ 0`` for a link, ``(k, 6)``."""
        found = [{b: -1.0 if b == a else 1.0 for b in DIAGONAL} for a in DIAGONAL]
        others = [(a, b) for a in DIAGONAL for b in DIAGONAL if b != a]
        if self.diagonal_ratio is not None:
            found += [{b: self.diagonal_ratio, a: -1.0} for a, b in others]
        if self.off_diagonal_share is not None:
            signs = [(a, b, sign) for a in DIAGONAL for b in OFF_DIAGONAL for sign in (1.0, -1.0)]
            found += [{a: self.off_diagonal_share, b: sign} for a, b, sign in signs]
        if link in self.slender:
            own = DIAGONAL["xyz".index(self.slender[link])]
            found += [{b: 1.0, own: -self.slenderness} for b in DIAGONAL if b != own]
        return np.array([[row.get(place, 0.0) for place in range(6)] for row in found])


@dataclass(frozen=True, eq=False)
class PhysicalBounds:
    """What is known of the physical parameters before any measurement.

    Attributes:
        links: links of the segments, in the robot's order.
        lower: ``(n_segments, 10)`` of ``m, cx, cy, cz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz``, inertias about the
            centre of mass, along the joint frame's axes [kg, m, kg·m²] (eq. 16).
        upper: ``(n_segments, 10)``.
        drives: lower and upper bound of the drives' parameters by name, such as ``viscous.joint1``; those
            without get a wide one from the data.
        total_mass: least and greatest mass of all segments together [kg] (eq. 17).
        rules: rules between the inertias (eq. 18).
        source: where they come from.
    """

    links: tuple[str, ...]
    lower: Array
    upper: Array
    drives: Mapping[str, tuple[float, float]]
    total_mass: tuple[float, float]
    rules: InertiaRules
    source: str = ""

    def __post_init__(self) -> None:
        """Check shapes and that something lies between the bounds.

        Raises:
            InputError: names the first bad parameter.
        """
        if self.lower.shape != (len(self.links), 10) or self.upper.shape != (len(self.links), 10):
            raise InputError(f"bounds of shape {self.lower.shape} for {len(self.links)} links")
        for i, j in np.argwhere(~(self.lower < self.upper) | ~np.isfinite(self.upper - self.lower)):
            raise _empty_interval(
                f"{self.links[i]}.{NAMES[j]}", self.lower[i, j], self.upper[i, j], self.source
            )
        if (self.lower[:, 0] <= 0.0).any():
            link = self.links[int(np.argmin(self.lower[:, 0]))]
            raise InputError(
                "is not positive",
                source=self.source or None,
                field=f"{link}.m",
                remedy="bound the mass away from 0",
            )
        for name, (low, high) in self.drives.items():
            if not low < high:
                raise _empty_interval(name, low, high, self.source)
        if not self.total_mass[0] < self.total_mass[1]:
            raise _empty_interval("total_mass", *self.total_mass, self.source)

    def violations(
        self, physical: Array, drives: Mapping[str, float], segments: Sequence[int] | Indices
    ) -> dict[str, float]:
        """Largest violation of each kind of constraint, recomputed from the parameters; 0 where all hold.

        Args:
            physical: ``(n_segments, 10)`` as the bounds.
            drives: the drives' parameters by name.
            segments: indices of the segments that are to be judged; all count for the total mass.

        Returns:
            By kind: ``mass`` [kg], ``com`` [m], ``inertia`` [kg·m²] and ``drive`` [SI] for eq. (16),
            ``total_mass`` [kg] for eq. (17), ``inertia_rules`` [kg·m²] for eq. (18), and
            ``principal_triangle`` [kg·m²] where it is asked for.
        """
        judged = physical[segments]
        below = np.maximum(self.lower[segments] - judged, judged - self.upper[segments])
        total = float(physical[:, 0].sum())
        outside = [
            max(low - drives[name], drives[name] - high)
            for name, (low, high) in self.drives.items()
            if name in drives
        ]
        rules = [
            (-self.rules.rows(self.links[k]) @ mu[4:]).max() for k, mu in zip(segments, judged, strict=True)
        ]
        worst = {
            "mass": below[:, 0].max(initial=0.0),
            "com": below[:, 1:4].max(initial=0.0),
            "inertia": below[:, 4:].max(initial=0.0),
            "drive": max(outside, default=0.0),
            "total_mass": max(self.total_mass[0] - total, total - self.total_mass[1]),
            "inertia_rules": max(rules, default=0.0),
        }
        if self.rules.principal_triangle:
            worst["principal_triangle"] = -least_density_moments(judged[:, 4:]).min(initial=0.0)
        return {kind: max(0.0, float(value)) for kind, value in worst.items()}


def least_density_moments(inertias: Array) -> Array:
    """Least eigenvalue of ``½tr(I)·1 − I`` of each inertia ``(n, 6)``; ``(n,)`` [kg·m²].

    Not negative where the principal moments obey the triangle inequality.
    """
    full = inertia_matrices(np.hstack([np.zeros((len(inertias), 4)), inertias]).ravel())
    second = 0.5 * np.trace(full, axis1=1, axis2=2)[:, None, None] * np.eye(3) - full
    return np.linalg.eigvalsh(second)[:, 0]


def _empty_interval(name: str, low: float, high: float, source: str) -> InputError:
    return InputError(
        f"has bounds [{low:g}, {high:g}] with nothing between",
        source=source or None,
        field=name,
        remedy="put the lower one below the upper",
    )


# Bounds that somebody states for some of the physical parameters, and what becomes of them.

Interval = tuple[float, float]

# What rounding leaves at a bound, as share of the interval.
AT_BOUND = 1e-6


@dataclass(frozen=True)
class BoundReached(Stated):
    """A parameter and the bound that was stated for it.

    Attributes:
        name: such as ``link1.m`` or ``viscous.joint1`` or ``total_mass``.
        value: what was identified [SI].
        bounds: lower and upper one [SI].
    """

    name: Name = field(metadata=named("parameter"))
    value: Unbounded
    bounds: tuple[float, float]

    @property
    @stated
    def by(self) -> Unbounded:
        """How far the value lies outside; 0 where it does not, null where it is not defined."""
        outside = max(0.0, self.bounds[0] - self.value, self.value - self.bounds[1])
        return outside if np.isfinite(self.value) else float("inf")

    @property
    def inside(self) -> float:
        """How far the value lies from the nearer bound, as share of the interval; negative outside."""
        low, high = self.bounds
        nearest = min(self.value - low, high - self.value)
        return nearest / (high - low) if np.isfinite(nearest) else -np.inf


@dataclass(frozen=True)
class BoundsReport(Stated):
    """Stated bounds against identified parameters, recomputed from these.

    Attributes:
        source: the file.
        stated: number of parameters with a stated bound.
        reached: those that lie at their bound.
        broken: those that lie outside, the worst first.
    """

    source: str = field(metadata=named("file"))
    stated: int
    reached: tuple[BoundReached, ...] = field(metadata=named("at_bound"))
    broken: tuple[BoundReached, ...] = field(metadata=named("outside"))

    def summary(self) -> str:
        """One line."""
        text = f"bounds of {self.source}: {self.stated} stated, {len(self.reached)} reached"
        if self.broken:
            worst = self.broken[0]
            text += f", {len(self.broken)} broken, {worst.name} by {worst.by:.3g}"
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
            rules=usual.rules.model_copy(update=self.rules),
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
        physical = physical_parameters(inertial)
        values = {
            f"{link}.{name}": float(value)
            for link, row in zip(links, physical, strict=True)
            for name, value in zip(NAMES, row, strict=True)
        }
        stated = {name: pair for name, pair in self.parameters.items() if name in values}
        stated |= {name: pair for name, pair in self.drives.items() if name in drives}
        values |= drives
        if self.total_mass is not None:
            stated["total_mass"], values["total_mass"] = self.total_mass, float(physical[:, 0].sum())
        found = [BoundReached(name, values[name], pair) for name, pair in stated.items()]
        broken = sorted((item for item in found if item.inside < -AT_BOUND), key=lambda item: item.inside)
        reached = tuple(item for item in found if abs(item.inside) <= AT_BOUND)
        return BoundsReport(self.source, len(found), reached, tuple(broken))
