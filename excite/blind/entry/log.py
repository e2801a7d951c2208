"""The log of a blind case as the plain entries take it: an arm with a torque of every joint."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.files import load_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class ArmLog:
    """A log and its nominal robot.

    Attributes:
        log: the log.
        robot: the nominal robot, its joints in the log's order.
    """

    log: Log
    robot: Robot

    @property
    def modelled(self) -> tuple[str, ...]:
        """What the log calls modelled."""
        return tuple(self.log.header.modelled)

    @property
    def fixed(self) -> bool:
        """Whether inertial parameters are given."""
        return "rigid_body_fixed" in self.modelled

    def torque(self, trial: Trial) -> Array:
        """Torques of a trial ``(n, n_joints)`` [N·m]; raises LogError where it has none."""
        if trial.tau is None:
            raise LogError("has no torques", source=trial.name, remedy="log tau.* of every joint")
        return trial.tau

    def given(self, q: Array, v: Array, a: Array) -> Array:
        """Torques of the nominal bodies ``(n, n_joints)`` [N·m]."""
        return inverse_dynamics(self.robot.model, q, v, a)


def arm_log(folder: Path) -> ArmLog:
    """Read a case.

    Args:
        folder: of the log.

    Raises:
        LogError: it is no log, or none of an arm with a torque of every joint.
    """
    log = load_log(folder)
    robot = nominal_robot(log)
    measured = log.header.torque in {"motor_side", "link_side"}
    if robot.floating or not measured or tuple(log.header.torque_joints) != tuple(robot.joint_names):
        remedy = "this entry takes arms with a torque of every joint"
        raise LogError("is no log of such an arm", source=folder, field="torque", remedy=remedy)
    return ArmLog(log, robot)
