"""What happened in a simulated run, exactly, before any sensor looks at it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples of a run at the sensors' rate, in pinocchio's conventions, without noise.

    Attributes:
        name: name of the motion.
        time: ``(n,)`` [s], from the start of the motion.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations that the positions really follow.
        q_cmd: ``(n, n_joints)`` commanded joint positions.
        tau_motor: ``(n, n_joints)`` torque of the motors as delivered [N·m or N]. Viscous friction and the
            servo's damping act with the velocity at the end of the integration step.
        tau_link: ``(n, n_joints)`` torque that reaches the link: motor less friction of motor and
            gears and less what turns the rotor.
        clipped: ``(n, n_joints)`` which drives were asked for more than they give.
        contacts: by foot name, ``(n, 6)``: force, and moment about the world's origin, that the ground exerts
            on the foot, in the world frame; empty where forces were not recorded.
        wrenches: by sensor name, ``(n, 6)``: wrench on the robot through the sensor, in the sensor's frame; empty
            likewise.
        touches: ``(n,)`` number of contacts other than soles on the ground.
    """

    name: str
    time: Array
    q: Array
    v: Array
    a: Array
    q_cmd: Array
    tau_motor: Array
    tau_link: Array
    clipped: NDArray[np.bool_]
    contacts: Mapping[str, Array]
    wrenches: Mapping[str, Array]
    touches: Array
