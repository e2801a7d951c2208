"""The curve behind a point of the search, and its samples as a motion."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np

from excite.arrays import Array
from excite.excitation.optimisation.chain import Chain
from excite.motion.generators.curves import Curve
from excite.motion.motion import Motion, MotionMetadata
from excite.robot.robot import Robot

NAME = "optimised_fourier"


def whole_curve(chain: Chain, x: Array) -> Curve:
    """The motion of all joints, those that do not move at rest."""
    layout = chain.layout
    robot = layout.robot
    offset, table = layout.parts(x)
    start = robot.rest[robot.n_base_q :].copy()
    whole = np.zeros((robot.n_joints, layout.family.n_coefficients))
    start[layout.joints], whole[layout.joints] = offset, table
    return layout.family.curve(start, whole)


def sample_curve(robot: Robot, curve: Curve, name: str, seed: int | None = None) -> Motion:
    """A curve in time as a motion at the robot's rate; a free base stands still on all its feet."""
    n = max(2, int(np.ceil(curve.length * robot.description.sensors.rate_hz)))
    time = np.linspace(0.0, curve.length, n + 1)
    q = np.tile(robot.rest, (n + 1, 1))
    v, a = np.zeros((2, n + 1, robot.model.nv))
    q[:, robot.n_base_q :], v[:, robot.n_base_v :], a[:, robot.n_base_v :] = (
        curve.evaluate(time, order) for order in range(3)
    )
    return Motion(
        name=name,
        robot=robot.name,
        joint_names=robot.joint_names,
        time=time,
        q=q,
        v=v,
        a=a,
        contacts={foot.name: np.ones(n + 1, dtype=bool) for foot in robot.feet},
        metadata=MotionMetadata(
            generator=NAME,
            seed=seed,
            targets=robot.joint_names,
            robot_hash=robot.hash,
            versions={package: version(package) for package in ("excite", "casadi", "numpy")},
        ),
    )
