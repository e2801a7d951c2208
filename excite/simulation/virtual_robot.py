"""A robot that is not the model: true parameters, true drives and what was injected into it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from excite.robot.robot import Array, Robot
from excite.simulation.drives import Drives, nominal_drives
from excite.simulation.mjcf import World
from excite.simulation.recording import Recording

Reading = Callable[[Recording], Recording]


@dataclass(frozen=True, eq=False)
class VirtualRobot:
    """What is simulated in place of a real robot.

    Attributes:
        robot: the nominal robot; what its description says of limits, contacts and sensors holds for the truth.
        phi: true inertial parameters, ``(10·n_segments,)``, joint frames.
        drives: true drives.
        world: numerical settings and the ground.
        readings: what sits between the physics and the log, applied in order before noise is added.
        noise: factor on the noise of every sensor; 0 for a log without noise.
    """

    robot: Robot
    phi: Array
    drives: Drives
    world: World = World()
    readings: tuple[Reading, ...] = ()
    noise: float = 1.0

    def with_reading(self, reading: Reading) -> VirtualRobot:
        """The same robot with one more effect on what its sensors say."""
        return replace(self, readings=(*self.readings, reading))

    def silent(self) -> VirtualRobot:
        """The same robot with sensors free of noise."""
        return replace(self, noise=0.0)


def nominal_robot(robot: Robot) -> VirtualRobot:
    """The virtual robot that is the model: nominal parameters, declared drives."""
    return VirtualRobot(robot, robot.nominal_parameters, nominal_drives(robot))
