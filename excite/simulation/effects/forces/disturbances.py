"""Torques at a joint that no name of a diagnosis stands for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from excite.simulation.plant import Plant


@dataclass(frozen=True)
class PulseLaw:
    """Half waves of torque at regular times, as of a machine beside the arm that knocks at it.

    Attributes:
        joint: index of the joint.
        size: peak [N·m].
        period: from one pulse to the next [s].
        width: of a pulse [s].
    """

    joint: int
    size: float
    period: float
    width: float

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step; the machine's clock is the session's."""
        i = int(plant.joint_dof[self.joint])

        def step() -> None:
            since = (plant.session_s + plant.data.time) % self.period
            if since < self.width:
                plant.torque[i] += self.size * float(np.sin(np.pi * since / self.width))

        return step


@dataclass(frozen=True)
class HoseLaw:
    """A hose between two joints that pulls at one of them as the other one turns: ``size · sin(rate q + phase)``.

    Attributes:
        joint: index of the joint that is pulled.
        other: index of the joint that decides how much.
        size: largest pull [N·m].
        rate: [rad/rad]
        phase: [rad]
    """

    joint: int
    other: int
    size: float
    rate: float
    phase: float

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        i, at = int(plant.joint_dof[self.joint]), int(plant.qpos[plant.robot.n_base_q + self.other])

        def step() -> None:
            angle = self.rate * float(plant.data.qpos[at]) + self.phase
            plant.torque[i] += self.size * float(np.sin(angle))

        return step


@dataclass(frozen=True)
class GripLaw:
    """A worn brake that grips and lets go at random: dry friction steps up and down.

    Attributes:
        joint: index of the joint.
        level: friction while it grips [N·m].
        dwell: mean time in either state [s].
        seed: of the times; others in every run.
    """

    joint: int
    level: float
    dwell: float
    seed: int

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        rng = np.random.default_rng([self.seed, int(1000.0 * plant.session_s)])
        grips, until = False, float(rng.exponential(self.dwell))

        def step() -> None:
            nonlocal grips, until
            while plant.data.time > until:
                grips, until = not grips, until + float(rng.exponential(self.dwell))
            if grips:
                plant.friction[self.joint] += self.level

        return step
