"""Where bony landmarks lie on the segments: first guesses, which calibration refines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.errors import UnknownNameError
from excite.human.dimensions import Dimensions, joint_offsets
from excite.human.segments import NAMES, SIDES
from excite.human.subject import Subject
from excite.human.tables import dumas

_STATURE = 1.77


@dataclass(frozen=True)
class Landmark:
    """A landmark of one side (of the right one, y counted outwards) or of the middle.

    Attributes:
        kind: segment without side.
        anchor: joint-carried segment without side from whose joint it is measured; None for the segment's own
            origin.
        place: x forward, y outward (to the left in the middle), z up from there, of a man of 1.77 m [m].
    """

    kind: str
    anchor: str | None
    place: tuple[float, float, float]


# Dumas et al. 2007 place the cervical joint from C7 and suprasternale (53 to 55 % of their distance, 8° to 14°
# above it) and the shoulder from the acromion; other places are of a mean man, good to two centimetres.
_SIDED: dict[str, Landmark] = {
    "asis": Landmark("pelvis", None, (0.021, 0.112, 0.083)),
    "psis": Landmark("pelvis", None, (-0.135, 0.045, 0.090)),
    "greater_trochanter": Landmark("thigh", None, (0.0, 0.075, -0.01)),
    "lateral_knee": Landmark("thigh", "shank", (0.0, 0.055, 0.0)),
    "medial_knee": Landmark("thigh", "shank", (0.0, -0.055, 0.0)),
    "fibula_head": Landmark("shank", None, (-0.01, 0.05, -0.05)),
    "lateral_ankle": Landmark("shank", "foot", (-0.005, 0.042, -0.005)),
    "medial_ankle": Landmark("shank", "foot", (0.005, -0.040, 0.005)),
    "heel": Landmark("foot", None, (-0.060, 0.0, -0.040)),
    "first_metatarsal": Landmark("foot", None, (0.135, -0.045, -0.050)),
    "second_metatarsal": Landmark("foot", None, (0.140, -0.010, -0.040)),
    "fifth_metatarsal": Landmark("foot", None, (0.110, 0.055, -0.055)),
    "toe": Landmark("foot", None, (0.195, -0.010, -0.050)),
    "acromion": Landmark("torso", "upper_arm", (-0.010, -0.005, 0.055)),
    "scapula": Landmark("torso", "upper_arm", (-0.120, -0.100, -0.060)),
    "lateral_elbow": Landmark("upper_arm", "forearm", (0.0, 0.040, 0.0)),
    "medial_elbow": Landmark("upper_arm", "forearm", (0.0, -0.040, 0.0)),
    # Pronation belongs to the wrist: both styloids turn with the hand.
    "radial_wrist": Landmark("hand", None, (0.0, 0.033, 0.0)),
    "ulnar_wrist": Landmark("hand", None, (0.0, -0.033, 0.0)),
    "second_metacarpal": Landmark("hand", None, (-0.015, 0.025, -0.085)),
    "fifth_metacarpal": Landmark("hand", None, (-0.015, -0.035, -0.075)),
    "temple": Landmark("head", None, (0.060, 0.075, 0.150)),
    "back_of_head": Landmark("head", None, (-0.090, 0.060, 0.150)),
}
_MIDDLE: dict[str, Landmark] = {
    "sacrum": Landmark("pelvis", None, (-0.140, 0.0, 0.090)),
    "c7": Landmark("torso", "head", (-0.076, 0.0, 0.025)),
    "t8": Landmark("torso", "head", (-0.110, 0.0, -0.170)),
    "t10": Landmark("torso", "head", (-0.100, 0.0, -0.240)),
    "suprasternale": Landmark("torso", "head", (0.052, 0.0, -0.043)),
    "xiphoid": Landmark("torso", "head", (0.090, 0.0, -0.200)),
    "vertex": Landmark("head", None, (0.0, 0.0, 0.244)),
    "parietal": Landmark("head", None, (-0.040, 0.0, 0.235)),
}
LANDMARKS: tuple[str, ...] = (
    *_MIDDLE,
    *(f"{side}_{name}" for side in SIDES for name in _SIDED),
)


def landmark_segment(name: str) -> str:
    """The segment that carries a landmark; raises UnknownNameError."""
    landmark, side = _find_landmark(name)
    return landmark.kind if side is None or landmark.kind in NAMES else f"{side}_{landmark.kind}"


def landmark_place(name: str, subject: Subject, dimensions: Dimensions) -> Array:
    """Where a landmark lies in its segment's frame, ``(3,)`` [m]; raises UnknownNameError."""
    landmark, side = _find_landmark(name)
    scale = subject.height / _STATURE
    x, y, z = landmark.place
    place = np.array([x, -y if side == "right" else y, z]) * scale
    if landmark.kind == "pelvis" and name.endswith("asis"):
        # Dumas' pelvis in units of the distance of the hips, which is what the dimensions hold.
        row = dumas.PELVIS[subject.sex]
        width = dimensions["hip_half_width"] / (row.hip[2] / 100.0)
        outward = -0.5 if side == "right" else 0.5
        place = width * np.array([-row.hip[0] / 100.0, outward, -row.hip[1] / 100.0])
    if landmark.anchor is not None:
        child = landmark.anchor if landmark.anchor in NAMES else f"{side}_{landmark.anchor}"
        place = place + joint_offsets()[NAMES.index(child)] @ dimensions.values
    return place


def _find_landmark(name: str) -> tuple[Landmark, str | None]:
    side, _, rest = name.partition("_")
    if side in SIDES and rest in _SIDED:
        return _SIDED[rest], side
    if name in _MIDDLE:
        return _MIDDLE[name], None
    raise UnknownNameError("landmark", name, list(LANDMARKS))
