"""A small arm as robot.yaml, URDF and MJCF, and the command lines that read them."""

from __future__ import annotations

from pathlib import Path

from tests.robot.small import ARM

YAML = """\
schema: excite.robot/1
name: arm
title: Small arm
model: {path: arm.urdf, source: test}
base: fixed
locked_joints: {}
posture: {joints: {elbow: 0.3}, source: test}
limits:
  position: {joints: {}, margin: 0.03, source: test}
  acceleration: {default: 5.0, source: test}
  jerk: {default: 100.0, source: test}
sensors: {rate_hz: 500, noise_position: 1.0e-4, joint_torque: link_side, source: test}
controller:
  kp: {default: 100.0, source: test}
  kd: {default: 5.0, source: test}
segments: {names: {}, com_box: {}}
collision: {geometry: collision, margin: 0.01, source: test}
gravity: [0.0, 0.0, -9.81]
"""

MJCF = """\
<mujoco model="small">
  <compiler angle="radian"/>
  <worldbody>
    <body name="upper" pos="0 0 0.1">
      <joint name="shoulder" axis="0 1 0" range="-1.5 1.5" limited="true"/>
      <inertial pos="0 0 0.2" mass="2" diaginertia="0.03 0.03 0.004"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.05"/>
      <body name="lower" pos="0 0 0.4">
        <joint name="elbow" axis="0 1 0" range="-2 2" limited="true"/>
        <inertial pos="0 0 0.15" mass="1" diaginertia="0.01 0.01 0.002"/>
        <geom type="box" pos="0 0 0.15" size="0.03 0.03 0.12"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def replaced(text: str, old: str, new: str) -> str:
    """A text with one passage replaced; it must be there exactly once."""
    if text.count(old) != 1:
        raise ValueError(f"{old!r} occurs {text.count(old)} times")
    return text.replace(old, new)


def check_robot(folder: Path, description: str | bytes = YAML, urdf: str = ARM) -> list[str]:
    """Write a robot and ask for a check with it."""
    content = description if isinstance(description, bytes) else description.encode()
    (folder / "robot.yaml").write_bytes(content)
    (folder / "arm.urdf").write_text(urdf, encoding="utf-8")
    return ["check", str(folder / "robot.yaml"), str(folder / "motion.csv")]


def init_robot(folder: Path, content: str | bytes, name: str = "arm.urdf") -> list[str]:
    """Write a model and ask for its first description."""
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return ["init-robot", str(folder / name)]
