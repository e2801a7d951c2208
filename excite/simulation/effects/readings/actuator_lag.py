"""Drives that follow their command with a lag, while the log holds the command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.plant import Plant
from excite.simulation.virtual_robot import VirtualRobot

if TYPE_CHECKING:
    import mujoco


def disconnect(spec: mujoco.MjSpec) -> None:
    """Servos without force of their own: the law computes their command and delivers it."""
    for actuator in spec.actuators:
        actuator.gainprm[0] = 0.0
        actuator.biasprm[:3] = 0.0


@dataclass(frozen=True)
class LagLaw:
    """Delivered torque follows the command through one or two equal first-order filters.

    Attributes:
        time_constant: of each filter [s].
        order: 1 or 2.
    """

    time_constant: float
    order: int = 1

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        drives, base = plant.drives, plant.robot.n_base_q
        at, dof = plant.qpos[base:], plant.joint_dof
        share = -np.expm1(-float(plant.model.opt.timestep) / self.time_constant)
        states: list[Any] = [None] * self.order

        def step() -> None:
            d = plant.data
            command = drives.kp * (d.ctrl - d.qpos[at]) - drives.kd * d.qvel[dof]
            command = np.clip(command, -drives.torque_limit, drives.torque_limit)
            value = command
            for k in range(self.order):
                states[k] = value.copy() if states[k] is None else states[k] + share * (value - states[k])
                value = states[k]
            plant.command = command
            plant.torque[dof] += value

        return step


class ActuatorLag(InjectedEffect):
    """A first-order lag in all drives."""

    name = "actuator_lag"
    what = "drives that follow their command with a lag"
    unit = "s"
    lower, upper = 1e-4, 0.2

    def locations(self, virtual: VirtualRobot) -> tuple[str, ...]:
        measured = virtual.robot.description.sensors.joint_torque is not None
        return ("torque",) if measured and not virtual.robot.floating else ()

    def default(self, virtual: VirtualRobot, location: str) -> float:
        return 0.3 * float(np.min(virtual.drives.kd / virtual.drives.kp))

    def apply(self, virtual: VirtualRobot, location: str, value: float) -> VirtualRobot:
        return virtual.with_change(disconnect).with_law(LagLaw(value))
