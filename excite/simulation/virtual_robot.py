"""A robot that is not the model: true parameters, true drives and what was injected into it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from excite.robot.robot import Robot
from excite.simulation.drives import Drives, nominal_drives, scattered_drives
from excite.simulation.mjcf import World
from excite.simulation.plant import Change, Law
from excite.simulation.recording import Recording
from excite.simulation.true_parameters import (
    TrueParameters,
    carried_load,
    has_hands,
    hrp2_like_changes,
    nominal_truth,
    scattered_parameters,
)

Reading = Callable[[Recording], Recording]


@dataclass(frozen=True)
class Injected:
    """An effect that was injected: its name, its location, and its value in the effect's unit."""

    effect: str
    location: str
    value: float
    unit: str


@dataclass(frozen=True, eq=False)
class VirtualRobot:
    """What is simulated in place of a real robot.

    Attributes:
        robot: the nominal robot; limits, contacts and sensors of its description hold for the truth too.
        truth: true inertial parameters and what was changed to get them.
        drives: true drives.
        world: numerical settings and the ground.
        readings: what sits between the physics and the log, applied in order before noise is added; each has
            to survive pickling.
        noise: factor on the noise of every sensor; 0 for a log without noise.
        laws: injected physics that acts at every step.
        changes: injected changes of the machine itself, made before it is compiled, in order.
        injected: names, places and sizes of all that was injected, in order.
    """

    robot: Robot
    truth: TrueParameters
    drives: Drives
    world: World = field(default_factory=World)
    readings: tuple[Reading, ...] = ()
    noise: float = 1.0
    laws: tuple[Law, ...] = ()
    changes: tuple[Change, ...] = ()
    injected: tuple[Injected, ...] = ()

    def with_law(self, law: Law) -> VirtualRobot:
        """The same robot under one more law."""
        return replace(self, laws=(*self.laws, law))

    def with_change(self, change: Change) -> VirtualRobot:
        """The same robot with one more change of the machine."""
        return replace(self, changes=(*self.changes, change))

    def with_reading(self, reading: Reading) -> VirtualRobot:
        """The same robot with one more effect on what its sensors say."""
        return replace(self, readings=(*self.readings, reading))

    def noiseless(self) -> VirtualRobot:
        """The same robot with sensors free of noise."""
        return replace(self, noise=0.0)


def nominal_robot(robot: Robot) -> VirtualRobot:
    """The virtual robot that is the model: nominal parameters, declared drives."""
    return VirtualRobot(robot, nominal_truth(robot), nominal_drives(robot))


def changed_robot(robot: Robot, rng: np.random.Generator) -> VirtualRobot:
    """A virtual robot that differs from its model as a used robot does.

    A standing robot got parts added (:func:`~excite.simulation.true_parameters.hrp2_like_changes`), one without hands
    a load; any other has inertial parameters and friction scattered about the declared ones.
    """
    if robot.floating and robot.feet:
        if not has_hands(robot):
            return VirtualRobot(robot, carried_load(robot, rng), nominal_drives(robot))
        return VirtualRobot(robot, hrp2_like_changes(robot, rng), nominal_drives(robot))
    truth = scattered_parameters(robot, rng)
    return VirtualRobot(robot, truth, scattered_drives(robot, rng))
