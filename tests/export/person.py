"""A person as a robot, and motions of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.virtual_person import draw_subject
from excite.human.body import Body
from excite.human.models import URDF_FILE, robot_yaml, urdf_text
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot


def drawn_body() -> Body:
    """Segments of a person that nobody is."""
    return draw_subject(np.random.default_rng(3)).body


def person_robot(body: Body, folder: Path) -> Robot:
    """The person as ``excite human`` writes it."""
    (folder / "robot.yaml").write_text(robot_yaml(body, 100.0))
    (folder / URDF_FILE).write_text(urdf_text(body))
    return load_robot(str(folder / "robot.yaml"))


def standing_still(robot: Robot) -> Motion:
    """0.6 s at 100 Hz in the robot's rest posture, on all feet."""
    time = np.arange(61) / 100.0
    zero = np.zeros((len(time), robot.model.nv))
    contacts = {foot.name: np.ones(len(time), dtype=bool) for foot in robot.feet}
    q = np.tile(robot.rest, (len(time), 1))
    return Motion("still", robot.name, robot.joint_names, time, q, zero, zero, contacts)
