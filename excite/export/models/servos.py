"""Servos of a robot of which a log brought no more than a bare URDF."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.errors import RobotError
from excite.logs.bare_urdf import is_bare
from excite.robot.description import ControllerBlock
from excite.robot.robot import Robot
from excite.robot.scaffold.description import draft_description
from excite.robot.scaffold.said import Said

ASSUMED = (
    "nothing that was read states the servos' gains: those of the file are assumed so that the servos carry the robot; "
    "set your controller's, or identify with a robot.yaml that has them"
)
"""What a user of a file with such servos should know."""


def with_servos(robot: Robot) -> Robot:
    """The robot with gains as ``excite init-robot`` assumes them, in place of a bare URDF's placeholders."""
    if not is_bare(robot):
        return robot
    try:
        made = draft_description(robot.source, None, np.random.default_rng(0), Said(floating=robot.floating))[
            "controller"
        ]
    except RobotError:
        return robot
    if not set(robot.joint_names) <= set(made["kp"]["joints"]):
        return robot
    own = {
        gain: {**block, "joints": {name: block["joints"][name] for name in robot.joint_names}}
        for gain, block in made.items()
    }
    servos = ControllerBlock.model_validate(own)
    return replace(robot, description=robot.description.model_copy(update={"controller": servos}))
