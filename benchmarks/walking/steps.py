"""A G1 that walks over random footprints, and what can be wrong with it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.walking.servos import POLICY_HZ, Case, Fault
from excite.arrays import Array
from excite.motion.generators.walking import Walking
from excite.motion.motion import Motion, interpolate_motion
from excite.robot.robot import Robot
from excite.safety.checks.joints import drive_torques
from excite.safety.checks.sweep import Sweep
from excite.safety.filter import filter_candidate

_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")


def draw_case(kind: int, rng: np.random.Generator) -> Case:
    """A fault of random place and size; ``kind`` counts through the effects."""
    sides, part = rng.permutation(["left", "right"]), str(rng.choice([*_LEG, *_ARM[:2], "elbow"]))
    joint, arm = f"{sides[0]}_{part}_joint", str(rng.choice(_ARM))
    bends = f"{sides[0]}_{rng.choice(['hip_pitch', 'knee'])}_joint"
    swings = f"{sides[0]}_shoulder_pitch_joint"
    far, axis, sign = rng.uniform(0.0, 1.0), rng.standard_normal(3), float(rng.choice([-1, 1]))
    strong = 1.0 if part in _LEG else 0.25
    drawn = (
        (joint, "torque_gain", Fault(joint, strength=0.85 - 0.2 * far)),
        (joint, "servo_gain", Fault(joint, stiffness=0.85 - 0.2 * far)),
        (joint, "command_delay", Fault(joint, late_s=0.010 + 0.015 * far)),
        (joint, "encoder_offset", Fault(joint, zero=(0.03 + 0.03 * far) * sign)),
        (joint, "coulomb_friction", Fault(joint, dry=strong * (2.0 + 2.0 * far))),
        (joint, "viscous_friction", Fault(joint, viscous=strong * (2.0 + 2.0 * far))),
        ("command", "command_delay", Fault(late_s=0.010 + 0.010 * far)),
        ("command", "command_jitter", Fault(jitter_s=0.003 + 0.003 * far)),
        (joint, "servo_damping", Fault(joint, damping=1.4 + 0.6 * far)),
        (joint, "command_offset", Fault(joint, ahead=(0.03 + 0.03 * far) * sign)),
        (bends, "command_scale", Fault(bends, scale=0.85 - 0.15 * far)),
        (swings, "torque_saturation", Fault(swings, limit=3.0 - far)),
        ("imu", "imu_mounting", Fault(turned=tuple((0.05 + 0.08 * far) * axis / np.linalg.norm(axis)))),
        ("imu", "imu_delay", Fault(imu_late_s=0.010 + 0.010 * far)),
        (f"{sides[0]}_foot", "foot_slip", Fault(f"{sides[0]}_foot", slippery=0.25 - 0.1 * far)),
        (arm, "joint_order", Fault(f"{sides[0]}_{arm}_joint", swapped=f"{sides[1]}_{arm}_joint")),
    )
    place, effect, fault = drawn[kind % len(drawn)]
    # Of two feet that carry together either may be the one that slips.
    other = {"joint_order": fault.swapped, "foot_slip": "feet"}.get(effect)
    places = (fault.place or place, *([other] if other else []))
    return Case(fault, (effect, "command_delay")[: 1 + (effect == "command_jitter")], places)


class Steps:
    """A planned walk, out and back again and again, whose commands are ahead by what the servos give way.

    So has a policy learned to.
    """

    feet: tuple[str, ...] = ("left_ankle_roll_link", "right_ankle_roll_link")
    friction, lowest = 0.7, 0.5

    def __init__(self, robot: Robot, seconds: float, rng: np.random.Generator):
        self.robot = robot
        legs = np.array([not any(word in name for word in (*_ARM, "wrist")) for name in robot.joint_names])
        self.kp, self.kd = np.where(legs, 300.0, 40.0), np.where(legs, 6.0, 1.5)
        walks: list[Motion] = []
        while sum(one.duration for one in walks) < seconds:
            walks.append(_plan_walk(robot, int(rng.integers(2**31))))
        parts = [self._open_loop(one) for one in walks]
        self._posture, self._ahead = (np.concatenate(part) for part in zip(*parts, strict=True))
        ankles = [f"{side}_ankle_{axis}_joint" for side in ("left", "right") for axis in ("roll", "pitch")]
        self._ankles = [robot.joint_names.index(name) for name in ankles]
        self.ticks = min(len(self._posture), round(seconds * POLICY_HZ))
        self.start = walks[0].q[0][[0, 1, 2, 6, 3, 4, 5, *range(7, robot.model.nq)]]

    def _open_loop(self, motion: Motion) -> tuple[Array, Array]:
        """Configurations in the middle of ticks, and how far ahead of them commands are."""
        time = motion.time[0] + np.arange(0.5 / POLICY_HZ, motion.duration, 1.0 / POLICY_HZ)
        sweep = Sweep(self.robot, motion)
        at = sweep.fine.time[sweep.torque_samples]
        torque = np.column_stack([np.interp(time, at, column) for column in drive_torques(sweep).T])
        there = interpolate_motion(motion, self.robot, time)
        return there.q, (torque + self.kd * there.joint_velocities()) / self.kp

    def command(self, tick: int, turned: Array, spin: Array, told: Array) -> Array:
        """Positions of a tick; ankles push the trunk back to where it should be upright."""
        planned = Rotation.from_quat(self._posture[tick, 3:7])
        tilt = (planned.inv() * Rotation.from_matrix(turned)).as_rotvec()
        asked: Array = self._posture[tick, 7:] + self._ahead[tick]
        asked[self._ankles] += 0.5 * tilt[[0, 1, 0, 1]]
        return asked


@lru_cache(maxsize=8)
def _plan_walk(robot: Robot, seed: int) -> Motion:
    for number in range(20):
        made = filter_candidate(robot, Walking().draw(robot, seed + number, (), f"walk_{number}"))
        if made.motion is not None:
            return made.motion
    raise RuntimeError("no walk is safe")
