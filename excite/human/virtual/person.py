"""A virtual person: segments that differ from the tables as people's do, markers that ride on soft tissue.

Soft tissue moves by 2-12 mm by segment (Leardini et al. 2005, Camomilla et al. 2017).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.human.body import Body, body_of
from excite.human.inertials import BodyInertia
from excite.human.markers.landmarks import landmark_place
from excite.human.markers.marker_set import read_marker_set
from excite.human.posture.joint_angles import frame_turn
from excite.human.segments import NAMES, SEGMENTS
from excite.human.subject import Subject
from excite.human.urdf import urdf_text

MARKERS = "jovic"
"""The marker set that a virtual person wears."""
SOFT_TISSUE_M = {
    "pelvis": 0.006,
    "torso": 0.006,
    "head": 0.002,
    "upper_arm": 0.007,
    "forearm": 0.005,
    "hand": 0.003,
    "thigh": 0.012,
    "shank": 0.007,
    "foot": 0.003,
}
# The subject of Jovic et al., T-RO 2016, section VIII.
_SUBJECT = Subject(70.0, 1.82, "male")


@dataclass(frozen=True)
class Belt:
    """A weight worn on a segment: mass [kg] and place in the segment's frame [m]."""

    segment: str
    mass: float
    place: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class VirtualSubject:
    """A person whose every number is known.

    Attributes:
        body: true dimensions and inertial parameters.
        local: true places of the markers by label, segment frames [m].
        wobble: by label: direction-by-angle coefficients of the soft tissue ``(3, 4)`` [m].
    """

    body: Body
    local: dict[str, Array]
    wobble: dict[str, Array]


def draw_subject(
    rng: np.random.Generator, subject: Subject = _SUBJECT, *, spread: float = 0.12
) -> VirtualSubject:
    """A person whose masses, centres, lengths and marker places differ from the tables' by chance.

    Args:
        rng: source of what is drawn.
        subject: mass, height and sex, which are as stated.
        spread: standard deviation of a segment's mass, as a share of the table's.
    """
    body = body_of(subject)
    values = body.dimensions.values * (1.0 + 0.03 * rng.standard_normal(16))
    values[12:16] = values[8:12] * (1.0 + 0.005 * rng.standard_normal(4))
    dimensions = replace(body.dimensions, values=values)
    body = body_of(subject, dimensions)
    masses = np.array([b.mass for b in body.inertias]) * (1.0 + spread * rng.standard_normal(15))
    masses[9:] = masses[3:9] * (1.0 + 0.03 * rng.standard_normal(6))
    masses *= subject.mass / masses.sum()
    inertias = []
    for b, mass in zip(body.inertias, masses, strict=True):
        center = b.center * (1.0 + 0.05 * rng.standard_normal()) + 0.005 * rng.standard_normal(3)
        inertias.append(BodyInertia(mass, center, b.inertia * mass / b.mass))
    body = replace(body, inertias=tuple(inertias))
    sites = read_marker_set(MARKERS).sites
    local, wobble = {}, {}
    for label, site in sites.items():
        if site.landmark is None:
            continue
        place_ = landmark_place(site.landmark, subject, dimensions)
        local[label] = place_ + 0.008 * rng.standard_normal(3)
        size = SOFT_TISSUE_M[SEGMENTS[NAMES.index(site.segment)].kind]
        wobble[label] = size * rng.standard_normal((3, 4)) / 2.0
    return VirtualSubject(body, local, wobble)


def true_model(body: Body, belt: Belt | None = None) -> pin.Model:
    """Pinocchio model of a body, with a belt as a point mass on its segment."""
    model = pin.buildModelFromXML(urdf_text(body), pin.JointModelFreeFlyer())
    if belt is not None:
        k = NAMES.index(belt.segment)
        frame = model.getFrameId(belt.segment)
        joint = model.frames[frame].parentJoint
        place_ = model.frames[frame].placement.act(frame_turn(k) @ np.array(belt.place))
        model.inertias[joint] = model.inertias[joint] + pin.Inertia(belt.mass, place_, np.zeros((3, 3)))
    return model
