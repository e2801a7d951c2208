"""Where the joints of a person lie: sixteen lengths, from stature or calibrated from markers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.human.segments import NAMES, SIDES
from excite.human.subject import Subject
from excite.human.tables import dumas

DIMENSIONS: tuple[str, ...] = (
    "hip_half_width",
    "lumbar_x",
    "lumbar_z",
    "neck_x",
    "neck_z",
    "shoulder_x",
    "shoulder_half_width",
    "shoulder_z",
    *(f"{side}_{part}" for side in SIDES for part in ("upper_arm", "forearm", "thigh", "shank")),
)
# Shoulder from the cervical joint, forward, sideways and down, of Dumas' mean man [m].
_SHOULDER = (0.021, 0.209, 0.073)
# Spreads between people of one stature: of limbs (Winter 2009, table 3.1 scatters by 3-5 %), of the trunk's joints.
_LIMB_SPREAD, _TRUNK_SPREAD = 0.05, 0.015
_HAND = 0.08
_FOOT_LENGTH = 0.152
_HEEL = 0.19


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
    sex = subject.sex
    scale = subject.height / dumas.STATURE[sex]
    table, pelvis = dumas.TABLE[sex], dumas.PELVIS[sex]

    def length(kind: str) -> float:
        return 1e-3 * table[kind].length * scale

    width = 1e-3 * pelvis.width * scale
    trunk = table["torso"].length / dumas.TABLE["male"]["torso"].length * scale
    torso = length("torso")
    limbs = [length(part) for part in ("upper_arm", "forearm", "thigh", "shank")]
    values = np.array(
        [
            pelvis.hip[2] / 100.0 * width,
            (pelvis.lumbar[0] - pelvis.hip[0]) / 100.0 * width,
            (pelvis.lumbar[1] - pelvis.hip[1]) / 100.0 * width,
            0.0,
            torso,
            _SHOULDER[0] * trunk,
            _SHOULDER[1] * trunk,
            torso - _SHOULDER[2] * trunk,
            *limbs,
            *limbs,
        ]
    )
    spread = np.concatenate([np.full(8, _TRUNK_SPREAD * scale), _LIMB_SPREAD * values[8:]])
    foot_length = _FOOT_LENGTH * subject.height
    return Dimensions(
        values=values,
        spread=spread,
        head=length("head"),
        hand=length("hand"),
        foot=length("foot"),
        foot_length=foot_length,
        heel=_HEEL * foot_length,
        ankle_height=0.039 * subject.height,
    )


def joint_offsets() -> Array:
    """``(15, 3, 16)``: position of each segment's joint in its parent's frame per unit of each dimension."""
    matrix = np.zeros((len(NAMES), 3, len(DIMENSIONS)))

    def put(segment: str, axis: int, dimension: str, sign: float = 1.0) -> None:
        matrix[NAMES.index(segment), axis, DIMENSIONS.index(dimension)] = sign

    for segment, dimension in (("torso", "lumbar"), ("head", "neck")):
        put(segment, 0, f"{dimension}_x")
        put(segment, 2, f"{dimension}_z")
    for side in SIDES:
        outward = -1.0 if side == "right" else 1.0
        put(f"{side}_thigh", 1, "hip_half_width", outward)
        put(f"{side}_upper_arm", 0, "shoulder_x")
        put(f"{side}_upper_arm", 1, "shoulder_half_width", outward)
        put(f"{side}_upper_arm", 2, "shoulder_z")
        for child, carrier in (
            ("forearm", "upper_arm"),
            ("hand", "forearm"),
            ("shank", "thigh"),
            ("foot", "shank"),
        ):
            put(f"{side}_{child}", 2, f"{side}_{carrier}", -1.0)
    return matrix
