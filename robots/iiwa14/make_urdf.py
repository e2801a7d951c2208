"""Write ``iiwa14.urdf``: KUKA LBR iiwa 14 R820 from published tables.

Run ``python robots/iiwa14/make_urdf.py`` after changing a number here; a test compares file and script.

Source of all tables: Xu, Fan, Chen, Ng, Ang, Fang, Zhu, Zhao, "Dynamic identification of the KUKA LBR
iiwa robot with retrieval of physical parameters using global optimization", IEEE Access 8, 2020.

* Kinematics: Table 2, modified Denavit-Hartenberg. Frame 0 lies where axes 1 and 2 cross, so the robot's
  foot is 0.36 m below it (maker's drawing of the iiwa 14 R820).
* Mass, CoM (Table 6) and moments about the CoM in link axes (Table 7): the column of their reference
  [37], whose robot carried no payload.
* Limits: speed and torque of each axis from the maker's brochure "Sensitive robotics: LBR iiwa", page 30
  (as quoted in the README of Drake's iiwa_description); ranges as in the maker's data.

The tables print four decimals, and some moments so rounded break the triangle inequality by a
unit or two of the last one; the smallest change (of the second moments ½tr(I)1 − I) that
restores it is applied, and the URDF says by how much.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

# Table 2: d [m], a [m], alpha [rad] of joints 1 … 7.
D = (0.0, 0.0, 0.42, 0.0, 0.40, 0.0, 0.0)
A = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
ALPHA = (0.0, math.pi / 2, -math.pi / 2, -math.pi / 2, math.pi / 2, math.pi / 2, -math.pi / 2)

# Table 6, column of [37]: mass [kg] and CoM [m] in the link frame.
MASS = (3.9478, 4.5028, 2.4552, 2.6116, 3.4100, 3.3880, 0.3543)
COM = (
    (-0.0035, 0.0016, -0.0314),
    (-0.0077, 0.1667, -0.0036),
    (-0.0023, -0.0349, -0.0265),
    (0.0002, -0.0527, 0.0382),
    (5.0e-05, -0.0024, -0.2113),
    (0.0005, 0.0202, -0.0275),
    (-0.0347, -0.0232, 0.0714),
)

# Table 7, column of [37]: Ixx, Ixy, Ixz, Iyy, Iyz, Izz [kg·m²] about the CoM.
MOMENTS = (
    (0.0046, 0.0, 0.0, 0.0045, 1.0e-05, 2.9e-04),
    (0.0003, 0.0, 0.0, 1.0e-04, 0.0, 0.0004),
    (0.0022, -5.0e-05, 7.0e-05, 0.0022, 7.0e-05, 7.3e-04),
    (0.0384, 8.8e-04, -0.0011, 0.0114, -0.0011, 0.0499),
    (0.0028, -1.0e-05, 1.0e-05, 0.0028, 0.0, 1.2e-04),
    (5.0e-04, -5.0e-05, -3.0e-05, 0.0028, -4.0e-05, 0.0023),
    (0.0080, 2.2e-04, -2.9e-04, 0.0109, -2.9e-04, 0.0029),
)

# The maker's: half range [deg], speed [deg/s], torque [N·m].
RANGE = (170, 120, 170, 120, 170, 120, 175)
SPEED = (85, 85, 100, 75, 130, 135, 135)
TORQUE = (320, 320, 176, 176, 110, 40, 40)

# Least second moment kept, as a share of the trace, where rounding left less [-].
LEAST = 1.0e-4


def consistent(moments: tuple[float, ...]) -> np.ndarray:
    """Moments ``(3, 3)`` nearest to the table's whose second moments ½tr(I)1 − I are positive definite."""
    xx, xy, xz, yy, yz, zz = moments
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    values, vectors = np.linalg.eigh(second)
    if values[0] < LEAST * values.sum():
        values = np.maximum(values, LEAST * values.sum())
        second = vectors @ np.diag(values) @ vectors.T
        return np.trace(second) * np.eye(3) - second
    return inertia


def urdf() -> str:
    """The whole file's text."""
    lines = [
        '<?xml version="1.0"?>',
        "<!-- KUKA LBR iiwa 14 R820, written by make_urdf.py, where every number has its source. -->",
        "<!-- Origin where axes 1 and 2 cross, 0.36 m above the foot; collision shapes: robot.yaml. -->",
        '<robot name="iiwa14">',
        '  <link name="base"/>',
    ]
    for i in range(7):
        inertia = consistent(MOMENTS[i])
        change = np.abs(inertia - printed(i)).max()
        note = f"; moments moved by at most {change:.1e} for the triangle inequality" if change > 0 else ""
        xyz = (A[i], -math.sin(ALPHA[i]) * D[i], math.cos(ALPHA[i]) * D[i])
        lines += [
            f"  <!-- joint {i + 1}: Table 2, limits of the maker -->",
            f'  <joint name="joint{i + 1}" type="revolute">',
            f'    <parent link="{"base" if i == 0 else f"link{i}"}"/>',
            f'    <child link="link{i + 1}"/>',
            f'    <origin xyz="{_row(xyz)}" rpy="{ALPHA[i]!r} 0 0"/>',
            '    <axis xyz="0 0 1"/>',
            f'    <limit lower="{-math.radians(RANGE[i])!r}" upper="{math.radians(RANGE[i])!r}"'
            f' velocity="{math.radians(SPEED[i])!r}" effort="{TORQUE[i]}"/>',
            "  </joint>",
            f"  <!-- link {i + 1}: Tables 6 and 7, column of [37]{note} -->",
            f'  <link name="link{i + 1}">',
            "    <inertial>",
            f'      <mass value="{MASS[i]!r}"/>',
            f'      <origin xyz="{_row(COM[i])}" rpy="0 0 0"/>',
            f'      <inertia ixx="{_number(inertia[0, 0])}" ixy="{_number(inertia[0, 1])}"'
            f' ixz="{_number(inertia[0, 2])}" iyy="{_number(inertia[1, 1])}"'
            f' iyz="{_number(inertia[1, 2])}" izz="{_number(inertia[2, 2])}"/>',
            "    </inertial>",
            "  </link>",
        ]
    return "\n".join([*lines, "</robot>", ""])


def printed(link: int) -> np.ndarray:
    """Moments of a link as the table prints them, ``(3, 3)``; ``link`` counts from 0."""
    xx, xy, xz, yy, yz, zz = MOMENTS[link]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _row(values: tuple[float, ...]) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    return f"{round(float(value), 8) + 0.0:.10g}"


if __name__ == "__main__":
    Path(__file__).with_name("iiwa14.urdf").write_text(urdf(), encoding="utf-8")
