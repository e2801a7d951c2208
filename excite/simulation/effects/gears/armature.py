"""Rotor inertia that the model lacks."""

from __future__ import annotations

from dataclasses import replace

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.virtual_robot import VirtualRobot


class Armature(InjectedEffect):
    """A heavier rotor behind the gear."""

    name = "armature"
    what = "more rotor inertia, as felt at the joint"
    unit = "kg·m²"
    lower, upper = 0.0, 1e3

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        return virtual.robot.joint_names

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.005 * float(virtual.drives.torque_limit[virtual.robot.joint_index(location)])

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        armature = virtual.drives.armature.copy()
        armature[virtual.robot.joint_index(location)] += value
        return replace(virtual, drives=replace(virtual.drives, armature=armature))
