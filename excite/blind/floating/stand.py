"""A standing robot of a blind benchmark before anything is hidden in it: sensors, motions, true inertials."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.blind.floating.programme import RATE_HZ, session_programme
from excite.logs.header_blocks import SensorHeader, TrialHeader
from excite.logs.log import LogHeader
from excite.logs.robot import robot_in_log
from excite.motion.motion import Motion
from excite.robot.loading import build_robot, load_robot
from excite.robot.robot import Foot, Robot
from excite.simulation.true_parameters import nominal_truth, scattered_parameters

SensorKind = Literal["force_plate", "foot_ft"]

ROBOTS = ("g1", "talos", "hrp2like", "human")
# Standard deviations of force [N] and moment [N·m] of a sensor.
_NOISE_FORCE, _NOISE_MOMENT = (0.5, 2.0), (0.1, 0.3)
_PERSON_STRENGTH = 2.0
_SCATTER = 0.08


@dataclass(frozen=True, eq=False)
class Stand:
    """A robot on its feet and the session that it is to run.

    Attributes:
        robot: the nominal robot with the sensors of the log.
        header: of the log.
        motions: one a trial; the last repeats the first.
        phi: ``(10·n_segments,)`` true inertial parameters.
        noise: factor on the usual noise.
    """

    robot: Robot
    header: LogHeader
    motions: tuple[Motion, ...]
    phi: Array
    noise: float

    @property
    def free(self) -> bool:
        """Whether the log says that inertial parameters are identified."""
        return "rigid_body" in self.header.modelled


def stand_of(name: str, sensors: SensorKind, fixed: bool, noise: float, rng: np.random.Generator) -> Stand:
    """Draw a robot's session.

    Args:
        name: of a bundled robot with two feet.
        sensors: ``force_plate`` or ``foot_ft``.
        fixed: whether its inertial parameters are the model's; else they are scattered.
        noise: factor on the usual noise.
        rng: source of all that is drawn.

    Returns:
        The stand.
    """
    robot = standing_robot(name)
    motions, n_validation = session_programme(robot, rng)
    again = replace(motions[0], name=f"trial_{len(motions):02d}")
    trials = [
        TrialHeader(
            file=f"{motion.name}.parquet",
            role="identification" if k < len(motions) - n_validation else "validation",
        )
        for k, motion in enumerate(motions)
    ]
    trials.append(TrialHeader(file=f"{again.name}.parquet", role="identification", repeats=trials[0].file))
    header = LogHeader(
        schema="excite.log/1",
        robot="robot.urdf",
        base="floating",
        gravity=robot.description.gravity,
        rate_hz=RATE_HZ,
        joints=robot.joint_names,
        base_link=robot.base_link,
        wrench="on_robot_in_sensor_frame",
        sensors=tuple(_mount_sensor(robot, foot, sensors, noise, rng) for foot in robot.feet),
        modelled=("rigid_body_fixed" if fixed else "rigid_body",),
        trials=tuple(trials),
    )
    truth = nominal_truth(robot) if fixed else scattered_parameters(robot, rng, scatter=_SCATTER)
    return Stand(robot_in_log(robot, header), header, (*motions, again), truth.phi, noise)


def standing_robot(name: str) -> Robot:
    """A bundled robot as a bare URDF tells it, joints that the log lacks at zero; a person is a strong one."""
    robot = load_robot(name)
    if robot.description.locked_joints:
        locked = dict.fromkeys(robot.description.locked_joints, 0.0)
        robot = build_robot(robot.description.model_copy(update={"locked_joints": locked}), robot.source)
    if name == "human":
        limits = replace(robot.limits, torque=_PERSON_STRENGTH * robot.limits.torque)
        robot = replace(robot, limits=limits)
    return robot


def _mount_sensor(
    robot: Robot, foot: Foot, kind: SensorKind, noise: float, rng: np.random.Generator
) -> SensorHeader:
    """A sensor near the ankle, or a plate near where the foot stands; some hang upside down."""
    shift = rng.uniform(-1.0, 1.0, 3)
    turned = (np.pi, 0.0, 0.0) if rng.random() < 0.4 else (0.0, 0.0, 0.0)
    forces, moments = noise * rng.uniform(*_NOISE_FORCE), noise * rng.uniform(*_NOISE_MOMENT)
    excludes: tuple[str, ...]
    if kind == "foot_ft":
        place, parent, excludes = 0.015 * shift - [0.0, 0.0, 0.015], foot.link, (foot.link,)
    else:
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, robot.rest)
        sole = data.oMi[foot.joint].act(foot.placement.translation)
        place, parent, excludes = sole + shift * [0.06, 0.03, 0.012] - [0.0, 0.0, 0.012], "world", ()
    x, y, z = (round(float(value), 6) for value in place)
    return SensorHeader(
        name=foot.name if kind == "foot_ft" else foot.name.replace("foot", "plate"),
        kind=kind,
        parent=parent,
        xyz=(x, y, z),
        rpy=turned,
        foot=foot.link,
        excludes=excludes,
        noise_force=float(forces),
        noise_moment=float(moments),
    )
