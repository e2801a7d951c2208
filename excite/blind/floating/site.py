"""Places of a standing robot at which effects are hidden."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.blind.floating.pulls import Vector
from excite.blind.floating.truth import Truth
from excite.blind.hidden import HiddenEffect
from excite.motion.generators.bodyparts import leg_joints


@dataclass(frozen=True, eq=False)
class Site:
    """An effect about to be hidden: into what, in which form, how large.

    Attributes:
        truth: the robot so far.
        effect: its name.
        form: its form.
        size: 1 for the usual size.
        rng: source of place and magnitude.
    """

    truth: Truth
    effect: str
    form: str
    size: float
    rng: np.random.Generator

    def sign(self) -> float:
        """One or minus one, either as likely."""
        return float(self.rng.choice([-1.0, 1.0]))

    def draw(self, low: float, high: float) -> float:
        """A magnitude between two bounds, times the effect's size."""
        return self.size * float(self.rng.uniform(low, high))

    def vector(self, low: float, high: float) -> Vector:
        """A random direction of a length between ``low`` and ``high``."""
        way = self.rng.standard_normal(3)
        x, y, z = (float(part) for part in self.draw(low, high) * way / np.linalg.norm(way))
        return x, y, z

    def one(self, names: tuple[str, ...]) -> str:
        """One of some names, each as likely."""
        return str(self.rng.choice(names))

    def found(self, place: str, value: float, **details: float) -> HiddenEffect:
        """What is hidden, with the numbers that describe it."""
        numbers = {name: float(x) for name, x in details.items()}
        return HiddenEffect(self.effect, place, float(value), self.form, numbers)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors of forces."""
        return tuple(sensor.name for sensor in self.truth.stand.robot.sensors)

    @property
    def measured(self) -> tuple[int, ...]:
        """Segments with mass that the sensors carry."""
        robot = self.truth.stand.robot
        beyond = {segment for sensor in robot.sensors for segment in sensor.excludes}
        masses = robot.nominal_parameters[::10]
        return tuple(k for k in range(len(robot.segments)) if k not in beyond and masses[k] > 0.0)

    @property
    def heavy(self) -> tuple[int, ...]:
        """Measured segments of at least a hundredth of the whole."""
        robot = self.truth.stand.robot
        masses = robot.nominal_parameters[::10]
        return tuple(k for k in self.measured if masses[k] >= 0.01 * robot.mass)

    @property
    def hands(self) -> tuple[int, ...]:
        """Last segments of at least 0.2 kg, feet and heads left out, and those before them."""
        robot = self.truth.stand.robot
        legs = {i + 1 for foot in robot.feet for i in leg_joints(robot, foot)}
        parents = [int(robot.model.parents[k + 1]) - 1 for k in range(len(robot.segments))]
        masses = robot.nominal_parameters[::10]
        ends = []
        for leaf in sorted(set(range(len(parents))) - set(parents) - legs):
            k = leaf
            while masses[k] < 0.2 and parents[k] >= 0:
                k = parents[k]
            if not {"head", "neck", "cervical"} & set(_name_words(robot.segments[k].link)):
                ends.append(k)
        return tuple(dict.fromkeys(ends))

    @property
    def joints(self) -> tuple[int, ...]:
        """Model joints that carry a fiftieth of the whole, or a sensor."""
        robot = self.truth.stand.robot
        carried = [float(inertia.mass) for inertia in robot.model.inertias]
        for joint in range(robot.model.njoints - 1, 1, -1):
            carried[int(robot.model.parents[joint])] += carried[joint]
        holding = {
            int(j) for sensor in robot.sensors if sensor.joint for j in robot.model.supports[sensor.joint]
        }
        return tuple(
            j for j in range(2, robot.model.njoints) if carried[j] > 0.02 * robot.mass or j in holding
        )

    def link(self, segment: int) -> str:
        """Name of a segment's link."""
        return self.truth.stand.robot.segments[segment].link

    def centre(self, segment: int) -> Vector:
        """Centre of mass in the frame of the segment's joint."""
        x, y, z = (float(c) for c in self.truth.stand.robot.model.inertias[segment + 1].lever)
        return x, y, z


def _name_words(link: str) -> list[str]:
    return link.lower().replace("-", "_").split("_")
