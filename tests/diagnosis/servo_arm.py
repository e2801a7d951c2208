"""Arms on servos simulated by pinocchio alone: torques cut off by sensors or drives, late torques, tilts, bristles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from excite.logs.files import load_log, save_log
from excite.logs.log import Log, Trial
from excite.robot.loading import load_robot
from tests.made_log import FRICTION, made_log

RATE_HZ, SECONDS, STEPS = 200, 12, 5
MASS, SEEDS, HERTZ = 2.0, (1, 2, 3), (0.11, 0.19, 0.33, 0.5, 0.8)


@dataclass(frozen=True)
class _Machine:
    """What an arm has, and how it moves.

    Attributes:
        payload: whether it carries :data:`MASS` that its model has not.
        limit: what a joint's drive gives at most, in units of what holding the arm asks for; ``joint`` which.
        tilt: of its base about y [rad].
        breakaway: deflection over which its friction builds up [rad]; 0 for friction of the velocity.
        hertz: frequencies of its motion.
    """

    payload: bool = False
    limit: float = np.inf
    joint: int = 1
    tilt: float = 0.0
    breakaway: float = 0.0
    hertz: tuple[float, ...] = HERTZ


def clipped_log(
    folder: Path, name: str, joint: int, share: float, *, payload: bool = False, limit: float = np.inf
) -> Log:
    """A log whose torque of one joint is beyond the range of what measures it in a share of its samples."""
    return arm_log(folder, name, clipped=(joint, share), payload=payload, limit=limit, joint=joint)


def arm_log(
    folder: Path, name: str, *, clipped: tuple[int, float] = (0, 0.0), delay: float = 0.0, **machine: Any
) -> Log:
    """A log of a servo-driven arm.

    Args:
        folder: that it is written to.
        name: a bundled robot.
        clipped: a joint, and the share of its torque's samples that are cut off.
        delay: by which torques are logged late [s].
        machine: what it has, as :class:`_Machine` says.
    """
    robot, made = load_robot(name), _Machine(**machine)
    # Of several logs of one machine, each moves once; what cuts torques off has its own copy.
    trials = [replace(t, tau=t.tau.copy()) for t in (_trial(name, k, made, delay) for k in SEEDS)]
    joint, share = clipped
    if share:
        most = np.quantile(np.abs(np.concatenate([t.tau[:, joint] for t in trials])), 1.0 - share)
        for trial in trials:
            trial.tau[:, joint] = np.clip(trial.tau[:, joint], -most, most)
    bodies = "rigid_body_fixed" if made.payload else "rigid_body"
    log = made_log(trials, robot.joint_names, RATE_HZ, robot.urdf, modelled=[bodies, *FRICTION, "armature"])
    return load_log(save_log(log, folder))


@cache
def _trial(name: str, seed: int, machine: _Machine, delay: float) -> Trial:
    robot = load_robot(name)
    nominal, model, n = robot.model, robot.model.copy(), robot.n_joints
    low, high = robot.limits.position_lower, robot.limits.position_upper
    middle = np.clip(0.5 * (low + high), low + 0.3, high - 0.3)
    span = np.minimum(0.4 * (high - low), 1.2)
    still, ask = np.zeros(n), nominal.createData()
    postures = middle + span * np.random.default_rng(77).uniform(-1.0, 1.0, (60, n))
    size = np.max([np.abs(pin.rnea(nominal, ask, q, still, still)) for q in postures], axis=0)
    size = np.maximum(size, 0.05 * size.max())
    viscous, dry, rotor = 0.04 * size, 0.05 * size, 0.006 * size + 0.02
    model.armature = rotor
    model.gravity.linear = 9.81 * np.array([np.sin(machine.tilt), 0.0, -np.cos(machine.tilt)])
    if machine.payload:
        model.inertias[n] += pin.Inertia(MASS, np.array([0.02, 0.05, 0.12]), 0.008 * np.eye(3))
    data, step = model.createData(), 1.0 / (RATE_HZ * STEPS)
    t = step * np.arange(SECONDS * RATE_HZ * STEPS)
    asked, speed, push = _motion(t, middle, span, seed, machine.hertz)
    heavy = np.diag(pin.crba(model, data, middle))
    kp, kd = heavy * (2.0 * np.pi * 6.0) ** 2, heavy * 1.8 * (2.0 * np.pi * 6.0)
    most = np.where(np.arange(n) == machine.joint, machine.limit * size, np.inf)
    q, v, rows, bent = asked[0].copy(), speed[0].copy(), [], np.zeros(n)
    for k in range(len(t)):
        told = pin.rnea(nominal, ask, asked[k], speed[k], push[k]) + viscous * speed[k] + rotor * push[k]
        told += dry * np.tanh(speed[k] / 0.02) + kp * (asked[k] - q) + kd * (speed[k] - v)
        tau = np.clip(told, -most, most)
        if k % STEPS == 0:
            rows.append((q, tau))
        if machine.breakaway:
            bent += step * v / machine.breakaway * (1.0 - np.sign(v) * bent)
        rubs = bent if machine.breakaway else np.tanh(v / 0.02)
        v = v + step * pin.aba(model, data, q, v, tau - viscous * v - dry * rubs)
        q = q + step * v
    q, tau = (np.array(part) for part in zip(*rows, strict=True))
    logged = t[::STEPS]
    if delay:
        tau = np.column_stack([np.interp(logged - delay, logged, column) for column in tau.T])
    rng = np.random.default_rng(5000 + seed)
    noise = 0.004 * size * rng.normal(size=tau.shape)
    tau = np.where(np.abs(tau) >= most, tau, tau + noise)
    q = q + 2e-6 * rng.normal(size=q.shape)
    role = "validation" if seed == SEEDS[-1] else "identification"
    return Trial(f"t{seed}", role, logged, q, tau, q_cmd=asked[::STEPS])


def _motion(
    t: np.ndarray, middle: np.ndarray, span: np.ndarray, seed: int, frequencies: tuple[float, ...]
) -> tuple[np.ndarray, ...]:
    """Sums of sines: positions, velocities and accelerations."""
    rng = np.random.default_rng(1000 + seed)
    hertz = np.array(frequencies)
    q, v, a = (np.zeros((len(t), len(middle))) for _ in range(3))
    for j in range(len(middle)):
        sizes = rng.uniform(0.5, 1.0, len(hertz)) / np.arange(1, len(hertz) + 1) ** 0.7
        for amplitude, f in zip(span[j] * sizes / sizes.sum(), hertz, strict=True):
            w = 2.0 * np.pi * f * (1.0 + 0.06 * j)
            phase = w * t + rng.uniform(0.0, 2.0 * np.pi)
            q[:, j] += amplitude * np.sin(phase)
            v[:, j] += amplitude * w * np.cos(phase)
            a[:, j] -= amplitude * w**2 * np.sin(phase)
    return middle + q, v, a


def whole(log: Log) -> Log:
    """The log as if nobody had noticed that torques are cut off."""
    trials = (replace(t, cleaning=replace(t.cleaning, clipped={})) for t in log.trials)
    return replace(log, trials=tuple(trials))
