"""The drives of a virtual robot: servo gains, torque limits, friction and rotor inertia of every joint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot

_BEARING_SHARE = 0.25


@dataclass(frozen=True, eq=False)
class Drives:
    """What moves the joints; each array ``(n_joints,)`` in the order of ``Robot.joint_names``.

    Attributes:
        kp: position gain of the servo [N·m/rad or N/m].
        kd: velocity gain of the servo [N·m·s/rad or N·s/m].
        torque_limit: at which the servo's torque is clipped [N·m or N].
        viscous: viscous friction of motor and gears, which a link-side sensor does not see
            [N·m·s/rad or N·s/m].
        coulomb: Coulomb friction of motor and gears [N·m or N].
        bearing_viscous: viscous friction of the output bearing, which every torque sensor sees.
        bearing_coulomb: Coulomb friction of the output bearing.
        armature: rotor inertia as felt at the joint [kg·m² or kg].
        rate_hz: rate at which the servo takes new commands; the drive interpolates between them [Hz].
    """

    kp: Array
    kd: Array
    torque_limit: Array
    viscous: Array
    coulomb: Array
    bearing_viscous: Array
    bearing_coulomb: Array
    armature: Array
    rate_hz: float

    @property
    def total_viscous(self) -> Array:
        """Viscous friction of gears and bearing together, ``(n_joints,)``."""
        return self.viscous + self.bearing_viscous

    @property
    def total_coulomb(self) -> Array:
        """Coulomb friction of gears and bearing together, ``(n_joints,)``."""
        return self.coulomb + self.bearing_coulomb


def nominal_drives(robot: Robot) -> Drives:
    """The drives that ``robot.yaml`` declares; friction and armature that it leaves out are zero."""
    description, names = robot.description, robot.joint_names
    zero, missing = np.zeros(len(names)), np.full(len(names), np.nan)
    return Drives(
        kp=per_joint(description.controller.kp, names, missing),
        kd=per_joint(description.controller.kd, names, missing),
        torque_limit=robot.limits.torque.copy(),
        viscous=per_joint(description.drives.viscous, names, zero),
        coulomb=per_joint(description.drives.coulomb, names, zero),
        bearing_viscous=zero.copy(),
        bearing_coulomb=zero.copy(),
        armature=per_joint(description.drives.armature, names, zero),
        rate_hz=description.controller.rate_hz,
    )


def scattered_drives(robot: Robot, rng: np.random.Generator, *, spread: float = 0.3) -> Drives:
    """Drives whose friction differs from the declared one, as no two gearboxes are alike.

    Viscous and Coulomb friction are multiplied by log-normal factors. Where ``robot.yaml`` declares no
    friction of a kind, the truth gets one all the same: 0.5 % (viscous, at 1 rad/s) or 1 % (Coulomb) of the
    torque limit. The output bearing, which no ``robot.yaml`` declares, has a quarter of the gears' friction.

    Args:
        robot: the robot.
        rng: source of the factors.
        spread: standard deviation of the factors' logarithm.

    Returns:
        The drives; gains, limits and armature are the declared ones.
    """
    nominal = nominal_drives(robot)
    viscous = nominal.viscous if nominal.viscous.any() else 0.005 * nominal.torque_limit
    coulomb = nominal.coulomb if nominal.coulomb.any() else 0.01 * nominal.torque_limit
    factors = np.exp(spread * rng.standard_normal((2, robot.n_joints)))
    viscous, coulomb = viscous * factors[0], coulomb * factors[1]
    viscous, coulomb = (np.where(robot.passive, 0.0, values) for values in (viscous, coulomb))
    return replace(
        nominal,
        viscous=viscous,
        coulomb=coulomb,
        bearing_viscous=_BEARING_SHARE * viscous,
        bearing_coulomb=_BEARING_SHARE * coulomb,
    )
