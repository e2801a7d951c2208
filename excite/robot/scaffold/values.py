"""Blocks of a first description that follow from the robot, its rest and its model's limits."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.description import Assumed
from excite.robot.robot import Robot
from excite.robot.scaffold import numbers
from excite.robot.scaffold.guesses import JointGuess, joint_inertias
from excite.robot.scaffold.limbs import Figure
from excite.robot.scaffold.rest import Rest
from excite.robot.scaffold.structure import FRICTION


@dataclass(frozen=True, eq=False)
class Values:
    """What the numbers of a description follow from."""

    path: Path
    robot: Robot
    free: tuple[JointGuess, ...]
    rest: Rest
    figure: Figure
    rng: np.random.Generator

    def __post_init__(self) -> None:
        inertia = joint_inertias(self.robot, self.rng)
        mass = float(self.figure.beyond[0])
        legs = self._legs()
        object.__setattr__(self, "free", numbers.believable(self.free, 9.81 * mass))
        loads = numbers.weight_loads(self.robot, self.rng, legs, 9.81 * mass if legs else 0.0)
        torques, said = numbers.torque_limits(self.robot, self.free, loads, inertia)
        object.__setattr__(self, "inertia", inertia)
        object.__setattr__(self, "loads", loads)
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "missing", (torques, said))
        object.__setattr__(self, "torque", {g.name: torques.get(g.name, g.torque or 1.0) for g in self.free})

    inertia: Array = None  # type: ignore[assignment]
    loads: Array = None  # type: ignore[assignment]
    mass: float = 0.0
    missing: tuple[dict[str, float], list[Assumed]] = ({}, [])
    torque: dict[str, float] = None  # type: ignore[assignment]

    def limits(self, slides: set[str]) -> tuple[dict[str, Any], list[Assumed]]:
        torques, said = self.missing
        velocities, more = numbers.velocity_limits(self.free, slides)
        accelerations = numbers.accelerations(self.free, self.inertia)
        block: dict[str, Any] = {}
        for name, values in (("velocity", velocities), ("torque", torques)):
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
            "joints": {name: 20.0 * value for name, value in accelerations.items()},
            "source": "so that full acceleration takes 0.05 s to build up",
        }
        low, high = min(accelerations.values()), max(accelerations.values())
        rule = Assumed(
            what="acceleration limits",
            value=f"{low:g} … {high:g} rad/s² or m/s², 30 % of the torque limit on the largest inertia",
            consequence="motions may be slower than the robot allows, or faster than its maker does",
        )
        return block, [*said, *more, rule]

    def feet(self) -> list[dict[str, Any]]:
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

    def _legs(self) -> dict[int, Array]:
        """Where weight meets each leg, in the frame of the joint at its end: a point foot's point, a sole's ankle."""
        places = {}
        for joint, foot in zip(self.rest.legs, self.rest.feet, strict=True):
            model = self.robot.model
            link = model.frames[model.getFrameId(foot.link, pin.BODY)].placement
            narrow = len(foot.sole) < 3
            places[joint] = np.asarray(link.act(np.mean(foot.sole, axis=0))) if narrow else np.zeros(3)
        return places

    def controller(self) -> dict[str, Any]:
        found = numbers.gains(self.robot, self.inertia, self.loads, self._legs(), self.mass)
        said = "a servo that its load's weight bends by 0.7 degrees, of 8 Hz at least, damping 0.7"
        return {name: {"joints": values, "source": said} for name, values in found.items()}
