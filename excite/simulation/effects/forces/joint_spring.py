"""A spring across a joint: a hose, a cable, a gravity compensator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.plant import Plant
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class SpringLaw:
    """``−stiffness (x + hardening x³)`` about a rest position, and dry rubbing of the hose itself.

    Attributes:
        joint: index of the joint.
        stiffness: at rest [N·m/rad].
        rest: position at which it is slack [rad].
        hardening: [1/rad²]
        rubbing: torque of an elasto-plastic element in parallel [N·m]; it yields over 0.1 rad.
    """

    joint: int
    stiffness: float
    rest: float = 0.0
    hardening: float = 0.0
    rubbing: float = 0.0

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        base = plant.robot.n_base_q
        at, i = int(plant.qpos[base + self.joint]), int(plant.joint_dof[self.joint])
        drag, last = 0.0, float(plant.data.qpos[at])

        def step() -> None:
            nonlocal drag, last
            q = float(plant.data.qpos[at])
            x = q - self.rest
            torque = self.stiffness * x * (1.0 + self.hardening * x * x)
            if self.rubbing:
                drag = min(max(drag + (q - last) / 0.1 * self.rubbing, -self.rubbing), self.rubbing)
                last = q
            plant.torque[i] -= torque + drag

        return step


class JointSpring(InjectedEffect):
    """A linear spring that is slack at the joint's zero."""

    name = "joint_spring"
    what = "a spring across a joint"
    unit = "N·m/rad"
    lower, upper = -1e4, 1e4

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return virtual.robot.joint_names

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.05 * float(virtual.drives.torque_limit[virtual.robot.joint_index(location)])

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_law(SpringLaw(virtual.robot.joint_index(location), value))


@dataclass(frozen=True)
class StopLaw:
    """A soft stop that a joint runs into: one-sided, ``−stiffness (q − edge)`` beyond an edge.

    Attributes:
        joint: index of the joint.
        edge: where it begins [rad].
        stiffness: [N·m/rad]
    """

    joint: int
    edge: float
    stiffness: float

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        at = int(plant.qpos[plant.robot.n_base_q + self.joint])
        i = int(plant.joint_dof[self.joint])

        def step() -> None:
            depth = float(plant.data.qpos[at]) - self.edge
            if depth > 0.0:
                plant.torque[i] -= self.stiffness * depth

        return step
