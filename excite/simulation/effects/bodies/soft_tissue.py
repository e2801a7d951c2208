"""Matter of a segment that wobbles on it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from excite.simulation.coordinates import body_name
from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.inertial import box_parameters
from excite.simulation.true_parameters import TrueParameters
from excite.simulation.virtual_robot import VirtualRobot

if TYPE_CHECKING:
    import mujoco

_SHARE = 0.3
_RATIO = 0.4


@dataclass(frozen=True)
class Wobble:
    """A point-like mass on three springs about a place in a body (Gruber et al. 1998, wobbling masses).

    Attributes:
        body: its name.
        mass: [kg]
        place: in the body's frame [m].
        hertz: of each spring.
    """

    body: str
    mass: float
    place: tuple[float, float, float]
    hertz: float

    def __call__(self, spec: mujoco.MjSpec) -> None:
        """Hang the mass into the body."""
        import mujoco

        stiffness = self.mass * (2.0 * math.pi * self.hertz) ** 2
        size = 1e-3 * self.mass
        wobbling = spec.body(body_name(self.body)).add_body(
            name=f"{self.body}.tissue",
            pos=self.place,
            explicitinertial=True,
            mass=self.mass,
            ipos=[0.0, 0.0, 0.0],
            inertia=[size, size, size],
        )
        for name, axis in zip("xyz", np.eye(3), strict=True):
            joint = wobbling.add_joint(
                name=f"{self.body}.tissue.{name}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis
            )
            joint.stiffness = [stiffness, 0.0, 0.0]
            joint.damping = [2.0 * _RATIO * math.sqrt(stiffness * self.mass), 0.0, 0.0]


class SoftTissue(InjectedEffect):
    """A third of a link's mass wobbles at this frequency about the link's centre of mass."""

    name = "soft_tissue"
    what = "matter of a link that wobbles on it"
    unit = "Hz"
    lower, upper = 0.5, 100.0

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        robot = virtual.robot
        if not robot.floating:
            return ()
        feet = {foot.joint for foot in robot.feet}
        heavy = [
            s for s in robot.segments if s.joint not in feet and robot.model.inertias[s.joint].mass > 0.1
        ]
        return tuple(s.link for s in sorted(heavy, key=lambda s: -robot.model.inertias[s.joint].mass))

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 6.0

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        k = next(i for i, each in enumerate(virtual.robot.segments) if each.link == location)
        block = virtual.truth.phi[10 * k : 10 * k + 10]
        mass, centre = _SHARE * float(block[0]), block[1:4] / block[0]
        edge = (0.001 * 6.0) ** 0.5
        phi = virtual.truth.phi.copy()
        phi[10 * k : 10 * k + 10] -= box_parameters(mass, centre, np.array([edge, edge, edge]))
        truth = TrueParameters(phi, virtual.truth.parts, virtual.truth.scatter)
        x, y, z = (float(part) for part in centre)
        return replace(virtual, truth=truth).with_change(Wobble(location, mass, (x, y, z), value))
