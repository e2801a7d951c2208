"""Small motions for the tests, made with pinocchio alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.logs.log import Log
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.simulation.replay import Replay, watched_run
from excite.simulation.simulate import run_experiment
from excite.simulation.virtual_robot import VirtualRobot, nominal_robot

RATE_HZ = 200.0


def _window(time: Array, duration: float) -> Array:
    """Rises and falls smoothly over 0.5 s at both ends."""
    s = np.clip(np.minimum(time, duration - time) / 0.5, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def _differentiated(robot: Robot, name: str, time: Array, q: Array) -> Motion:
    """Velocities and accelerations by central differences."""
    model, h = robot.model, time[1] - time[0]
    v, a = np.zeros((len(q), model.nv)), np.zeros((len(q), model.nv))
    for i in range(1, len(q) - 1):
        ahead, behind = pin.difference(model, q[i], q[i + 1]), pin.difference(model, q[i], q[i - 1])
        v[i], a[i] = (ahead - behind) / (2 * h), (ahead + behind) / h**2
    contacts = {foot.name: np.ones(len(q), dtype=bool) for foot in robot.feet}
    return Motion(name, robot.name, robot.joint_names, time, q, v, a, contacts)


def standing(robot: Robot, duration: float = 1.0) -> Motion:
    """Rest."""
    time = np.arange(round(duration * RATE_HZ) + 1) / RATE_HZ
    return _differentiated(robot, "standing", time, np.tile(robot.rest, (len(time), 1)))


def waving(
    robot: Robot, joints: dict[str, float], duration: float = 3.0, hz: float = 0.5, name: str = "waving"
) -> Motion:
    """Sinusoids of given amplitudes [rad] about rest on some joints, the others still."""
    time = np.arange(round(duration * RATE_HZ) + 1) / RATE_HZ
    q = np.tile(robot.rest, (len(time), 1))
    for number, (joint, amplitude) in enumerate(sorted(joints.items())):
        column = robot.n_base_q + robot.joint_index(joint)
        q[:, column] += amplitude * _window(time, duration) * np.sin(2 * np.pi * hz * time + 0.7 * number)
    return _differentiated(robot, name, time, q)


def squatting(robot: Robot, depth: float = 0.08, duration: float = 3.0, name: str = "squatting") -> Motion:
    """G1 bends hips, knees and ankles, feet flat, mass above them, and leans and turns its trunk."""
    time = np.arange(round(duration * RATE_HZ) + 1) / RATE_HZ
    window = _window(time, duration)
    model, data = robot.model, robot.model.createData()
    pin.forwardKinematics(model, data, robot.rest)
    targets = {foot.joint: data.oMi[foot.joint].copy() for foot in robot.feet}
    q, current = [], robot.rest.copy()
    for i, t in enumerate(time):
        base = robot.rest[:3] + window[i] * np.array(
            [0.0, 0.02 * np.sin(np.pi * t), -depth * (0.5 - 0.5 * np.cos(2 * np.pi * t / 1.5))]
        )
        turn = window[i] * np.array([0.05 * np.sin(4 * t), 0.05 * np.sin(3 * t), 0.1 * np.sin(2 * t)])
        current = current.copy()
        current[:3], current[3:7] = base, pin.Quaternion(pin.exp3(turn)).coeffs()
        for _ in range(20):
            if _leg_step(model, data, current, targets) < 1e-10:
                break
            current = pin.integrate(model, current, _step(model, data, current, targets))
        q.append(current)
    return _differentiated(robot, name, time, np.array(q))


def _errors(model: pin.Model, data: pin.Data, q: Array, targets: dict[int, pin.SE3]) -> Array:
    pin.computeJointJacobians(model, data, q)
    return np.concatenate([pin.log6(data.oMi[joint].actInv(pose)).vector for joint, pose in targets.items()])


def _leg_step(model: pin.Model, data: pin.Data, q: Array, targets: dict[int, pin.SE3]) -> float:
    return float(np.abs(_errors(model, data, q, targets)).max())


def _step(model: pin.Model, data: pin.Data, q: Array, targets: dict[int, pin.SE3]) -> Array:
    error = _errors(model, data, q, targets)
    jacobian = np.vstack([pin.getJointJacobian(model, data, joint, pin.LOCAL) for joint in targets])[:, 6:]
    legs = np.flatnonzero(np.abs(jacobian).sum(axis=0) > 0.0)
    step = np.zeros(model.nv)
    step[6 + legs] = np.linalg.lstsq(jacobian[:, legs], error, rcond=None)[0]
    return step


def generator(seed: int) -> np.random.Generator:
    """A random generator."""
    return np.random.default_rng(seed)


def replay_motion(
    subject: Robot | VirtualRobot, motion: Motion, *, mass_error: float = 0.0, friction_error: float = 0.0
) -> Replay:
    """Run a motion once, with contacts between the robot's own parts, and say what became of it.

    Args:
        subject: a robot (then the model itself is simulated) or a virtual robot.
        motion: the motion.
        mass_error: relative change of the mass and inertia of all segments, 0.1 for a tenth more.
        friction_error: relative change of the soles' friction, -0.3 for a floor a third more slippery.

    Returns:
        What happened.

    Raises:
        MotionError: the motion is not for this robot, or the simulation diverged.
    """
    virtual = nominal_robot(subject) if isinstance(subject, Robot) else subject
    virtual = replace(
        virtual,
        truth=replace(virtual.truth, phi=(1.0 + mass_error) * virtual.truth.phi),
        world=replace(virtual.world, sole_friction=virtual.world.sole_friction * (1.0 + friction_error)),
    )
    return watched_run(virtual, motion, forces=False).replay


def simulate(virtual: VirtualRobot, motions: Sequence[Motion], **options: Any) -> Log:
    """The log of :func:`~excite.simulation.simulate.run_experiment`, same arguments and errors."""
    return run_experiment(virtual, motions, **options).log
