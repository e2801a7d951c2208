"""Forces that the log does not know."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from excite.simulation.coordinates import body_name
from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.plant import Plant
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class PushLaw:
    """A constant force on a link's centre of mass along the world's axes.

    Attributes:
        link: its name.
        force: [N]
    """

    link: str
    force: tuple[float, float, float]

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        body = plant.model.body(body_name(self.link)).id

        def step() -> None:
            plant.force[body, :3] += self.force

        return step


@dataclass(frozen=True)
class PokeLaw:
    """Smooth random torque on a joint, as of somebody who leans on the arm.

    Attributes:
        joint: index of the joint.
        size: standard deviation [N·m].
        seed: of the numbers; another in every run.
    """

    joint: int
    size: float
    seed: int

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        rng = np.random.default_rng([self.seed, int(1000.0 * plant.session_s)])
        i, hz = int(plant.joint_dof[self.joint]), rng.uniform(0.3, 3.0, 8)
        phase = rng.uniform(0.0, 2.0 * np.pi, 8)

        def step() -> None:
            waves = np.sin(2.0 * np.pi * hz * plant.data.time + phase)
            plant.torque[i] += self.size * 0.5 * float(waves.sum())

        return step


class ExternalForce(InjectedEffect):
    """A constant force along the world's x axis, as of a cable; the last link by default."""

    name = "external_force"
    what = "a constant force on a link"
    unit = "N"
    lower, upper = -1e4, 1e4

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return tuple(segment.link for segment in reversed(virtual.robot.segments))

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.1 * virtual.robot.mass

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_law(PushLaw(location, (value, 0.0, 0.0)))
