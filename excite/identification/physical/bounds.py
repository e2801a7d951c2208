"""Bounds of the physical parameters and rules between them (Xu et al. 2020, eq. 16 to 18)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import InputError
from excite.identification.inertia import inertia_matrices
from excite.identification.physical.coordinates import DIAGONAL, NAMES, OFF_DIAGONAL


@dataclass(frozen=True)
class InertiaRules:
    """Rules between the moments of inertia about each centre of mass, along the joint frame's axes (eq. 18).

    The diagonal moments always obey the triangle inequality.

    Attributes:
        diagonal_ratio: the largest diagonal moment is at most this many times the smallest; None for no rule.
        off_diagonal_share: products of inertia are at most this share of the smallest diagonal moment; None
            for no rule.
        slenderness: the moment about the own axis of each link in ``slender``, times this, is at most each of
            the others.
        slender: own axis (0, 1 or 2) of slender links, by link.
        principal_triangle: whether the principal moments obey the triangle inequality too, without which no
            body of positive density exists; eq. (18) asks it of the diagonal ones alone.
    """

    diagonal_ratio: float | None = 100.0
    off_diagonal_share: float | None = 0.1
    slenderness: float = 3.0
    slender: Mapping[str, int] = field(default_factory=dict)
    principal_triangle: bool = True

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
            own = DIAGONAL[self.slender[link]]
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
        self, physical: Array, drives: Mapping[str, float], segments: Sequence[int] | NDArray[np.int64]
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
