"""Inertial parameters of a person's segments from the published tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from excite.arrays import Array
from excite.errors import UnknownNameError
from excite.human.dimensions import Dimensions
from excite.human.segments import NAMES, SEGMENTS
from excite.human.subject import Subject
from excite.human.tables import de_leva, dumas

Anthropometry = Literal["de_leva", "dumas"]
ANTHROPOMETRY: tuple[str, ...] = ("de_leva", "dumas")
_MIRROR = np.diag([1.0, -1.0, 1.0])
# From X forward, Y up, Z right to x forward, y left, z up.
_FROM_ISB = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
# Height of the seventh cervical spine's tip above the cervical joint, as share of the torso's length.
_CERVICALE = 0.05
_TRIANGLE = 1.01


@dataclass(frozen=True, eq=False)
class BodyInertia:
    """A rigid body in its segment's frame.

    Attributes:
        mass: [kg].
        center: centre of mass ``(3,)`` [m].
        inertia: about the centre of mass, axes of the segment ``(3, 3)`` [kg·m²].
    """

    mass: float
    center: Array
    inertia: Array

    def __add__(self, other: BodyInertia) -> BodyInertia:
        mass = self.mass + other.mass
        center = (self.mass * self.center + other.mass * other.center) / mass
        inertia = sum((part.about(center) for part in (self, other)), np.zeros((3, 3)))
        return BodyInertia(mass, center, inertia)

    def about(self, point: Array) -> Array:
        """Inertia about another point, ``(3, 3)``."""
        d = self.center - point
        return self.inertia + self.mass * (d @ d * np.eye(3) - np.outer(d, d))

    def mirrored(self) -> BodyInertia:
        """The body's image at the sagittal plane."""
        return BodyInertia(self.mass, _MIRROR @ self.center, _MIRROR @ self.inertia @ _MIRROR)


def body_inertias(subject: Subject, dimensions: Dimensions, table: Anthropometry) -> tuple[BodyInertia, ...]:
    """The fifteen segments' inertial parameters, in the order of the segments.

    The table's percentages are scaled so that they add up to the subject's mass (de Leva's men add up to
    100.00 %, Dumas' to 100.2 and 99.9 %).

    Args:
        subject: mass and sex.
        dimensions: lengths that the table's percentages refer to.
        table: ``de_leva`` or ``dumas``.

    Raises:
        UnknownNameError: no such table.
    """
    if table not in ANTHROPOMETRY:
        raise UnknownNameError("table of segment inertias", table, list(ANTHROPOMETRY))
    builder = _de_leva if table == "de_leva" else _dumas_inertia
    share = mass_shares(subject, table)
    bodies = []
    for segment, name in zip(SEGMENTS, NAMES, strict=True):
        body = builder(subject, dimensions, segment.kind, segment.side or "right")
        factor = subject.mass * share[name] / body.mass
        body = BodyInertia(body.mass * factor, body.center, body.inertia * factor)
        bodies.append(body.mirrored() if segment.side == "left" else body)
    return tuple(bodies)


def mass_shares(subject: Subject, table: Anthropometry) -> dict[str, float]:
    """Share of the body's mass by segment; they add up to one."""
    raw = {}
    for segment in SEGMENTS:
        if table == "dumas":
            raw[segment.name] = dumas.TABLE[subject.sex][segment.kind].mass
            continue
        rows = de_leva.TABLE[subject.sex]
        raw[segment.name] = sum(rows[part].mass for part in _DE_LEVA_PARTS.get(segment.kind, (segment.kind,)))
    total = sum(raw.values())
    return {name: value / total for name, value in raw.items()}


_DE_LEVA_PARTS = {"pelvis": ("lower trunk",), "torso": ("mid trunk", "upper trunk")}


def _reference_length(dimensions: Dimensions, kind: str, side: str) -> float:
    """The length that Dumas' percentages of a segment refer to [m]."""
    named = {
        "pelvis": dimensions.pelvis,
        "torso": dimensions.torso,
        "head": dimensions.head,
        "hand": dimensions.hand,
        "foot": dimensions.foot,
    }
    return named[kind] if kind in named else dimensions[f"{side}_{kind}"]


