"""Write ``hrp2like.urdf``: a humanoid with the arrangement, size and mass of HRP-2.

Run ``python robots/hrp2like/make_urdf.py`` after changing a number here, and put the collision shapes that it
prints into ``robot.yaml``; a test compares both files and the script.

HRP-2's own CAD data are not public. What is taken from publications is marked so; every other number is
chosen here, of the order that published humanoids of this size have.

* 1.54 m, 58 kg, 31 segments, 30 joints: 6 in each leg, 7 in each arm, 2 in the waist, 2 in the neck; base
  link in the trunk (Jovic et al. 2016, IEEE T-RO 32(3), section IV). Segment numbers as in its Table II and
  in Figure 2c of Jovic et al. 2015 (IROS): trunk 1-3, right and left leg 4-15, head 16-17, arms 18-31.
* Ranges of the joints in degrees: Kaneko et al., "Humanoid robot HRP-2", ICRA 2004, rounded; the seventh
  joint of the arm, which was added later, is chosen here.
* Order of the joints (hip: yaw, roll, pitch; ankle: pitch, roll; arm: shoulder pitch, roll, yaw, elbow,
  wrist yaw, pitch, roll; waist: yaw, pitch): the published kinematic structure.
* Lengths: thigh and shank 0.30 m, ankle 0.105 m high, upper arm and forearm 0.25 m, chosen here.
* Masses: chosen here to sum to 58 kg. Every segment is a homogeneous solid of the size given, so its
  moments follow from its mass.

All frames are parallel to the base's when every joint is at zero: x ahead, y left, z up. The base frame lies
on the waist's pitch axis.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Part:
    """A joint, the segment behind it and the solid that the segment is.

    Attributes:
        name: of the joint; the segment's link is ``NAME_link``.
        parent: name of the part before, "chest" for the base.
        number: of the segment in the papers.
        origin: of the joint in the parent's frame [m].
        axis: of the joint.
        limits: lower and upper [deg], speed [rad/s], torque [N·m].
        mass: of the segment [kg].
        solid: "box" (x, y, z), "capsule" (radius, length between the caps' centres, along z) or "sphere".
        size: of the solid [m].
        centre: of the solid and of the mass, in the segment's frame [m].
    """

    name: str
    parent: str
    number: int
    origin: tuple[float, float, float]
    axis: tuple[int, int, int]
    limits: tuple[float, float, float, float]
    mass: float
    solid: str
    size: tuple[float, ...]
    centre: tuple[float, float, float]


X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
ROOT = Part("chest", "", 1, (0, 0, 0), Z, (0, 0, 0, 0), 14.2, "box", (0.22, 0.30, 0.26), (-0.03, 0, 0.17))


def leg(side: str, first: int) -> list[Part]:
    """The six joints of a leg, whose first segment has the given number."""
    left = side == "l"
    y = 0.095 if left else -0.095
    turn = (-30, 45) if left else (-45, 30)
    roll = (-20, 35) if left else (-35, 20)
    tilt = (-35, 20) if left else (-20, 35)
    rows = (
        ("hip_yaw", (0, y, -0.10), Z, (*turn, 4.0, 120), 0.9, "sphere", (0.055,), (0, 0, 0.01)),
        ("hip_roll", (0, 0, 0), X, (*roll, 4.0, 180), 1.2, "sphere", (0.055,), (-0.01, 0, 0)),
        ("hip_pitch", (0, 0, 0), Y, (-125, 42, 4.0, 180), 4.0, "capsule", (0.058, 0.15), (0.01, 0, -0.16)),
        ("knee", (0, 0, -0.30), Y, (0, 150, 5.0, 220), 2.6, "capsule", (0.050, 0.15), (0.01, 0, -0.14)),
        ("ankle_pitch", (0, 0, -0.30), Y, (-75, 42, 5.0, 150), 0.5, "sphere", (0.040,), (0, 0, 0)),
        ("ankle_roll", (0, 0, 0), X, (*tilt, 5.0, 110), 1.6, "box", (0.24, 0.14, 0.05), (0.02, 0, -0.08)),
    )
    return _chain(f"{side}leg", "chest_yaw", first, rows)


def arm(side: str, first: int) -> list[Part]:
    """The seven joints of an arm, whose first segment has the given number."""
    left = side == "l"
    y = 0.25 if left else -0.25
    out = (-10, 95) if left else (-95, 10)
    rows = (
        ("shoulder_pitch", (0, y, 0.20), Y, (-180, 60, 4.0, 70), 0.9, "sphere", (0.050,), (0, -0.2 * y, 0)),
        ("shoulder_roll", (0, 0, 0), X, (*out, 4.0, 70), 0.7, "sphere", (0.048,), (0, 0, -0.02)),
        ("shoulder_yaw", (0, 0, 0), Z, (-91, 91, 5.0, 50), 1.1, "capsule", (0.045, 0.10), (0, 0, -0.14)),
        ("elbow", (0, 0, -0.25), Y, (-135, 2, 5.0, 50), 1.0, "capsule", (0.040, 0.10), (0, 0, -0.09)),
        ("wrist_yaw", (0, 0, -0.25), Z, (-90, 90, 5.0, 20), 0.4, "sphere", (0.034,), (0, 0, 0.01)),
        ("wrist_pitch", (0, 0, 0), Y, (-90, 90, 5.0, 15), 0.3, "sphere", (0.032,), (0, 0, 0)),
        ("wrist_roll", (0, 0, 0), X, (-45, 45, 5.0, 15), 0.5, "capsule", (0.035, 0.06), (0.005, 0, -0.08)),
    )
    return _chain(f"{side}arm", "chest", first, rows)


def _chain(limb: str, parent: str, first: int, rows: tuple) -> list[Part]:
    parts = []
    for number, (joint, *rest) in enumerate(rows, start=first):
        parts.append(Part(f"{limb}_{joint}", parent, number, *rest))
        parent = parts[-1].name
    return parts


# The waist's angles are the chest's against the pelvis, hence the axes' signs.
PARTS = [
    Part(
        "chest_pitch",
        "chest",
        2,
        (0, 0, 0),
        (0, -1, 0),
        (-5, 60, 3.0, 200),
        1.2,
        "sphere",
        (0.06,),
        (0, 0, 0),
    ),
    Part(
        "chest_yaw",
        "chest_pitch",
        3,
        (0, 0, -0.20),
        (0, 0, -1),
        (-45, 45, 3.0, 200),
        8.4,
        "box",
        (0.18, 0.24, 0.14),
        (-0.02, 0, 0.04),
    ),
    *leg("r", 4),
    *leg("l", 10),
    Part("head_yaw", "chest", 16, (0, 0, 0.32), Z, (-45, 45, 4.0, 20), 0.4, "sphere", (0.035,), (0, 0, 0.02)),
    Part(
        "head_pitch",
        "head_yaw",
        17,
        (0, 0, 0),
        Y,
        (-30, 45, 4.0, 20),
        2.4,
        "sphere",
        (0.095,),
        (0.015, 0, 0.12),
    ),
    *arm("r", 18),
    *arm("l", 25),
]


def link_name(part: str) -> str:
    """Link of a part."""
    return part if part == ROOT.name else f"{part}_link"


def moments(part: Part) -> np.ndarray:
    """Principal moments of the part's solid about its centre, ``(3,)`` [kg·m²]."""
    m = part.mass
    if part.solid == "box":
        x, y, z = (edge**2 for edge in part.size)
        return m / 12.0 * np.array([y + z, x + z, x + y])
    if part.solid == "sphere":
        return np.full(3, 0.4 * m * part.size[0] ** 2)
    r, h = part.size
    shaft, caps = math.pi * r**2 * h, 4.0 / 3.0 * math.pi * r**3
    tube, ball = m * shaft / (shaft + caps), m * caps / (shaft + caps)
    along = 0.5 * tube * r**2 + 0.4 * ball * r**2
    across = tube * (r**2 / 4 + h**2 / 12) + ball * (0.4 * r**2 + h**2 / 4 + 0.375 * h * r)
    return np.array([across, across, along])


def urdf() -> str:
    """The whole file's text."""
    lines = [
        '<?xml version="1.0"?>',
        "<!-- Humanoid with HRP-2's arrangement, written by make_urdf.py, where every number has its source. -->",
        '<robot name="hrp2like">',
        *_link(ROOT),
    ]
    for part in PARTS:
        low, high, speed, torque = part.limits
        lines += [
            f'  <joint name="{part.name}" type="revolute">',
            f'    <parent link="{link_name(part.parent)}"/>',
            f'    <child link="{link_name(part.name)}"/>',
            f'    <origin xyz="{_row(part.origin)}" rpy="0 0 0"/>',
            f'    <axis xyz="{_row(part.axis)}"/>',
            f'    <limit lower="{_number(math.radians(low))}" upper="{_number(math.radians(high))}"'
            f' velocity="{_number(speed)}" effort="{_number(torque)}"/>',
            "  </joint>",
            *_link(part),
        ]
    return "\n".join([*lines, "</robot>", ""])


def shapes() -> list[str]:
    """The solids as entries of ``collision.shapes`` in ``robot.yaml``."""
    entries = []
    for part in (ROOT, *PARTS):
        size, xyz = (", ".join(_number(value) for value in values) for values in (part.size, part.centre))
        entries.append(f"{{link: {link_name(part.name)}, kind: {part.solid}, size: [{size}], xyz: [{xyz}]}}")
    return entries


def _link(part: Part) -> list[str]:
    xx, yy, zz = moments(part)
    return [
        f"  <!-- segment {part.number} -->",
        f'  <link name="{link_name(part.name)}">',
        "    <inertial>",
        f'      <mass value="{_number(part.mass)}"/>',
        f'      <origin xyz="{_row(part.centre)}" rpy="0 0 0"/>',
        f'      <inertia ixx="{_number(xx)}" ixy="0" ixz="0" iyy="{_number(yy)}" iyz="0" izz="{_number(zz)}"/>',
        "    </inertial>",
        "  </link>",
    ]


def _row(values: tuple[float, ...]) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    return f"{round(float(value), 9) + 0.0:.10g}"


if __name__ == "__main__":
    Path(__file__).with_name("hrp2like.urdf").write_text(urdf(), encoding="utf-8")
    sys.stdout.write("".join(f"    - {entry}\n" for entry in shapes()))
