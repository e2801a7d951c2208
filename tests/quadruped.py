"""A toy quadruped of boxes and balls, three joints a leg, and descriptions of it on its feet, hung up, or held."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from excite.robot.loading import load_robot
from excite.robot.robot import Robot

LEGS = {"FL": (0.2, 0.12), "FR": (0.2, -0.12), "RL": (-0.2, 0.12), "RR": (-0.2, -0.12)}
_THIGH, _SHANK, _BALL = 0.2, 0.2, 0.02


def _link(name: str, mass: float, size: tuple[float, float, float], z: float, shape: str) -> str:
    x, y, h = size
    inertia = [mass / 12.0 * (y * y + h * h), mass / 12.0 * (x * x + h * h), mass / 12.0 * (x * x + y * y)]
    return (
        f'<link name="{name}"><inertial><origin xyz="0.004 0.003 {z}"/><mass value="{mass}"/>'
        f'<inertia ixx="{inertia[0]}" iyy="{inertia[1]}" izz="{inertia[2]}" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<collision><origin xyz="0 0 {z}"/><geometry>{shape}</geometry></collision></link>'
    )


def _joint(name: str, parent: str, child: str, xyz: str, axis: str) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
        f'<axis xyz="{axis}"/><limit lower="-2.4" upper="2.4" effort="40" velocity="20"/></joint>'
    )


def quadruped_urdf() -> str:
    """The URDF: 9 kg, 0.4 m long, knees that bend backwards."""
    parts = [_link("trunk", 6.0, (0.4, 0.16, 0.1), 0.0, '<box size="0.4 0.16 0.1"/>')]
    for leg, (x, y) in LEGS.items():
        hip = f"{x} {y} 0"
        parts += [
            _link(f"{leg}_hip", 0.2, (0.05, 0.05, 0.05), 0.0, '<sphere radius="0.01"/>'),
            _link(f"{leg}_thigh", 0.4, (0.03, 0.03, 0.16), -0.1, '<box size="0.03 0.03 0.1"/>'),
            _link(f"{leg}_shank", 0.15, (0.02, 0.02, 0.16), -0.1, '<box size="0.02 0.02 0.1"/>'),
            _joint(f"{leg}_roll", "trunk", f"{leg}_hip", hip, "1 0 0"),
            _joint(f"{leg}_pitch", f"{leg}_hip", f"{leg}_thigh", "0 0 0", "0 1 0"),
            _joint(f"{leg}_knee", f"{leg}_thigh", f"{leg}_shank", f"0 0 {-_THIGH}", "0 1 0"),
        ]
    return f'<robot name="toy">{"".join(parts)}</robot>'


def quadruped_description(base: str = "floating") -> dict[str, Any]:
    """Contents of its ``robot.yaml``."""
    said = {"source": "toy"}
    joints = {}
    for leg in LEGS:
        joints |= {f"{leg}_pitch": 0.7, f"{leg}_knee": -1.4}
    # The ball's middle ends the shank, which leans backwards by 0.7 rad at rest.
    lowest = [-_BALL * 0.644217687, 0.0, -_SHANK - _BALL * 0.764842187]
    return {
        "schema": "excite.robot/1",
        "name": "toy",
        "title": "toy quadruped",
        "model": {"path": "toy.urdf", **said},
        "base": base,
        "posture": {"joints": joints, **said},
        "limits": {
            "position": {"margin": 0.02, **said},
            "velocity": {"default": 6.0, **said},
            "acceleration": {"default": 60.0, **said},
            "jerk": {"default": 3000.0, **said},
        },
        "feet": [
            {"name": leg, "link": f"{leg}_shank", "sole": [lowest], "radius": _BALL, "friction": 0.7, **said}
            for leg in LEGS
        ],
        "sensors": {
            "rate_hz": 200,
            "noise_position": 1e-4,
            "joint_torque": "motor_side",
            "noise_torque": {"default": 0.05, **said},
            "imu": {"link": "trunk", "noise_gyro": 3e-3, "noise_acceleration": 0.03},
            **said,
        },
        "drives": {"viscous": {"default": 0.05, **said}, "armature": {"default": 0.01, **said}},
        "controller": {"kp": {"default": 1500.0, **said}, "kd": {"default": 12.0, **said}},
        "collision": {
            "geometry": "collision",
            "margin": 0.002,
            "ignored_pairs": [["trunk", f"{leg}_thigh"] for leg in LEGS],
            **said,
        },
    }


def write_quadruped(folder: Path, base: str = "floating", **changes: Any) -> Path:
    """Write URDF and ``robot.yaml``, with some of its fields changed."""
    (folder / "toy.urdf").write_text(quadruped_urdf())
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump({**quadruped_description(base), **changes}, sort_keys=False))
    return path


def quadruped(folder: Path, base: str = "floating", **changes: Any) -> Robot:
    """The robot, loaded."""
    return load_robot(write_quadruped(folder, base, **changes))