def _dumas_inertia(subject: Subject, dimensions: Dimensions, kind: str, side: str) -> BodyInertia:
    row = dumas.TABLE[subject.sex][kind]
    length = _reference_length(dimensions, kind, side)
    xx, yy, zz = (np.array(row.diagonal) / 100.0) ** 2
    xy, xz, yz = (np.sign(p) * (p / 100.0) ** 2 for p in row.products)
    radii = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    mass = row.mass / 100.0 * subject.mass
    center = _FROM_ISB @ (np.array(row.center) / 100.0 * length)
    if kind == "pelvis":
        center = center + np.array([dimensions["lumbar_x"], 0.0, dimensions["lumbar_z"]])
    elif kind == "torso":
        center = center + np.array([dimensions["neck_x"], 0.0, dimensions["neck_z"]])
    return BodyInertia(mass, center, mass * length**2 * _FROM_ISB @ _possible_tensor(radii) @ _FROM_ISB.T)


def _possible_tensor(radii: Array) -> Array:
    """The tensor with products just so much smaller that a body can have it.

    The women's torso of Dumas' table breaks the triangle inequality of the principal moments (its product XY
    is that of a frame tilted against the principal axes, rounded); its products are taken at 84 %.
    """
    diagonal = np.diag(np.diag(radii))
    for share in np.linspace(1.0, 0.0, 51):
        tensor = diagonal + share * (radii - diagonal)
        moments = np.linalg.eigvalsh(tensor)
        if moments[0] > 0.0 and moments[0] + moments[1] > _TRIANGLE * moments[2]:
            return tensor
    return diagonal


def _de_leva(subject: Subject, dimensions: Dimensions, kind: str, side: str) -> BodyInertia:
    """De Leva's segments; the pelvis ends at the navel, as his lower trunk does."""
    rows = de_leva.TABLE[subject.sex]
    if kind in ("pelvis", "torso"):
        bodies = [_trunk_part(subject, dimensions, rows, part) for part in _DE_LEVA_PARTS[kind]]
        total = bodies[0]
        for body in bodies[1:]:
            total = total + body
        if kind == "torso":
            lumbar = np.array([dimensions["lumbar_x"], 0.0, dimensions["lumbar_z"]])
            total = BodyInertia(total.mass, total.center - lumbar, total.inertia)
        return total
    if kind == "head":
        row = rows["head to cervicale"]
        return _inertia_along(
            row, subject, [0.0, 0.0, (1.0 - row.center / 100.0) * dimensions.head], dimensions.head
        )
    row = rows[kind]
    if kind == "foot":
        length = dimensions.foot_length
        center = [row.center / 100.0 * length - dimensions.heel, 0.0, -0.5 * dimensions.ankle_height]
        return _inertia_along(row, subject, center, length, lying=True)
    length = dimensions.hand if kind == "hand" else dimensions[f"{side}_{kind}"]
    return _inertia_along(row, subject, [0.0, 0.0, -row.center / 100.0 * length], length)


def _trunk_part(
    subject: Subject, dimensions: Dimensions, rows: dict[str, de_leva.Row], part: str
) -> BodyInertia:
    """A part of the trunk in the pelvis' frame, on the line from the middle of the hips to the cervicale."""
    top = np.array([dimensions["lumbar_x"] + dimensions["neck_x"], 0.0, 0.0])
    top[2] = dimensions["lumbar_z"] + dimensions["neck_z"] + _CERVICALE * dimensions.torso
    scale = float(np.linalg.norm(top)) / rows["trunk from cervicale"].length
    lower, middle = rows["lower trunk"].length, rows["mid trunk"].length
    upper_end = {"lower trunk": lower, "mid trunk": lower + middle}.get(
        part, lower + middle + rows["upper trunk"].length
    )
    row = rows[part]
    height = (upper_end - row.center / 100.0 * row.length) * scale
    return _inertia_along(row, subject, top / np.linalg.norm(top) * height, row.length * scale)


def _inertia_along(
    row: de_leva.Row, subject: Subject, center: list[float] | Array, length: float, *, lying: bool = False
) -> BodyInertia:
    """A body whose long axis is z, or x where it lies (the foot, whose sagittal axis then is vertical)."""
    order = (row.longitudinal, row.transverse, row.sagittal)
    radii = np.array(order if lying else order[::-1]) / 100.0 * length
    mass = row.mass / 100.0 * subject.mass
    return BodyInertia(mass, np.asarray(center, dtype=float), mass * np.diag(radii**2))
