"""Stated bounds of physical parameters as rows on the standard ones, for methods that are linear in these."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.physical.bounds import PhysicalBounds
from excite.identification.physical.coordinates import COLUMNS, NAMES, ROWS, STEINER
from excite.identification.physical.known_bounds import Interval, KnownBounds
from excite.identification.problem import IdentificationProblem

_MASS, _FIRST, _INERTIA = 0, slice(1, 4), 4


def stated_bounds(
    problem: IdentificationProblem, known: KnownBounds, usual: PhysicalBounds
) -> LinearConstraints:
    """Rows that every body within the stated bounds meets.

    Masses, the total mass, drives and centres of mass (``lower·m ≤ mc ≤ upper·m``) exactly. Moments and
    products of inertia are bounded about the centre of mass, from where the way to the joint frame is not
    linear: what they can be about it, over all masses and centres of mass within the bounds, is demanded, so
    that no allowed body is cut off but some others pass.

    Args:
        problem: the problem.
        known: what is stated.
        usual: bounds of what is not, for the reach of masses and centres of mass.
    """
    bounds = known.over(usual)
    builder = _Rows(problem)
    for k, segment in enumerate(problem.robot.segments):
        if k in problem.unmeasured:
            continue
        builder.body(
            10 * k, segment.link, known.of(segment.link), _steiner_bounds(bounds.lower[k], bounds.upper[k])
        )
    for name, pair in known.drives.items():
        if name in problem.parameter_names:
            builder.within({problem.parameter_names.index(name): 1.0}, pair, name)
    if known.total_mass is not None:
        total = dict.fromkeys(range(0, problem.n_inertial, 10), 1.0)
        builder.within(total, known.total_mass, "total_mass")
    return builder.constraints()


def speaks_of(problem: IdentificationProblem, known: KnownBounds) -> list[int]:
    """Columns of the parameters whose bounds are stated."""
    links = [segment.link for segment in problem.robot.segments]
    columns = [10 * k + NAMES.index(name) for k, link in enumerate(links) for name in known.of(link)]
    return columns + [
        problem.parameter_names.index(name) for name in known.drives if name in problem.parameter_names
    ]


def _steiner_bounds(lower: Array, upper: Array) -> Array:
    """Least and greatest of what the mass at the centre of mass adds to the six inertias, ``(2, 6)``.

    Args:
        lower: ``(10,)`` bounds of one segment.
        upper: ``(10,)``.
    """
    corners = np.stack([lower[_FIRST], upper[_FIRST]])
    products = np.array(
        [_product_bounds(corners[:, i], corners[:, j], i == j) for i, j in zip(ROWS, COLUMNS, strict=True)]
    )
    terms = np.stack([STEINER * products[:, 0], STEINER * products[:, 1]])
    least, greatest = terms.min(axis=0).sum(axis=1), terms.max(axis=0).sum(axis=1)
    masses = (lower[_MASS], upper[_MASS])
    return np.array(
        [
            np.minimum(least * masses[0], least * masses[1]),
            np.maximum(greatest * masses[0], greatest * masses[1]),
        ]
    )


def _product_bounds(first: Array, second: Array, same: bool) -> Interval:
    """Least and greatest product of two coordinates; of one with itself it is not negative."""
    corners = np.outer(first, second)
    if not same:
        return float(corners.min()), float(corners.max())
    squares = first**2
    return 0.0 if first[0] <= 0.0 <= first[1] else float(squares.min()), float(squares.max())


class _Rows:
    """Rows under construction."""

    def __init__(self, problem: IdentificationProblem):
        self._size = problem.n_params
        self._rows: list[Array] = []
        self._bound: list[float] = []
        self._labels: list[str] = []

    def at_least(self, terms: dict[int, float], bound: float, name: str) -> None:
        row = np.zeros(self._size)
        row[list(terms)] = list(terms.values())
        self._rows.append(row)
        self._bound.append(bound)
        self._labels.append(f"stated:{name}")

    def within(self, terms: dict[int, float], interval: Interval, name: str) -> None:
        self.at_least(terms, interval[0], name)
        self.at_least({column: -factor for column, factor in terms.items()}, -interval[1], name)

    def body(self, column: int, link: str, stated: dict[str, Interval], steiner: Array) -> None:
        """Rows of one segment, whose parameters start at ``column``."""
        for name, (low, high) in stated.items():
            place, label = NAMES.index(name), f"{link}.{name}"
            if place == _MASS:
                self.within({column: 1.0}, (low, high), label)
            elif place < _INERTIA:
                self.at_least({column + place: 1.0, column: -low}, 0.0, label)
                self.at_least({column + place: -1.0, column: high}, 0.0, label)
            else:
                reach = steiner[:, place - _INERTIA]
                self.within({column + place: 1.0}, (low + float(reach[0]), high + float(reach[1])), label)

    def constraints(self) -> LinearConstraints:
        rows = np.array(self._rows).reshape(-1, self._size)
        return LinearConstraints(rows, np.array(self._bound), tuple(self._labels))
