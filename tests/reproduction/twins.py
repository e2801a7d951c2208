"""Virtual twins: robots whose inertials, friction, sensors and noise differ from the model as real ones do."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.robot.robot import Robot
from excite.simulation.true_parameters import (
    AddedPart,
    TrueParameters,
    hrp2_like_changes,
    scattered_drives,
    scattered_parameters,
    with_part,
)
from excite.simulation.virtual_robot import Recording, VirtualRobot

# Of an arm: scatter of its links (see scattered_parameters), mass of cables and screws as a share of each link's,
# and what fingers, a plug or a plate add to the last link, as a share of the arm's mass.
_SCATTER, _HARNESS, _TOOL = 0.06, 0.04, 0.05
# Torque sensors: spread of their gain [1] and of their offset, as a share of the torque limit.
_GAIN, _OFFSET = 0.01, 0.002
# Of a standing robot: scatter of the segments that nothing was added to.
_BODY_SCATTER = 0.03
# Noise of a sensor in use against that of its data sheet.
_NOISE = 1.3


@dataclass(frozen=True)
class TorqueCalibration:
    """Torque sensors that read ``gain · τ + offset``.

    Attributes:
        gain: by joint, ``(n_joints,)``.
        offset: by joint [N·m or N].
    """

    gain: tuple[float, ...]
    offset: tuple[float, ...]

    def __call__(self, recording: Recording) -> Recording:
        """The recording with what the sensors would say."""
        gain, offset = np.array(self.gain), np.array(self.offset)
        return replace(
            recording,
            tau_motor=gain * recording.tau_motor + offset,
            tau_link=gain * recording.tau_link + offset,
        )


def virtual_twin(robot: Robot, rng: np.random.Generator) -> VirtualRobot:
    """The twin of a robot: what an experiment meets in place of the model.

    An arm's links are scattered about the model's, carry cables and, at the last one, fingers; gears and
    bearings rub more or less than declared; torque sensors have a gain and an offset of their own. A standing
    robot carries the parts of :func:`~excite.simulation.true_parameters.hrp2_like_changes`, its other segments
    are scattered a little. Sensors are noisier than declared.

    Args:
        robot: the robot.
        rng: source of everything.

    Returns:
        The virtual robot; its ``truth`` is physically consistent.
    """
    if robot.floating:
        truth = hrp2_like_changes(robot, rng, scatter=_BODY_SCATTER)
        return VirtualRobot(robot, truth, scattered_drives(robot, rng), noise=_NOISE)
    truth = _dressed(robot, scattered_parameters(robot, rng, scatter=_SCATTER), rng)
    drives = scattered_drives(robot, rng)
    calibration = TorqueCalibration(
        tuple((1.0 + _GAIN * rng.standard_normal(robot.n_joints)).tolist()),
        tuple((_OFFSET * robot.limits.torque * rng.standard_normal(robot.n_joints)).tolist()),
    )
    return VirtualRobot(robot, truth, drives, readings=(calibration,), noise=_NOISE)


def _dressed(robot: Robot, truth: TrueParameters, rng: np.random.Generator) -> TrueParameters:
    """Cables on every link with mass, and something held by the last."""
    masses = robot.nominal_parameters[::10]
    for index in range(len(masses)):
        if masses[index] > 0.0:
            truth = with_part(truth, _part(robot, rng, "cables", index, _HARNESS * masses[index]))
    last = int(np.flatnonzero(masses > 0.0)[-1])
    return with_part(truth, _part(robot, rng, "fingers", last, _TOOL * float(masses.sum())))


def _part(robot: Robot, rng: np.random.Generator, what: str, index: int, mass: float) -> AddedPart:
    """A part within a radius of gyration of a link's centre of mass; what the last link holds lies beyond it."""
    segment = robot.segments[index]
    inertia = robot.model.inertias[segment.joint]
    radius = float(np.sqrt(np.trace(inertia.inertia) / (2.0 * inertia.mass)))
    position: Array = inertia.lever + radius * rng.uniform(-1.0, 1.0, 3)
    if what == "fingers":
        position = inertia.lever * (1.0 + radius / max(float(np.linalg.norm(inertia.lever)), radius))
    size = (radius, radius, radius)
    x, y, z = (float(value) for value in position)
    return AddedPart(what, index, segment.link, float(mass), (x, y, z), size)
