"""A folder as ``excite identify --out`` leaves it, of parameters that are known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.results import write_json
from excite.robot.load import load_robot
from excite.robot.robot import Robot
from excite.simulation.true_parameters import scattered_parameters
from tests.export.identified import identification_of

TERMS = ("viscous", "coulomb", "armature")


@dataclass(frozen=True)
class Known:
    """A robot, where its result lies, and what is in that.

    Attributes:
        robot: the robot.
        folder: the folder with ``identification.json``.
        parameters: inertial, ``(10·n,)``.
        drives: terms by name.
    """

    robot: Robot
    folder: Path
    parameters: np.ndarray
    drives: dict[str, float]

    def term(self, name: str) -> np.ndarray:
        return np.array([self.drives[f"{name}.{joint}"] for joint in self.robot.joint_names])


def known(name: str, folder: Path, **more: float) -> Known:
    """Scattered parameters and drives of a robot as a result."""
    robot, rng = load_robot(name), np.random.default_rng(4)
    parameters = scattered_parameters(robot, rng, scatter=0.1).phi
    drives = {
        f"{term}.{joint}": float(rng.uniform(0.05, 1.0)) for term in TERMS for joint in robot.joint_names
    }
    drives |= more
    write_json(identification_of(robot, parameters, drives).to_json(), folder / "identification.json")
    return Known(robot, folder, parameters, drives)
