"""A person's body: dimensions and inertial parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.errors import InputError, UnknownNameError
from excite.human.dimensions import Dimensions, joint_offsets, stature_dimensions
from excite.human.inertials import Anthropometry, BodyInertia, body_inertias
from excite.human.segments import NAMES, SEGMENTS
from excite.human.subject import Subject

# Density of the whole body [kg/m³] (Winter 2009, section 4.1.2), for the shapes that are drawn.
_DENSITY = 1050.0


@dataclass(frozen=True, eq=False)
class Body:
    """A person of fifteen rigid segments.

    Attributes:
        subject: mass, height and sex.
        dimensions: where the joints lie.
        table: which table the inertial parameters come from.
        inertias: of the segments, in their order.
    """

    subject: Subject
    dimensions: Dimensions
    table: str
    inertias: tuple[BodyInertia, ...]

    @property
    def offsets(self) -> Array:
        """Joints in their parents' frames, ``(15, 3)`` [m]."""
        return joint_offsets() @ self.dimensions.values

    def with_table(self, table: Anthropometry) -> Body:
        """The same body with inertial parameters of another table."""
        return replace(self, table=table, inertias=body_inertias(self.subject, self.dimensions, table))

    def with_masses(self, masses: Mapping[str, float]) -> Body:
        """The body with nominal masses [kg] of some segments by hand; the others share the rest as they did.

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
        if rest <= 0.0:
            raise InputError(
                f"stated masses add up to {sum(masses.values()):g} kg of {self.subject.mass:g}",
                field=", ".join(masses),
                remedy="give masses in kilograms",
            )
        shared = own * rest / max(float(own[~stated].sum()), 1e-9)
        wanted = [masses.get(name, float(shared[k])) for k, name in enumerate(NAMES)]
        inertias = [
            BodyInertia(mass, b.center, b.inertia * mass / b.mass)
            for b, mass in zip(self.inertias, wanted, strict=True)
        ]
        return replace(self, inertias=tuple(inertias))

    def wearing(self, segment: str, weight: BodyInertia) -> Body:
        """The body with a weight on a segment, in the segment's frame."""
        inertias = list(self.inertias)
        inertias[NAMES.index(segment)] = inertias[NAMES.index(segment)] + weight
        subject = replace(self.subject, mass=self.subject.mass + weight.mass)
        return replace(self, subject=subject, inertias=tuple(inertias))


def body_of(subject: Subject, dimensions: Dimensions | None = None, table: Anthropometry = "de_leva") -> Body:
    """A person's body; dimensions in proportion to stature where none were measured."""
    dimensions = stature_dimensions(subject) if dimensions is None else dimensions
    return Body(subject, dimensions, table, body_inertias(subject, dimensions, table))


def segment_box(body: Body, index: int) -> Array:
    """Lower and upper corner of a box about a segment in its frame, ``(2, 3)`` [m].

    Along the segment it ends at the joints, across it is as wide as its mass asks for.
    """
    segment, d = SEGMENTS[index], body.dimensions
    mass = body.inertias[index].mass
    if segment.kind == "pelvis":
        half = d["hip_half_width"] + 0.08
        return np.array([[-0.15, -half, -0.09], [0.12, half, max(d["lumbar_z"], 0.05) + 0.10]])
    if segment.kind == "torso":
        half = d["shoulder_half_width"]
        return np.array([[-0.15, -half, -0.02], [0.13, half, d["neck_z"] + 0.02]])
    if segment.kind == "head":
        return np.array([[-0.11, -0.08, -0.03], [0.11, 0.08, d.head]])
    if segment.kind == "foot":
        front = d.foot_length - d.heel
        return np.array([[-d.heel, -0.05, -d.ankle_height], [front, 0.05, 0.02]])
    if segment.kind == "hand":
        return np.array([[-0.04, -0.05, -2.2 * d.hand], [0.04, 0.05, 0.01]])
    length = d[f"{segment.side}_{segment.kind}"]
    half = float(np.sqrt(mass / (_DENSITY * np.pi * length)))
    return np.array([[-half, -half, -length], [half, half, 0.0]])
