"""Coulomb friction in a joint's output bearing."""

from __future__ import annotations

from dataclasses import replace

from excite.simulation.effects.forces.joint_torque import JointTorqueEffect
from excite.simulation.virtual_robot import VirtualRobot


class CoulombFriction(JointTorqueEffect):
    """A torque of constant size against the joint's velocity, on the link's side of any torque sensor."""

    name = "coulomb_friction"
    what = "more Coulomb friction in a joint"
    unit = "N·m"
    lower, upper = 0.0, 1e4

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        friction = virtual.drives.bearing_coulomb.copy()
        friction[virtual.robot.joint_index(location)] += value
        return replace(virtual, drives=replace(virtual.drives, bearing_coulomb=friction))
