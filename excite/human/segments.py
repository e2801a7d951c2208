"""The fifteen segments and fourteen joints of the body (Jovic et al., T-RO 2016, section V): 34 degrees of freedom.

Every segment's frame sits in the joint that carries it (the pelvis' midway between the hips) with x forward,
y to the left and z up while the subject stands with hanging arms and palms forward.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import Literal

from excite.errors import InputError
from excite.results import ADDED, Positive, Stated

SIDES = ("right", "left")
RIGHT, LEFT = SIDES


@dataclass(frozen=True)
class Axis:
    """One angle of a joint: its name's ending, the coordinate axis (0 x, 1 y, 2 z) and the sign of the turn."""

    name: str
    index: int
    sign: float


@dataclass(frozen=True)
class Segment:
    """A segment and the joint that carries it.

    Attributes:
        name: name of the segment and of its link.
        parent: carrying segment, None for the pelvis.
        joint: name of the joint, None for the pelvis.
        axes: its angles, from the parent outwards; three for a spherical joint, one for a revolute one.
        side: ``right``, ``left`` or None.
        kind: name without side, as the tables of inertial parameters have it.
    """

    name: str
    parent: str | None
    joint: str | None
    axes: tuple[Axis, ...]
    side: str | None
    kind: str


def _limb_segments(side: str) -> tuple[Segment, ...]:
    """Arm and leg of a side; angles have the same sense on both (adduction towards the midline, inward turns)."""
    inward = 1.0 if side == RIGHT else -1.0
    hip = (Axis("flexion", 1, -1.0), Axis("adduction", 0, inward), Axis("rotation", 2, inward))
    # The turn about the long axis in the middle keeps the singular posture (90°) out of a shoulder's range,
    # whatever way the arm points; at the wrist pronation comes first.
    shoulder = (Axis("flexion", 1, -1.0), Axis("rotation", 2, inward), Axis("adduction", 0, inward))
    wrist = (Axis("pronation", 2, inward), Axis("deviation", 0, inward), Axis("flexion", 1, -1.0))

    def part(kind: str, parent: str, joint: str, axes: tuple[Axis, ...]) -> Segment:
        carrier = parent if parent in ("torso", "pelvis") else f"{side}_{parent}"
        return Segment(f"{side}_{kind}", carrier, f"{side}_{joint}", axes, side, kind)

    return (
        part("upper_arm", "torso", "shoulder", shoulder),
        part("forearm", "upper_arm", "elbow", (Axis("flexion", 1, -1.0),)),
        part("hand", "forearm", "wrist", wrist),
        part("thigh", "pelvis", "hip", hip),
        part("shank", "thigh", "knee", (Axis("flexion", 1, 1.0),)),
        part("foot", "shank", "ankle", hip),
    )


_SPINE = (Axis("flexion", 1, 1.0), Axis("bending", 0, 1.0), Axis("rotation", 2, 1.0))

SEGMENTS: tuple[Segment, ...] = (
    Segment("pelvis", None, None, (), None, "pelvis"),
    Segment("torso", "pelvis", "lumbar", _SPINE, None, "torso"),
    Segment("head", "torso", "neck", _SPINE, None, "head"),
    *_limb_segments(RIGHT),
    *_limb_segments(LEFT),
)
NAMES: tuple[str, ...] = tuple(segment.name for segment in SEGMENTS)
PARENTS: tuple[int, ...] = tuple(-1 if s.parent is None else NAMES.index(s.parent) for s in SEGMENTS)
PAIRS: tuple[tuple[str, str], ...] = tuple((s.name, f"left_{s.kind}") for s in SEGMENTS if s.side == RIGHT)
JOINT_NAMES: tuple[str, ...] = tuple(
    f"{s.joint}" if len(s.axes) == 1 else f"{s.joint}_{axis.name}" for s in SEGMENTS for axis in s.axes
)
"""The 34 angles, in order of the segments."""


def segment_ancestors(index: int) -> tuple[int, ...]:
    """Indices of a segment and of all that carry it, up to the pelvis."""
    chain = [index]
    while PARENTS[chain[-1]] >= 0:
        chain.append(PARENTS[chain[-1]])
    return tuple(chain)


# Who is measured: mass, height, sex.

Sex = Literal["male", "female"]
_SEXES = ("male", "female")
_MASS, _HEIGHT = (5.0, 400.0), (0.5, 2.6)


@dataclass(frozen=True)
class Subject(Stated):
    """A person.

    Attributes:
        mass: body mass with all that is worn [kg].
        height: stature [m].
        sex: which column of the tables is taken.
    """

    mass: Positive
    height: Positive = field(metadata=ADDED)
    sex: Sex = field(metadata=ADDED)

    def __post_init__(self) -> None:
        """Refuse numbers that no person has.

        Raises:
            InputError: names the number, and the unit that it looks like.
        """
        if not (isfinite(self.mass) and _MASS[0] <= self.mass <= _MASS[1]):
            raise InputError(
                f"is {self.mass} kg", source="subject", field="mass", remedy="give it in kilograms"
            )
        if not (isfinite(self.height) and _HEIGHT[0] <= self.height <= _HEIGHT[1]):
            centimetres = isfinite(self.height) and _HEIGHT[0] <= self.height / 100.0 <= _HEIGHT[1]
            remedy = "these look like centimetres, give metres" if centimetres else "give it in metres"
            raise InputError(f"is {self.height} m", source="subject", field="height", remedy=remedy)
        if self.sex not in _SEXES:
            raise InputError(f"is {self.sex!r}", source="subject", field="sex", remedy="give male or female")
