"""Motions made from scratch, without the package's generators, for the tests of the checks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.interpolate import make_interp_spline

from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.robot import Foot, Robot
from excite.safety.check import check_motion
from excite.safety.verdict import Verdict

RATE_HZ = 200.0


def moved_base(motion: Motion, offset: np.ndarray) -> Motion:
    """The motion with the base shifted by ``(n, 3)`` [m] in the world; joints as they were, base level."""
    path = make_interp_spline(motion.time, offset, k=5)
    q, v, a = motion.q.copy(), motion.v.copy(), motion.a.copy()
    q[:, :3] += offset
    v[:, :3] += path(motion.time, 1)
    a[:, :3] += path(motion.time, 2)
    return replace(motion, q=q, v=v, a=a)


def moved_joint(robot: Robot, motion: Motion, joint: str, offset: np.ndarray) -> Motion:
    """The motion with an offset ``(n,)`` [rad] added to one joint, v and a with it."""
    path = make_interp_spline(motion.time, offset, k=5)
    column = robot.joint_index(joint)
    q, v, a = motion.q.copy(), motion.v.copy(), motion.a.copy()
    q[:, robot.n_base_q + column] += offset
    v[:, robot.n_base_v + column] += path(motion.time, 1)
    a[:, robot.n_base_v + column] += path(motion.time, 2)
    return replace(motion, q=q, v=v, a=a)


def smooth(phase: np.ndarray) -> np.ndarray:
    """A step from 0 to 1 with three vanishing derivatives at both ends."""
    s = np.clip(phase, 0.0, 1.0)
    return s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)


def joint_motion(
    robot: Robot, time: np.ndarray, joints: np.ndarray, base: np.ndarray | None = None
) -> Motion:
    """A motion through joint positions ``(n, n_joints)`` and base positions ``(n, 3)``, base kept level.

    Velocities and accelerations are those of a quintic spline through the positions.
    """
    spline = make_interp_spline(time, joints, k=5)
    q, v, a = joints, spline(time, 1), spline(time, 2)
    contacts = {foot.name: np.ones(len(time), dtype=bool) for foot in robot.feet}
    if base is not None:
        path = make_interp_spline(time, base, k=5)
        still, level = np.zeros((len(time), 3)), np.tile(robot.rest[3:7], (len(time), 1))
        q = np.hstack([base, level, q])
        v, a = np.hstack([path(time, 1), still, v]), np.hstack([path(time, 2), still, a])
    return Motion("made", robot.name, robot.joint_names, time, q, v, a, contacts)


def arm_motion(robot: Robot, duration: float = 2.0, amplitude: float = 0.03) -> Motion:
    """Every joint of an arm swings about its rest posture and comes back."""
    time = np.linspace(0.0, duration, round(duration * RATE_HZ) + 1)
    window = smooth(4.0 * time / duration) * smooth(4.0 * (1.0 - time / duration))
    frequency = 1.0 + 0.2 * np.arange(robot.n_joints)
    swing = amplitude * window[:, None] * np.sin(2.0 * np.pi * frequency * time[:, None])
    return joint_motion(robot, time, robot.rest + swing)


def standing_motion(
    robot: Robot, pelvis: np.ndarray, arms: dict[str, np.ndarray] | None = None, rate_hz: float = RATE_HZ
) -> Motion:
    """The pelvis follows offsets ``(n, 3)`` [m] from rest, both soles stay where they are at rest.

    Args:
        robot: a humanoid.
        pelvis: offsets at ``rate_hz``.
        arms: offsets of joints from rest by name, ``(n,)`` [rad].
        rate_hz: sampling rate.
    """
    time = np.arange(len(pelvis)) / rate_hz
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.rest)
    goals = [data.oMi[foot.joint].copy() for foot in robot.feet]
    q, rows = robot.rest.copy(), []
    for k in range(len(time)):
        q[:3] = robot.rest[:3] + pelvis[k]
        for name, offsets in (arms or {}).items():
            q[7 + robot.joint_index(name)] = robot.rest[7 + robot.joint_index(name)] + offsets[k]
        for foot, goal in zip(robot.feet, goals, strict=True):
            q = _reach(robot, data, q, foot, goal)
        rows.append(q.copy())
    rows = np.array(rows)
    return joint_motion(robot, time, rows[:, 7:], rows[:, :3])


def _reach(robot: Robot, data: pin.Data, q: np.ndarray, foot: Foot, goal: pin.SE3) -> np.ndarray:
    columns = [robot.model.idx_vs[j] for j in list(robot.model.supports[foot.joint])[2:]]
    columns = columns[-6:]
    for _ in range(20):
        jacobian = pin.computeJointJacobian(robot.model, data, q, foot.joint)[:, columns]
        pin.forwardKinematics(robot.model, data, q)
        error = pin.log6(data.oMi[foot.joint].inverse() * goal).vector
        if np.linalg.norm(error) < 1e-12:
            break
        step = np.zeros(robot.model.nv)
        step[columns] = np.linalg.solve(jacobian, error)
        q = pin.integrate(robot.model, q, step)
    return q


def squat(robot: Robot, depth: float = 0.08, sway: float = 0.03, duration: float = 3.0) -> Motion:
    """One squat with a sideways sway and an arm that swings, at rest at both ends."""
    time = np.arange(round(duration * RATE_HZ) + 1) / RATE_HZ
    shape = smooth(2.0 * time / duration) * smooth(2.0 * (1.0 - time / duration))
    side = sway * shape * np.sin(2.0 * np.pi * time / duration)
    pelvis = np.column_stack([0.0 * shape, side, -depth * shape])
    return standing_motion(robot, pelvis, {"right_elbow_joint": 0.3 * shape})


def check_file(robot: Robot, path: Path, *, rate_hz: float | None = None) -> Verdict:
    """Load a motion file and judge it; the verdict's ``motion`` is the path as given.

    Raises:
        MotionError: the file cannot be read, or is no motion of this robot.
        InputError: ``rate_hz`` is not positive.
        RobotError: the robot's collision geometry cannot be read.
    """
    return check_motion(robot, load_motion(path, robot).renamed(str(path)), rate_hz=rate_hz)
