"""Effects that act as a torque at one joint."""

from __future__ import annotations

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.virtual_robot import VirtualRobot

# What a careful experiment should notice, as a share of the drive's torque limit.
_NOTICEABLE = 0.02


class JointTorqueEffect(InjectedEffect):
    """Sits at any joint; by default as large as a fiftieth of what the joint's drive can do."""

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return virtual.robot.joint_names

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return _NOTICEABLE * float(virtual.drives.torque_limit[virtual.robot.joint_index(location)])
