"""A person's body: dimensions and inertial parameters, from published tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError, UnknownNameError
from excite.formats.documents import read_yaml
from excite.human.segments import NAMES, SEGMENTS, SIDES, Subject

# Published tables; the file says their sources, units and axes.


class DeLevaRow(NamedTuple):
    """One segment of one sex: radii of gyration about three axes [% of length]."""

    mass: float
    length: float
    center: float
    sagittal: float
    transverse: float
    longitudinal: float


class DumasRow(NamedTuple):
    """One segment of one sex: X Y Z of its centre, radii about the axes, roots of the products [% of length]."""

    length: float
    mass: float
    center: tuple[float, float, float]
    diagonal: tuple[float, float, float]
    products: tuple[float, float, float]


class PelvisLandmarks(NamedTuple):
    """Joint centres from the midpoint of the two anterior superior iliac spines [% of their distance, mm]."""

    width: float
    lumbar: tuple[float, float]
    hip: tuple[float, float, float]


_PUBLISHED = read_yaml(Path(__file__).with_name("segment_tables.yaml"))
DE_LEVA_TABLE: dict[str, dict[str, DeLevaRow]] = {
    sex: {name: DeLevaRow(*row) for name, row in rows.items()} for sex, rows in _PUBLISHED["de_leva"].items()
}
DUMAS_TABLE: dict[str, dict[str, DumasRow]] = {
    sex: {name: DumasRow(*row) for name, row in rows.items()} for sex, rows in _PUBLISHED["dumas"].items()
}
DUMAS_PELVIS: dict[str, PelvisLandmarks] = {
    sex: PelvisLandmarks(*row) for sex, row in _PUBLISHED["pelvis"].items()
}

# Where the joints of a person lie: sixteen lengths, from stature or calibrated from markers.

_LIMBS = ("upper_arm", "forearm", "thigh", "shank")
DIMENSIONS: tuple[str, ...] = (
    "hip_half_width",
    "lumbar_x",
    "lumbar_z",
    "neck_x",
    "neck_z",
    "shoulder_x",
    "shoulder_half_width",
    "shoulder_z",
    *(f"{side}_{part}" for side in SIDES for part in _LIMBS),
)


@dataclass(frozen=True, eq=False)
class Dimensions:
    """Lengths of a person [m], with standard deviations where they are a guess.

    Attributes:
        values: ``(16,)`` in the order of :data:`DIMENSIONS`; x forward, z up. ``lumbar`` is in the pelvis' frame
            (midway between the hips), ``neck`` and ``shoulder`` in the torso's (lumbar joint).
        spread: ``(16,)`` standard deviation.
        head: from the cervical joint to the vertex.
        hand: from the wrist to the metacarpal heads.
        foot: from the ankle to the metatarsal heads.
        foot_length: from the heel to the toe's tip.
        heel: how far the heel lies behind the ankle.
        ankle_height: of the ankle's centre above the sole.
    """

    values: Array
    spread: Array
    head: float
    hand: float
    foot: float
    foot_length: float
    heel: float
    ankle_height: float

    def __getitem__(self, name: str) -> float:
        return float(self.values[DIMENSIONS.index(name)])

    @property
    def torso(self) -> float:
        """Distance of the cervical from the lumbar joint."""
        return float(np.hypot(self["neck_x"], self["neck_z"]))

    @property
    def pelvis(self) -> float:
        """Distance of the lumbar joint from the middle of the hips."""
        return float(np.hypot(self["lumbar_x"], self["lumbar_z"]))


def stature_dimensions(subject: Subject) -> Dimensions:
    """Dimensions in proportion to stature, of Dumas' mean subject of that sex (Dumas et al. 2007, table 2).

    The foot's length is 15.2 % of stature (Winter 2009, figure 4.1).
    """
    scale = subject.height / _PUBLISHED["stature"][subject.sex]
    length = {kind: 1e-3 * row.length * scale for kind, row in DUMAS_TABLE[subject.sex].items()}
    pelvis = DUMAS_PELVIS[subject.sex]
    hip, lumbar = (1e-5 * pelvis.width * scale * np.array(place) for place in (pelvis.hip, pelvis.lumbar))
    torso = length["torso"]
    # Shoulder from the cervical joint, forward, sideways and down, of Dumas' mean man [m].
    forward, outward, down = (
        np.array((0.021, 0.209, 0.073)) * torso / (1e-3 * DUMAS_TABLE["male"]["torso"].length)
    )
    limbs = [length[part] for part in _LIMBS]
    trunk = [hip[2], *(lumbar - hip[:2]), 0.0, torso, forward, outward, torso - down]
    values = np.array([*trunk, *limbs, *limbs])
    # Spreads between people of one stature: of limbs (Winter 2009, table 3.1 scatters by 3-5 %), of the trunk's joints.
    spread = np.concatenate([np.full(len(trunk), 0.015 * scale), 0.05 * values[len(trunk) :]])
    foot_length = 0.152 * subject.height
    ends = (length["head"], length["hand"], length["foot"])
    return Dimensions(values, spread, *ends, foot_length, 0.19 * foot_length, 0.039 * subject.height)


def joint_offsets() -> Array:
    """``(15, 3, 16)``: position of each segment's joint in its parent's frame per unit of each dimension."""
    rows = [
        (segment, axis, f"{joint}_{'xyz'[axis]}", 1.0)
        for segment, joint in (("torso", "lumbar"), ("head", "neck"))
        for axis in (0, 2)
    ]
    for side, outward in zip(SIDES, (-1.0, 1.0), strict=True):
        rows += [
            (f"{side}_thigh", 1, "hip_half_width", outward),
            (f"{side}_upper_arm", 0, "shoulder_x", 1.0),
            (f"{side}_upper_arm", 1, "shoulder_half_width", outward),
            (f"{side}_upper_arm", 2, "shoulder_z", 1.0),
        ]
        children = zip(("forearm", "hand", "shank", "foot"), _LIMBS, strict=True)
        rows += [(f"{side}_{child}", 2, f"{side}_{carrier}", -1.0) for child, carrier in children]
    matrix = np.zeros((len(NAMES), 3, len(DIMENSIONS)))
    for segment, axis, dimension, sign in rows:
        matrix[NAMES.index(segment), axis, DIMENSIONS.index(dimension)] = sign
    return matrix


Anthropometry = Literal["de_leva", "dumas"]
ANTHROPOMETRY: tuple[str, ...] = ("de_leva", "dumas")
_MIRROR = np.diag([1.0, -1.0, 1.0])
# From X forward, Y up, Z right to x forward, y left, z up.
_FROM_ISB = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def body_inertias(subject: Subject, dimensions: Dimensions, table: Anthropometry) -> tuple[pin.Inertia, ...]:
    """The fifteen segments' inertial parameters, each in its segment's frame, in the order of the segments.

    The table's percentages are scaled so that they add up to the subject's mass (de Leva's men add up to
    100.00 %, Dumas' to 100.2 and 99.9 %).

    Args:
        dimensions: lengths that the table's percentages refer to.
        table: ``de_leva`` or ``dumas``.

    Raises:
        UnknownNameError: no such table.
    """
    if table not in ANTHROPOMETRY:
        raise UnknownNameError("table of segment inertias", table, list(ANTHROPOMETRY))
    build = _de_leva_inertia if table == "de_leva" else _dumas_inertia
    bodies = [build(subject, dimensions, segment.kind, segment.side or "right") for segment in SEGMENTS]
    factor = subject.mass / sum(body.mass for body in bodies)
    # The left half is the right one's image at the sagittal plane.
    images = [_MIRROR if segment.side == "left" else np.eye(3) for segment in SEGMENTS]
    return tuple(
        pin.Inertia(body.mass * factor, image @ body.lever, image @ body.inertia @ image * factor)
        for image, body in zip(images, bodies, strict=True)
    )


_TRUNK = ("lower trunk", "mid trunk", "upper trunk")
_DE_LEVA_PARTS = {"pelvis": _TRUNK[:1], "torso": _TRUNK[1:]}


def _reference_length(dimensions: Dimensions, kind: str, side: str) -> float:
    """The length that the percentages of a segment refer to [m]."""
    return dimensions[f"{side}_{kind}"] if kind in _LIMBS else float(getattr(dimensions, kind))


def _dumas_inertia(subject: Subject, dimensions: Dimensions, kind: str, side: str) -> pin.Inertia:
    row = DUMAS_TABLE[subject.sex][kind]
    length = _reference_length(dimensions, kind, side)
    xx, yy, zz = (np.array(row.diagonal) / 100.0) ** 2
    xy, xz, yz = (np.sign(p) * (p / 100.0) ** 2 for p in row.products)
    radii = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    mass = row.mass / 100.0 * subject.mass
    center = _FROM_ISB @ (np.array(row.center) / 100.0 * length)
    child = {"pelvis": "torso", "torso": "head"}.get(kind)
    if child is not None:
        center = center + joint_offsets()[NAMES.index(child)] @ dimensions.values
    return pin.Inertia(mass, center, mass * length**2 * _FROM_ISB @ _possible_tensor(radii) @ _FROM_ISB.T)


def _possible_tensor(radii: Array) -> Array:
    """The tensor with products just so much smaller that a body can have it.

    The women's torso of Dumas' table breaks the triangle inequality of the principal moments (its product XY
    is that of a frame tilted against the principal axes, rounded); its products are taken at 84 %.
    """
    diagonal = np.diag(np.diag(radii))
    for share in np.linspace(1.0, 0.0, 51):
        tensor = diagonal + share * (radii - diagonal)
        moments = np.linalg.eigvalsh(tensor)
        if moments[0] > 0.0 and moments[0] + moments[1] > 1.01 * moments[2]:
            return tensor
    return diagonal


def _de_leva_inertia(subject: Subject, dimensions: Dimensions, kind: str, side: str) -> pin.Inertia:
    """De Leva's segments; the pelvis ends at the navel, as his lower trunk does.

    Parts of the trunk lie on the line from the middle of the hips to the cervicale.
    """
    rows = DE_LEVA_TABLE[subject.sex]
    if kind in _DE_LEVA_PARTS:
        lumbar, neck = (dimensions.values[DIMENSIONS.index(f"{j}_x") :][:2] for j in ("lumbar", "neck"))
        x, z = lumbar + neck
        # Height of the seventh cervical spine's tip above the cervical joint, as share of the torso's length.
        top = np.array([x, 0.0, z + 0.05 * dimensions.torso])
        scale = float(np.linalg.norm(top)) / rows["trunk from cervicale"].length
        ends = dict(zip(_TRUNK, np.cumsum([rows[part].length for part in _TRUNK]), strict=True))
        parts = []
        for part in _DE_LEVA_PARTS[kind]:
            row = rows[part]
            height = (ends[part] - row.center / 100.0 * row.length) * scale
            parts.append(_inertia_along(row, subject, top / np.linalg.norm(top) * height, row.length * scale))
        total = reduce(add, parts)
        origin = np.array([lumbar[0], 0.0, lumbar[1]]) if kind == "torso" else 0.0
        return pin.Inertia(total.mass, total.lever - origin, total.inertia)
    row = rows["head to cervicale" if kind == "head" else kind]
    length = dimensions.foot_length if kind == "foot" else _reference_length(dimensions, kind, side)
    along = row.center / 100.0 * length
    if kind == "foot":
        center = [along - dimensions.heel, 0.0, -0.5 * dimensions.ankle_height]
    else:
        center = [0.0, 0.0, length - along if kind == "head" else -along]
    return _inertia_along(row, subject, center, length, lying=kind == "foot")


def _inertia_along(
    row: DeLevaRow, subject: Subject, center: list[float] | Array, length: float, *, lying: bool = False
) -> pin.Inertia:
    """A body whose long axis is z, or x where it lies (the foot, whose sagittal axis then is vertical)."""
    order = (row.longitudinal, row.transverse, row.sagittal)
    radii = np.array(order if lying else order[::-1]) / 100.0 * length
    mass = row.mass / 100.0 * subject.mass
    return pin.Inertia(mass, np.asarray(center, dtype=float), mass * np.diag(radii**2))


@dataclass(frozen=True, eq=False)
class Body:
    """A person of fifteen rigid segments.

    Attributes:
        subject: mass, height and sex.
        dimensions: where the joints lie.
        table: which table the inertial parameters come from.
        inertias: of the segments, in their order.
        masses_from: where masses of segments are from that are not the table's; empty for none.
    """

    subject: Subject
    dimensions: Dimensions
    table: str
    inertias: tuple[pin.Inertia, ...]
    masses_from: str = ""

    @property
    def offsets(self) -> Array:
        """Joints in their parents' frames, ``(15, 3)`` [m]."""
        return joint_offsets() @ self.dimensions.values

    def with_table(self, table: Anthropometry) -> Body:
        """The same body with inertial parameters of another table."""
        return replace(self, table=table, inertias=body_inertias(self.subject, self.dimensions, table))

    @property
    def mass_origin(self) -> str:
        """Where inertial parameters are from."""
        return ", masses from ".join(filter(None, (self.table, self.masses_from)))

    def with_masses(self, masses: Mapping[str, float], source: str = "") -> Body:
        """The body with nominal masses [kg] of some segments from elsewhere; the others share the rest as they did.

        Raises:
            UnknownNameError: no such segment.
            InputError: a mass that is not positive, or masses that leave nothing for the others.
        """
        for name, mass in masses.items():
            if name not in NAMES:
                raise UnknownNameError("segment", name, list(NAMES))
            if not mass > 0.0:
                raise InputError(
                    f"is {mass:g} kg", field=name, remedy="give what is left of it, 0.1 for a stump"
                )
        own = np.array([inertia.mass for inertia in self.inertias])
        stated = np.array([name in masses for name in NAMES])
        rest = self.subject.mass - sum(masses.values())
        if rest <= 0.0 and not stated.all():
            raise InputError(
                f"stated masses add up to {sum(masses.values()):g} kg of {self.subject.mass:g}",
                field=", ".join(masses),
                remedy="give masses in kilograms",
            )
        shared = own * rest / max(float(own[~stated].sum()), 1e-9)
        wanted = [masses.get(name, float(shared[k])) for k, name in enumerate(NAMES)]
        inertias = [
            pin.Inertia(mass, b.lever, b.inertia * mass / b.mass)
            for b, mass in zip(self.inertias, wanted, strict=True)
        ]
        return replace(self, inertias=tuple(inertias), masses_from=source or self.masses_from)


def body_of(subject: Subject, dimensions: Dimensions | None = None, table: Anthropometry = "de_leva") -> Body:
    """A person's body; dimensions in proportion to stature where none were measured."""
    dimensions = stature_dimensions(subject) if dimensions is None else dimensions
    return Body(subject, dimensions, table, body_inertias(subject, dimensions, table))


def segment_box(body: Body, index: int) -> Array:
    """Lower and upper corner of a box about a segment in its frame, ``(2, 3)`` [m].

    Along the segment it ends at the joints, across it is as wide as its mass asks for.
    """
    segment, d = SEGMENTS[index], body.dimensions
    hips, shoulders = d["hip_half_width"] + 0.08, d["shoulder_half_width"]
    boxes = {
        "pelvis": [[-0.15, -hips, -0.09], [0.12, hips, max(d["lumbar_z"], 0.05) + 0.10]],
        "torso": [[-0.15, -shoulders, -0.02], [0.13, shoulders, d["neck_z"] + 0.02]],
        "head": [[-0.11, -0.08, -0.03], [0.11, 0.08, d.head]],
        "foot": [[-d.heel, -0.05, -d.ankle_height], [d.foot_length - d.heel, 0.05, 0.02]],
        "hand": [[-0.04, -0.05, -2.2 * d.hand], [0.04, 0.05, 0.01]],
    }
    if segment.kind in boxes:
        return np.array(boxes[segment.kind])
    length = d[f"{segment.side}_{segment.kind}"]
    # Density of the whole body [kg/m³] (Winter 2009, section 4.1.2), for the shapes that are drawn.
    half = float(np.sqrt(body.inertias[index].mass / (1050.0 * np.pi * length)))
    return np.array([[-half, -half, -length], [half, half, 0.0]])
