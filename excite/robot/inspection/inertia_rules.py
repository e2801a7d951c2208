"""Inertias that no body has, and the smallest correction that makes one of them possible."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.finding import Finding, Severity
from excite.robot.inspection.links import MOMENTS, DescribedLink, DescribedRobot, Solid, tensor
from excite.robot.inspection.slips import numbers_in_words
from excite.robot.urdf.inertia import TOLERANCE

# The nearest possible inertia is the correction where it is this near; farther off, other readings are tried.
_NEAR = 0.2
# A reading of an inertia is believed within this factor of the shape's.
_ODD = 10.0
# What six digits round away.
_HAIR = 1e-5
# Rounding to few digits breaks the inequality by less than this share.
_ROUNDED = 0.01


def impossible_inertia(robot: DescribedRobot) -> Iterator[Finding]:
    """Principal moments are positive, and none is larger than the other two together (triangle inequality)."""
    for link in robot.links.values():
        if link.mass is None or not link.stated.any():
            continue
        if link.mass < 0.0:
            said, figures = f"its mass is {link.mass:g} kg", {"mass": link.mass}
            yield Finding(
                "not_positive", said, figures, (link.name,), "spoils", remedy=f'value="{-link.mass:g}"'
            )
        moments, axes = np.linalg.eigh(link.inertia)
        # Digits that were not written move a principal moment by at most the norm of a matrix of half-steps.
        slack = TOLERANCE * abs(moments[2]) + 3.0 * link.step
        excess = moments[2] - moments[0] - moments[1]
        if moments[0] < -TOLERANCE * max(moments[2], 0.0) or moments[2] <= 0.0:
            said = f"its inertia is not positive definite: the smallest principal moment is {moments[0]:.3g} kg·m²"
            found = Finding("not_positive", said, {"smallest_moment": float(moments[0])})
        elif excess > TOLERANCE * moments[2]:
            share = 100.0 * excess / moments[2]
            said = (
                f"its inertia breaks the triangle inequality by {share:.2g} %: the principal moment {moments[2]:.4g}"
                f" about ({numbers_in_words(axes[:, 2])}), nearest {'xyz'[int(np.abs(axes[:, 2]).argmax())]}, is more"
                f" than the sum {moments[0]:.4g} + {moments[1]:.4g} kg·m² of the other two"
            )
            rounded = excess <= min(slack, _ROUNDED * moments[2])
            found = Finding(
                "triangle", said + ", by rounding" * bool(rounded), {"excess_percent": float(share)}
            )
        else:
            continue
        note = robot.is_weightless(link) or found.text.endswith("rounding")
        words, better = _better_inertia(link, next(iter(robot.hulls(link.name)), None))
        values = " ".join(f'{name}="{value:.6g}"' for name, value in zip(MOMENTS, better, strict=True))
        severity: Severity = "note" if note and found.kind == "triangle" else "spoils"
        yield replace(found, places=(link.name,), severity=severity, remedy=f"{words}: {values}")


def _better_inertia(link: DescribedLink, solid: Solid | None) -> tuple[str, Array]:
    """The smallest correction that makes an inertia possible, as the six numbers to write.

    Where the nearest possible one is far, the numbers may stand in another order, or one of them has lost its sign or
    decimal point: of those readings that are possible, the one nearest to a body of even density.
    """
    six = link.stated
    nearest = nearest_inertia(six)
    if np.linalg.norm(nearest - six) <= _NEAR * np.linalg.norm(six):
        return "the nearest inertia that a body can have", nearest
    even = np.zeros(6)
    if solid is not None and link.weighs:
        covariance = link.axes.T @ solid.spread[1] @ link.axes * float(link.mass or 0.0)
        even = _six(np.trace(covariance) * np.eye(3) - covariance)
    found = [(words, reading) for words, reading in _readings(six, even) if is_possible(reading)]
    if not found:
        return "the nearest inertia that a body can have", nearest
    if even.any():
        # A hundredth of a factor of e for each place in the list: of readings that fit alike, the first.
        off = [_off(reading, even) + 0.01 * place for place, (_, reading) in enumerate(found)]
        if min(off) > math.log(_ODD):
            return "the nearest inertia that a body can have", nearest
        return found[int(np.argmin(off))]
    return found[0]


def _off(six: Array, even: Array) -> float:
    """How far the diagonal of an inertia is from that of an even body, as a logarithm."""
    return float(np.linalg.norm(np.log(np.abs(six[[0, 3, 5]] / even[[0, 3, 5]]) + 1e-300)))


def _readings(six: Array, even: Array) -> Iterator[tuple[str, Array]]:
    """What six numbers may have been meant to be; ``even`` is the inertia of the shape, zeros where it has none."""
    a, b, c, d, e, f = six
    if math.isclose(b, d, rel_tol=1e-6, abs_tol=1e-12):
        # izz was the ninth number and is not there: as of the shape, else of a body as thick as it is wide.
        scale = (a + e) / (even[0] + even[3]) if even.any() else 0.0
        zz = even[5] * scale if even.any() else max(a, e)
        yield (
            "a 3 × 3 written row by row; its ninth number, izz, is lost and estimated",
            np.array([a, b, c, e, f, zz]),
        )
    yield "in MJCF's order, ixx iyy izz ixy ixz iyz", np.array([a, d, e, b, f, c])
    yield "in URDF's order, ixx ixy ixz iyy iyz izz", np.array([a, d, f, b, c, e])
    yield "its lower triangle row by row, ixx ixy iyy ixz iyz izz", np.array([a, b, d, c, e, f])
    for index in range(6):
        turned = six.copy()
        turned[index] *= -1.0
        yield f"sign lost of {MOMENTS[index]}", turned
    turned = six.copy()
    turned[[1, 2, 4]] *= -1.0
    yield "signs lost of all products of inertia", turned
    # Without a shape any digit may be the lost one.
    for index in range(6 if even.any() else 0):
        for factor in (0.1, 10.0, 0.01, 100.0, 1e-3, 1e3):
            moved = six.copy()
            moved[index] *= factor
            yield f"a decimal point lost in {MOMENTS[index]}", moved


def is_possible(six: Array) -> bool:
    """Whether a body can have the inertia of ixx, ixy, ixz, iyy, iyz, izz ``(6,)`` [kg·m²]."""
    low, middle, high = np.linalg.eigvalsh(tensor(six))
    return bool(low > 0.0 and low + middle >= high * (1.0 - TOLERANCE))


def _six(matrix: Array) -> Array:
    return np.array([matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 1], matrix[1, 2], matrix[2, 2]])


def nearest_inertia(six: Array) -> Array:
    """The inertia nearest to one that no body can have, in the Frobenius norm.

    It has the same principal axes, and the moments nearest to the stated ones that obey the triangle inequality: the
    second moments L = ½ tr(I) − I are projected onto those that are not negative.

    Args:
        six: ixx, ixy, ixz, iyy, iyz, izz ``(6,)`` [kg·m²].

    Returns:
        The same six of the nearest ``(6,)`` [kg·m²].
    """
    moments, axes = np.linalg.eigh(tensor(six))
    # Rows a·moments ≥ 0 of the triangle inequality; each set of active ones gives a projection, the nearest is right.
    rows = np.ones((3, 3)) - 2.0 * np.eye(3)
    best, distance = np.zeros(3), math.inf
    for n in range(4):
        for active in itertools.combinations(range(3), n):
            a = rows[list(active)]
            point = moments - (np.linalg.pinv(a) @ (a @ moments) if n else 0.0)
            off = float(np.linalg.norm(point - moments))
            if (rows @ point >= -1e-12 * np.abs(moments).max()).all() and off < distance:
                best, distance = point, off
    # A hair inside, so that rounding to six digits does not break it again.
    best = best + _HAIR * np.abs(moments).max()
    return _six(axes @ np.diag(best) @ axes.T)
