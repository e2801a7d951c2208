"""Write ``jaco2.urdf``: Kinova Jaco², seven joints, spherical wrist, from published tables.

Run ``python robots/jaco2/make_urdf.py`` after changing a number here; a test compares file and script.

* Kinematics: Golluccio, Gillini, Marino, Antonelli, "Robot dynamics identification: a reproducible
  comparison with experiments on the Kinova Jaco²", IEEE Robotics and Automation Magazine 27(3), 2020,
  Table 1 (Denavit-Hartenberg, joint i between frames i-1 and i).
* Frames: link i has the axes of the table's frame i and its origin on the axis of joint i, where frame
  i-1 lies, since these are the frames in which Table 3 of the article holds (in frame 7 of Table 1 itself
  d7 would occur in its β17; it does not). Parameters read from the URDF are therefore the article's.
* Masses, centres of mass and moments of links 1 to 6: Kinova's published URDF of the j2s7s300
  (kinova-ros, BSD licence), whose links are tubes along the arm.
* Link 7 with gripper: 0.727 kg. This is what the CAD column of the article's Table 4 implies: its β5
  gives m5 + m6 + m7 = 1.653 kg, Kinova's files give m5 = m6 = 0.463 kg. (kinova-ros has 0.99 kg without
  fingers.) Centre of mass and moments as in Kinova's URDF, moments in proportion to the mass.
* Limits: Kinova's user guide of the Jaco² 7 DoF as in its URDF: ranges of joints 2, 4 and 6, speeds of
  36 and 48 degrees a second, torques of 40, 80 and 20 N·m. Joints 1, 3, 5 and 7 turn without end; a range
  of one turn is chosen here.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

# Table 1: a [m] is 0 throughout; alpha [rad] and d [m] of joints 1 … 7.
ALPHA = (math.pi / 2,) * 6 + (0.0,)
D = (0.2755, 0.0, -0.41, -0.0098, -0.3111, 0.0, 0.2638)

# Joint positions at which the arm points straight up [rad].
UPRIGHT = (0.0, 0.0, 0.0, math.pi, 0.0, 0.0, 0.0)

MASS = (0.7477, 0.8447, 0.8447, 0.6763, 0.4630, 0.4630, 0.7270)
# Centre of mass of the upright arm's links: height above the link frame's origin, and distance from the
# vertical through it, counted along the offset d4 of the wrist [m].
HEIGHT = (0.21725, 0.10356, 0.30724, 0.08100, 0.26149, 0.04972, 0.16375)
ASIDE = (0.0020, 0.0, 0.0, 0.0086, 0.0029, -0.0029, 0.0)
# Moments about the centre of mass, across and along the arm [kg·m²].
ACROSS = (1.5203e-3, 2.4707e-3, 2.4707e-3, 1.4202e-3, 4.3213e-4, 4.3213e-4, 2.5359e-4)
ALONG = (5.9816e-4, 3.8012e-4, 3.8012e-4, 3.0434e-4, 9.26e-5, 9.26e-5, 4.2709e-4)

# Lower and upper limits [deg], speed [deg/s], torque [N·m].
RANGE = ((-180, 180), (-133, 133), (-180, 180), (30, 330), (-180, 180), (-115, 115), (-180, 180))
SPEED = (36, 36, 36, 36, 48, 48, 48)
TORQUE = (40, 80, 40, 40, 20, 20, 20)


def turn_x(angle: float) -> np.ndarray:
    """Rotation about x, exact where the angle is a multiple of a right angle, ``(3, 3)``."""
    c, s = (round(value, 15) + 0.0 for value in (math.cos(angle), math.sin(angle)))
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def turn_z(angle: float) -> np.ndarray:
    """Rotation about z, ``(3, 3)``."""
    c, s = (round(value, 15) + 0.0 for value in (math.cos(angle), math.sin(angle)))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def axis(joint: int) -> np.ndarray:
    """Axis of a joint in the frame of its link, ``(3,)``; ``joint`` counts from 0."""
    return turn_x(ALPHA[joint]).T @ np.array([0.0, 0.0, 1.0])


def origin(joint: int) -> np.ndarray:
    """Origin of a link's frame in the frame of the link before it, ``(3,)`` [m]."""
    return np.zeros(3) if joint == 0 else D[joint - 1] * axis(joint - 1)


def link_inertia(link: int) -> tuple[np.ndarray, np.ndarray]:
    """Centre of mass ``(3,)`` [m] and moments about it ``(3, 3)`` [kg·m²] in the link's frame."""
    rotation, offset = np.eye(3), np.zeros(3)
    for joint in range(7):
        rotation = rotation @ turn_z(UPRIGHT[joint])
        if joint == 3:
            offset = D[3] * rotation[:, 2]
        if joint <= link:
            frame = rotation @ turn_x(ALPHA[joint])
        rotation = rotation @ turn_x(ALPHA[joint])
    centre = HEIGHT[link] * np.array([0.0, 0.0, 1.0]) + ASIDE[link] * offset / np.linalg.norm(offset)
    moments = np.diag([ACROSS[link], ACROSS[link], ALONG[link]])
    return frame.T @ centre, frame.T @ moments @ frame


def urdf() -> str:
    """The whole file's text."""
    lines = [
        '<?xml version="1.0"?>',
        "<!-- Kinova Jaco2 7 DoF, written by make_urdf.py, where every number has its source. -->",
        "<!-- Origin on the table below the first axis; collision shapes: robot.yaml. -->",
        '<robot name="jaco2">',
        '  <link name="base"/>',
    ]
    for i in range(7):
        centre, moments = link_inertia(i)
        lines += [
            f'  <joint name="joint{i + 1}" type="revolute">',
            f'    <parent link="{"base" if i == 0 else f"link{i}"}"/>',
            f'    <child link="link{i + 1}"/>',
            f'    <origin xyz="{_row(origin(i))}" rpy="{ALPHA[i]!r} 0 0"/>',
            f'    <axis xyz="{_row(axis(i))}"/>',
            f'    <limit lower="{math.radians(RANGE[i][0])!r}" upper="{math.radians(RANGE[i][1])!r}"'
            f' velocity="{math.radians(SPEED[i])!r}" effort="{TORQUE[i]}"/>',
            "  </joint>",
            f'  <link name="link{i + 1}">',
            "    <inertial>",
            f'      <mass value="{MASS[i]!r}"/>',
            f'      <origin xyz="{_row(centre)}" rpy="0 0 0"/>',
            f'      <inertia ixx="{_number(moments[0, 0])}" ixy="{_number(moments[0, 1])}"'
            f' ixz="{_number(moments[0, 2])}" iyy="{_number(moments[1, 1])}"'
            f' iyz="{_number(moments[1, 2])}" izz="{_number(moments[2, 2])}"/>',
            "    </inertial>",
            "  </link>",
        ]
    return "\n".join([*lines, "</robot>", ""])


def _row(values: np.ndarray) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    return f"{round(float(value), 9) + 0.0:.10g}"


if __name__ == "__main__":
    Path(__file__).with_name("jaco2.urdf").write_text(urdf(), encoding="utf-8")
