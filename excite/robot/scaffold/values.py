"""Blocks of a first description that follow from the robot, its rest and its model's limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.description import Assumed
from excite.robot.robot import Robot
from excite.robot.scaffold import numbers
from excite.robot.scaffold.guesses import JointGuess, joint_inertias
from excite.robot.scaffold.rest import Rest
from excite.robot.scaffold.structure import FRICTION
from excite.shown import span


@dataclass(frozen=True, eq=False)
class Values:
    """What the numbers of a description follow from.

    Attributes:
        robot: without limits and feet.
        free: what the model says of each joint that can be believed.
        rest: the posture, with what stands on the ground in it.
        mass: of the whole [kg].
        inertia: ``(n_joints,)`` the largest at each joint [kg·m² or kg].
        loads: ``(n_joints,)`` torques that hold the weight [N·m or N].
        assumed: torque limits that the model does not state [N·m or N].
        said: what was assumed for them.
    """

    robot: Robot
    free: tuple[JointGuess, ...]
    rest: Rest
    mass: float
    inertia: Array
    loads: Array
    assumed: dict[str, float]
    said: list[Assumed]

    @classmethod
    def of(
        cls,
        robot: Robot,
        free: tuple[JointGuess, ...],
        rest: Rest,
        mass: float,
        rng: np.random.Generator,
        rotors: Mapping[str, float],
    ) -> Self:
        """The values of a robot of that mass [kg]; ``rng`` draws the postures in which joints are looked at.

        ``rotors`` are the drives' own inertias by joint, which their torques turn too [kg·m² or kg].
        """
        own = np.array([rotors.get(name, 0.0) for name in robot.joint_names])
        inertia, legs, weight = joint_inertias(robot, rng) + own, _leg_contacts(robot, rest), 9.81 * mass
        free = numbers.drop_unbelievable_limits(free, weight)
        loads = numbers.weight_loads(robot, rng, legs, weight if legs else 0.0)
        assumed, said = numbers.torque_limits(robot, free, loads, inertia)
        return cls(robot, free, rest, mass, inertia, loads, assumed, said)

    @property
    def torque(self) -> dict[str, float]:
        """Torque limit of each joint, assumed where the model states none [N·m or N]."""
        return {g.name: self.assumed.get(g.name, g.torque or 1.0) for g in self.free}

    def limits(self, slides: set[str]) -> tuple[dict[str, Any], list[Assumed]]:
        """The block ``limits`` of a description, and what was assumed for it; ``slides`` are joints along an axis."""
        velocities, more = numbers.velocity_limits(self.free, slides)
        accelerations = numbers.guess_accelerations(self.free, self.inertia)
        block: dict[str, Any] = {}
        for name, values in (("velocity", velocities), ("torque", self.assumed)):
            if values:
                block[name] = {
                    "joints": values,
                    "source": "assumed for joints whose limit the model does not state",
                }
        block["acceleration"] = {
            "joints": accelerations,
            "source": "30 % of the torque limit on the largest inertia at the joint, at most 30 rad/s²",
        }
        block["jerk"] = {
            "joints": {g.name: min(20.0 * accelerations[g.name], g.jerk or math.inf) for g in self.free},
            "source": "so that full acceleration takes 0.05 s to build up",
        }
        low, high = min(accelerations.values()), max(accelerations.values())
        rule = Assumed(
            what="acceleration limits",
            value=f"{span(f'{low:g}', f'{high:g}')} rad/s² or m/s², 30 % of the torque limit on the largest inertia",
            consequence="motions may be slower than the robot allows, or faster than its maker does",
        )
        low, high = 20.0 * low, 20.0 * high
        jerk = Assumed(
            what="jerk limits",
            value=f"{span(f'{low:g}', f'{high:g}')} rad/s³ or m/s³, full acceleration within 0.05 s",
            consequence="motions may start and turn softer than the robot has to, or harder than its maker lets it",
        )
        return block, [*self.said, *more, rule, jerk]

    def feet(self) -> list[dict[str, Any]]:
        """The block ``feet``: sole, radius and friction of each."""
        feet = []
        for foot in self.rest.feet:
            sole = [[round(float(x), 5) + 0.0 for x in corner] for corner in foot.sole]
            kind = {1: "point", 2: "edge"}.get(len(sole), "polygon")
            feet.append(
                {
                    "name": foot.link,
                    "link": foot.link,
                    "sole": sole,
                    **({"radius": foot.radius} if foot.radius else {}),
                    "friction": FRICTION,
                    "source": f"{kind} where the link's geometry is lowest in the posture above; friction assumed",
                }
            )
        return feet

    def controller(self) -> tuple[dict[str, Any], list[Assumed]]:
        """The block ``controller``, gains of a servo at each joint, and what was assumed for it."""
        legs = _leg_contacts(self.robot, self.rest)
        found = numbers.guess_gains(self.robot, self.inertia, self.loads, legs, self.mass)
        said = "a servo that its load's weight bends by 0.7 degrees, of 8 Hz at least, damping 0.7"
        if any(not tip.any() for tip in legs.values()):
            said += ", legs on soles twenty times stiffer than what topples the robot"
        block = {name: {"joints": values, "source": said} for name, values in found.items()}
        if not legs:
            return block, []
        of_legs = [found["kp"][self.robot.joint_names[joint - 1]] for joint in legs]
        size = " … ".join(f"{value:g}" for value in sorted({min(of_legs), max(of_legs)}))
        stiff = Assumed(
            what="servo gains",
            value=f"kp {size} N·m/rad at the ends of the legs, as stiff as geared position servos are",
            consequence="motions are rehearsed with them, without feedback of balance: a robot with softer servos "
            "may fall where this one stands: state controller.kp and kd",
        )
        return block, [stiff]


def _leg_contacts(robot: Robot, rest: Rest) -> dict[int, Array]:
    """Where weight meets each leg, in the frame of the joint at its end: a point foot's point, a sole's ankle."""
    places = {}
    for joint, foot in zip(rest.legs, rest.feet, strict=True):
        link = robot.model.frames[robot.model.getFrameId(foot.link, pin.BODY)].placement
        narrow = len(foot.sole) < 3
        places[joint] = np.asarray(link.act(np.mean(foot.sole, axis=0))) if narrow else np.zeros(3)
    return places
