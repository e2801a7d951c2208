"""In which place of Unitree's ``motor_cmd`` each joint stands.

As in the vendor's SDK (unitree_sdk2: ``example/go2``, ``example/h1``, ``example/g1``) and, for G1s of 23 joints, its
page "Joint Motor Sequence": those have the places of the 29 and leave some empty.
"""

from __future__ import annotations

from excite.errors import InputError
from excite.robot.robot import Robot

MODEL = "model"
"""Setting for the order of the robot's own joints."""

_QUADRUPED = tuple(f"{leg}_{joint}" for leg in ("FR", "FL", "RR", "RL") for joint in ("hip", "thigh", "calf"))
_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
_G1 = (
    *(f"{side}_{joint}" for side in ("left", "right") for joint in _LEG),
    *("waist_yaw", "waist_roll", "waist_pitch"),
    *(f"{side}_{joint}" for side in ("left", "right") for joint in _ARM),
)
_H1 = (
    *("right_hip_roll", "right_hip_pitch", "right_knee", "left_hip_roll", "left_hip_pitch", "left_knee"),
    *("torso", "left_hip_yaw", "right_hip_yaw", "", "left_ankle", "right_ankle"),
    *(f"{side}_{joint}" for side in ("right", "left") for joint in _ARM[:4]),
)
KNOWN = {"quadruped": _QUADRUPED, "g1": _G1, "h1": _H1}
"""Joints by place, without ``_joint`` at their ends; an empty name where no motor is."""


def motor_places(robot: Robot, order: str) -> dict[str, int]:
    """By joint of the robot, its place in ``motor_cmd``.

    Args:
        robot: the robot.
        order: joints between commas in the motors' order, ``-`` for a motor that the robot does not have; ``model`` for
            the robot's own order; empty for what is known of its joints' names.

    Raises:
        InputError: a joint has no place, or two; nobody knows the robot's motors and nothing is said.
    """
    joints = robot.driven_names
    if order == MODEL:
        return {joint: place for place, joint in enumerate(joints)}
    if order:
        return _stated_motors(robot, [name.strip() for name in order.split(",")])
    short = [joint.removesuffix("_joint") for joint in joints]
    found = [
        tuple(names.index(name) for name in short)
        for names in KNOWN.values()
        if all(name in names for name in short)
    ]
    if len(set(found)) != 1:
        raise InputError(
            f"nobody knows the order of the motors of {robot.name!r}",
            source="unitree",
            field="motors",
            remedy=f"give --set motors=JOINT,JOINT,… as motor_cmd has them, or motors={MODEL} for the model's order",
        )
    return dict(zip(joints, found[0], strict=True))


def _stated_motors(robot: Robot, names: list[str]) -> dict[str, int]:
    places = {joint: [k for k, name in enumerate(names) if name == joint] for joint in robot.driven_names}
    for joint, found in places.items():
        if len(found) != 1:
            raise InputError(
                f"has {len(found)} places for joint {joint!r}",
                source="unitree",
                field="motors",
                remedy="name each joint of the robot once",
            )
    for name in names:
        if name != "-" and name not in places:
            raise InputError(
                f"names {name[:40]!r}, which robot {robot.name!r} does not have",
                source="unitree",
                field="motors",
                remedy="write - for a motor that it does not have",
            )
    return {joint: found[0] for joint, found in places.items()}
