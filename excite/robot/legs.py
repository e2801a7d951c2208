"""Legs: the torques that hold a standing robot, upright postures and ankles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot

# Where on its sole a foot holds a load without asking too much of its ankle.

# Share of what motions may use of an ankle's torque that a load at rest asks of it at most: beside it the zero-moment
# point moves. Of six leg swings each of an AzureLoong and an EngineAI SA01 all are safe with 0.5, none with 0.8 or over
# the middle of the sole; G1, HRP-2 and Talos stand over that with less.
EASY = 0.5


class Ankle:
    """The joints between a leg's knee and its foot.

    Args:
        robot: whose leg it is.
        end: joint that carries the foot.
        middle: of the foot, in that joint's frame ``(3,)`` [m].
    """

    def __init__(self, robot: Robot, end: int, middle: Array) -> None:
        # Joints that others' motors drive have no torque of their own.
        self._joints = _beyond_knee(robot, end, middle) if robot.mechanism is None else []
        self._axes = [robot.model.joints[joint].createData().S[3:].ravel() for joint in self._joints]
        self._torques = [
            float(robot.limits.torque[robot.joint_index(robot.model.names[joint])]) for joint in self._joints
        ]

    def ease_point(self, placements: Sequence[pin.SE3], point: Array, load: float) -> Array:
        """The way from a point to the nearest at which a load strains no joint of the ankle by more than :data:`EASY`.

        Seen from above, a load W at a point p asks ``(ẑ × a)·(p − o) W`` of a joint about the axis a through o.

        Args:
            placements: pinocchio's of the robot's joints, the ground level (``data.oMi``).
            point: seen from above, in the same frame ``(2,)`` [m].
            load: that the foot carries [N].

        Returns:
            ``(2,)`` [m]: zero of ankles that are strong enough, and of what is no leg.
        """
        shift = np.zeros(2)
        for joint, own, torque in zip(self._joints, self._axes, self._torques, strict=True):
            place = placements[joint]
            axis = place.rotation @ own
            lever = np.array([-axis[1], axis[0]])
            level = float(np.linalg.norm(lever))
            if level == 0.0:  # it turns the sole and carries none of the load
                continue
            along = lever / level
            reach = EASY * TORQUE_SHARE * torque / (load * level)
            ahead = float((point - place.translation[:2]) @ along)
            shift += (np.clip(ahead, -reach, reach) - ahead) * along
        return shift


def before_knee(sizes: Array) -> int:
    """Which part of a leg is the thigh, of the sizes of its parts from joint to joint to foot: of the two longest in a
    row the first."""
    return int(np.argmax(sizes[:-1] + sizes[1:]))


def _beyond_knee(robot: Robot, end: int, middle: Array) -> list[int]:
    chain = list(robot.model.supports[end])[1 + robot.floating :]
    parts = [*(robot.model.jointPlacements[j].translation for j in chain[1:]), middle]
    return chain[before_knee(np.linalg.norm(parts, axis=1)) + 2 :] if len(parts) > 1 else []


# What it takes to hold a robot still: torques of gravity on the joints that no contact relieves.

# Share of the torque limit that motions use, so that the verdict finds a margin.
TORQUE_SHARE = 0.85


def usable_torque(robot: Robot, share: Array, speed: Array, limit: Array | None = None) -> Array:
    """Torque that is left to gravity and inertia beside friction, in the shape of the limit [N·m or N].

    Args:
        robot: its limits and its drives' friction.
        share: of the torque limit that may be used, ``(n_joints,)``.
        speed: at which viscous friction counts, ``(n_joints,)`` [rad/s or m/s].
        limit: ``(…, n_joints)``, the robot's stated ones where it is None.
    """
    drives, nothing = robot.description.drives, np.zeros(robot.n_joints)
    viscous = per_joint(drives.viscous, robot.joint_names, nothing)
    coulomb = per_joint(drives.coulomb, robot.joint_names, nothing)
    limit = robot.limits.torque if limit is None else limit
    # However much friction a drive has, this share of its limit is left to motions: friction that the URDF states is
    # often a simulator's damping, at full speed more than the drive can give.
    return np.asarray(np.maximum(share * limit - coulomb - viscous * speed, 0.3 * limit))


def holding_torques(robot: Robot, joints: Array, data: pin.Data | None = None) -> Array:
    """Torques that hold a robot still in postures ``(n, n_joints)``, its base at rest, ``(n, n_joints)`` [N·m or N].

    Zero for joints between a floating base and a foot: theirs depend on how the contacts share the load.

    Args:
        data: pinocchio's room for its model, where that is at hand: of a G1, making it takes as long as 80 postures.
    """
    q = np.tile(robot.rest, (len(joints), 1))
    q[:, robot.n_base_q :] = joints
    data = robot.model.createData() if data is None else data
    tau = np.array([pin.computeGeneralizedGravity(robot.model, data, row).copy() for row in q])
    tau = robot.on_motors(q, tau.reshape(len(q), robot.model.nv))
    tau[:, _carrying_velocities(robot)] = 0.0
    return np.asarray(tau.reshape(len(joints), robot.model.nv)[:, robot.n_base_v :])


@lru_cache(maxsize=4)
def _carrying_velocities(robot: Robot) -> list[int]:
    """Velocities of the joints between a floating base and a foot, and of motors that move these."""
    columns: list[int] = []
    for foot in robot.feet if robot.floating else ():
        carrying = list(robot.model.supports[foot.joint])[1:]
        of_foot = [robot.model.idx_vs[joint] for joint in carrying if robot.model.nvs[joint] == 1]
        if robot.mechanism is not None:
            moves = robot.mechanism.motion_maps(robot.rest[None])[0][of_foot]
            of_foot += list(robot.mechanism.driven[np.abs(moves).max(axis=0) > 0.0])
        columns += of_foot
    return columns


# How stiff legs have to be for a robot to stand on them with nothing but servos of its joints.

# How many times stiffer than what topples the robot a leg's joint should be: what leans by one part leans by a
# twentieth more. Of 10 leg swings of a 67 kg humanoid (H1_2) 5, 7 and 8 stand in simulation with 5, 9 and 19 at the
# ankles; of 10 of a G1 with 15 % of its mass on its back 0, 2, 7, 7 and 8 stand with 2, 4, 9, 18 and 37.
UPRIGHT = 20.0


def toppling_stiffness(robot: Robot, ends: Iterable[int], mass: float) -> dict[int, float]:
    """What topples a robot that stands on a leg: its weight times the distance of its centre of mass from a joint.

    Args:
        robot: the robot, as it stands in ``robot.rest``.
        ends: the joints at the ends of its legs, of ``robot.model``.
        mass: of the robot [kg]; what of it no segment has is at the base's origin, where that is fixed.

    Returns:
        By the index of each joint of the legs [N·m/rad].
    """
    data = robot.model.createData()
    centre = pin.centerOfMass(robot.model, data, robot.rest)
    if not robot.floating:
        centre = centre * (robot.mass / mass)
    weight = mass * float(np.linalg.norm(robot.description.gravity))
    found = {}
    for end in ends:
        for joint in list(robot.model.supports[end])[1 + robot.floating :]:
            found[joint] = weight * float(np.linalg.norm(centre - data.oMi[joint].translation))
    return found


def too_soft_to_stand(robot: Robot) -> str | None:
    """What is to be said of the softest joint of a leg on a sole, where it is too soft to stand on; else None."""
    missing: Array = np.full(robot.n_joints, np.nan)
    stiffness = per_joint(robot.description.controller.kp, robot.joint_names, missing)
    topples = toppling_stiffness(robot, (foot.joint for foot in robot.feet if foot.flat), robot.mass)
    names = {joint: robot.model.names[joint] for joint in topples}
    has = {joint: float(stiffness[robot.joint_index(name)]) for joint, name in names.items()}
    known = [joint for joint in topples if np.isfinite(has[joint])]
    softest = min(known, key=lambda joint: has[joint] / topples[joint], default=None)
    if softest is None or has[softest] >= (0.5 * UPRIGHT) * topples[softest]:
        return None
    return (
        f"{names[softest]} has {has[softest]:.3g} N·m/rad (controller.kp) where {topples[softest]:.3g} topple the "
        f"robot: without feedback of balance it needs some {UPRIGHT:g} times those"
    )
