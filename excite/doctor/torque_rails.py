"""Torques at an end of their range: where they are, and whether the motion says that they were no larger."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.regressor.motor_torques import motor_regressor, motor_torques
from excite.robot.robot import Robot
from excite.rows.beyond import flags_at
from excite.rows.drive_terms import DRIVE_TERMS, JointSamples
from excite.rows.kinematics import forces_on_grid, trial_kinematics
from excite.rows.settings import ProblemSettings

# Samples that a joint's row is fitted to: some thousand tell it as well as all. Fewer than the least tell nothing.
_SAMPLES, _LEAST = 3000, 100
_TERMS = ("viscous", "coulomb", "offset", "armature")
# Coefficients are held to the nominal ones by this share of their columns' power, or two that the motion does not tell
# apart would run away where the torque is large.
_HELD = 1e-4


def kind_of_torque(log: Log) -> str:
    """First part of the names of the log's torques or currents."""
    return "i" if log.header.torque == "current" else "tau"


def at_rails(log: Log) -> Log:
    """The log with its trials' samples marked in which a torque or current is at an end of its range.

    A trial that reaches the end at which another one is clipped is at it too.
    """
    kind, rails = kind_of_torque(log), set[tuple[int, float]]()
    for trial in log.trials:
        values = _trial_torques(trial)
        for j, joint in enumerate(log.header.joints):
            count = trial.cleaning.clipped.get(f"{kind}.{joint}", 0)
            if values is None or not count:
                continue
            # The channel was found to be clipped at one end or both; at an end that it is not it stays a moment.
            ends = {
                float(end): int((values[:, j] == end).sum())
                for end in (values[:, j].min(), values[:, j].max())
            }
            rails |= {(j, end) for end, often in ends.items() if 4 * often >= count}
    return replace(log, trials=tuple(_mark_rails(trial, rails) for trial in log.trials)) if rails else log


def _mark_rails(trial: Trial, rails: set[tuple[int, float]]) -> Trial:
    values = _trial_torques(trial)
    if values is None:
        return trial
    flags = np.zeros(values.shape, dtype=np.bool_)
    for j, rail in rails:
        flags[:, j] |= values[:, j] == rail
    return replace(trial, beyond=flags) if flags.any() else trial


def _trial_torques(trial: Trial) -> Array | None:
    return trial.tau if trial.tau is not None else trial.current


def torque_overshoot(robot: Robot, log: Log, joint: str) -> float | None:
    """How far beyond its rail a joint's torque should be by the motion, in deviations of what is left elsewhere.

    A drive at its limit gives no more than it says, and the motion is what that torque makes of it; a sensor or an
    estimate at the end of its range says less than there is. The joint's own row of the equations, with its bodies,
    friction and rotor, is fitted where the torque is within its range and predicts the rest.

    Args:
        robot: the nominal model.
        log: the log, its trials marked.
        joint: one of its joints that has a torque.

    Returns:
        Mean over the samples at the rail; None where the log does not tell.
    """
    robot, settings = robot_in_log(robot, log.header, log.folder), ProblemSettings()
    filters = settings.filters(floating=False)
    column, place = log.header.joints.index(joint), robot.n_base_v + robot.joint_index(joint)
    rows, rests, marked, torques = [], [], [], []
    for trial in log.trials:
        values = _trial_torques(trial)
        try:
            k = trial_kinematics(robot, log.header, trial, settings, filters)
        except LogError:
            continue
        if values is None:
            continue
        here = np.flatnonzero(k.in_motion)
        here = here[:: max(1, len(log.trials) * len(here) // _SAMPLES)]
        q, v, a = k.q[here], k.v[here], k.a[here]
        samples = JointSamples(robot, q, v, a, [place], settings.coulomb_width, None)
        drives = np.concatenate([DRIVE_TERMS[term].columns(samples) for term in _TERMS], axis=2)[:, 0]
        rows.append(np.hstack([motor_regressor(robot, q, v, a)[:, place], drives]))
        torque = forces_on_grid(trial.time, values[:, [column]], k.time)[here, 0]
        torques.append(torque)
        rests.append(torque - motor_torques(robot, q, v, a)[:, place])
        flags = np.zeros_like(values, dtype=np.bool_) if trial.beyond is None else trial.beyond
        marked.append(flags_at(trial.time, flags[:, [column]], k.time)[here, 0])
    if not rows:
        return None
    x, y, at = np.concatenate(rows), np.concatenate(rests), np.concatenate(marked)
    if (~at).sum() < _LEAST or not at.any():
        return None
    scale = np.maximum(np.linalg.norm(x[~at], axis=0), 1e-9)
    x = x / scale
    weights = np.linalg.solve(x[~at].T @ x[~at] + _HELD * np.eye(len(scale)), x[~at].T @ y[~at])
    left = y - x @ weights
    measured = np.concatenate(torques)
    outwards = np.sign(measured[at] - np.median(measured[~at]))
    deviation = float(np.sqrt((left[~at] ** 2).mean()))
    return -float((outwards * left[at]).mean()) / max(deviation, 1e-300)
