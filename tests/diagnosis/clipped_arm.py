"""Arms simulated by pinocchio alone, their torques cut off by what measures them or by drives that give no more."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.logs.files import load_log, save_log
from excite.logs.log import Log, LogHeader, Trial
from excite.robot.loading import load_robot

RATE_HZ, SECONDS, STEPS = 200, 10, 5
MASS, SEEDS = 2.0, (1, 2, 3)


def clipped_log(
    folder: Path, name: str, joint: int, share: float, *, payload: bool = False, limit: float | None = None
) -> Log:
    """A log of a servo-driven arm.

    Args:
        folder: that it is written to.
        name: a bundled robot.
        joint: whose torque is cut off.
        share: of its samples that are beyond the range of what measures it.
        payload: whether it carries :data:`MASS` that its model has not.
        limit: what the joint's drive gives at most, in units of what holding the arm asks for.
    """
    robot = load_robot(name)
    trials = [_trial(robot, k, joint, payload, limit) for k in SEEDS]
    if share:
        most = np.quantile(np.abs(np.concatenate([t.tau[:, joint] for t in trials])), 1.0 - share)
        for trial in trials:
            trial.tau[:, joint] = np.clip(trial.tau[:, joint], -most, most)
    bodies = "rigid_body_fixed" if payload else "rigid_body"
    header = {
        "schema": "excite.log/1",
        "robot": "robot.urdf",
        "base": "fixed",
        "rate_hz": RATE_HZ,
        "joints": list(robot.joint_names),
        "torque": "motor_side",
        "modelled": [bodies, "viscous_friction", "coulomb_friction", "armature"],
        "trials": [{"file": f"{t.name}.parquet", "role": t.role} for t in trials],
    }
    log = Log(LogHeader.model_validate(header), tuple(trials), robot_text=robot.urdf)
    return load_log(save_log(log, folder))


def _trial(robot, seed: int, joint: int, payload: bool, limit: float | None) -> Trial:
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
    if payload:
        model.inertias[n] += pin.Inertia(MASS, np.array([0.02, 0.05, 0.12]), 0.008 * np.eye(3))
    data, step = model.createData(), 1.0 / (RATE_HZ * STEPS)
    t = step * np.arange(SECONDS * RATE_HZ * STEPS)
    asked, speed, push = _motion(t, middle, span, seed)
    heavy = np.diag(pin.crba(model, data, middle))
    kp, kd = heavy * (2.0 * np.pi * 6.0) ** 2, heavy * 1.8 * (2.0 * np.pi * 6.0)
    most = np.full(n, np.inf)
    if limit is not None:
        most[joint] = limit * size[joint]
    q, v, rows = asked[0].copy(), speed[0].copy(), []
    for k in range(len(t)):
        told = pin.rnea(nominal, ask, asked[k], speed[k], push[k]) + viscous * speed[k] + rotor * push[k]
        told += dry * np.tanh(speed[k] / 0.02) + kp * (asked[k] - q) + kd * (speed[k] - v)
        tau = np.clip(told, -most, most)
        if k % STEPS == 0:
            rows.append((q, tau))
        v = v + step * pin.aba(model, data, q, v, tau - viscous * v - dry * np.tanh(v / 0.02))
        q = q + step * v
    q, tau = (np.array(part) for part in zip(*rows, strict=True))
    rng = np.random.default_rng(5000 + seed)
    noise = 0.004 * size * rng.normal(size=tau.shape)
    tau = np.where(np.abs(tau) >= most, tau, tau + noise)
    role = "validation" if seed == SEEDS[-1] else "identification"
    return Trial(f"t{seed}", role, t[::STEPS], q, tau, q_cmd=asked[::STEPS])


def _motion(t: np.ndarray, middle: np.ndarray, span: np.ndarray, seed: int) -> tuple[np.ndarray, ...]:
    """Sums of sines: positions, velocities and accelerations."""
    rng = np.random.default_rng(1000 + seed)
    hertz = np.array([0.11, 0.19, 0.33, 0.5, 0.8])
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
