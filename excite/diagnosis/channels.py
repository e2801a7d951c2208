"""Channels that are not what the log calls them: degrees, swapped joints, flipped signs, other units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.result import LogFault
from excite.diagnosis.equations.samples import arm_samples
from excite.logs.log import Log, Trial
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot

_FAR, _LIKE, _UNLIKE = 8.0, 0.9, 0.3
_SCALE = 3.0
# Only torques that look like the model's can be the model's in another unit, and no unit is larger than this.
_RESEMBLES, _UNIT = 0.5, 3e3


def examine_channels(
    robot: Robot, log: Log, trials: tuple[Trial, ...]
) -> tuple[tuple[Trial, ...], tuple[LogFault, ...]]:
    """Find and mend channels in the wrong unit, place or sign.

    Args:
        robot: the nominal model.
        log: the log, for its header.
        trials: trials with sound rows.

    Returns:
        Mended trials and what was found.
    """
    faults: list[LogFault] = []
    reach = max(float(np.abs(trial.q).max()) for trial in trials)
    if reach > _FAR and reach * np.pi / 180.0 < _FAR:
        trials = tuple(replace(t, q=np.deg2rad(t.q)) for t in trials)
        faults.append(
            LogFault("degrees", "q", f"positions reach {reach:.0f}", "logged in degrees", repaired=True)
        )
    if any(trial.tau is None for trial in trials):
        return trials, tuple(faults)
    likeness, scale = _likeness(robot, log, trials)
    names = log.header.torque_joints
    column = [log.header.joints.index(name) for name in names]
    for i, joint in enumerate(names):
        if likeness[i, i] < -_LIKE:
            trials = tuple(_flipped(t, column[i]) for t in trials)
            faults.append(
                LogFault(
                    "flipped_sign",
                    f"tau.{joint}",
                    f"tau.{joint} follows the model's torque with the opposite sign",
                    "a sign convention of the drive, or torque on the robot's environment",
                    repaired=True,
                )
            )
        for k in range(i):
            name = names[k]
            if min(likeness[i, k], likeness[k, i]) > _LIKE and max(likeness[i, i], likeness[k, k]) < _UNLIKE:
                trials = tuple(_swapped(t, column[i], column[k]) for t in trials)
                what = f"tau.{joint} and tau.{name} follow each other's torque in the model"
                faults.append(
                    LogFault("swapped_joints", f"tau.{joint}", what, "another order of joints", repaired=True)
                )
    resembles = np.abs(np.diag(likeness)).max() > _RESEMBLES
    another_unit = np.all((scale > _SCALE) & (scale < _UNIT)) or np.all(
        (scale < 1.0 / _SCALE) & (scale > 1.0 / _UNIT)
    )
    if resembles and another_unit:
        faults.append(
            LogFault(
                "unit",
                "tau",
                f"all torques are about {np.median(scale):.2g} times the model's",
                "currents called torques, or motor torques before the gear",
                repaired=False,
            )
        )
    return trials, tuple(faults)


def _likeness(robot: Robot, log: Log, trials: tuple[Trial, ...]) -> tuple[Array, Array]:
    """Correlation of each torque with each joint's nominal one, and the ratio of their deviations."""
    samples = arm_samples(robot, log, trials)
    q, v, a = (samples.stacked(name) for name in ("q", "v", "a"))
    predicted = inverse_dynamics(robot.model, q, v, a)[:, list(samples.index)]
    measured = samples.stacked("tau")
    n = measured.shape[1]
    # A channel that never changes follows nothing.
    with np.errstate(divide="ignore", invalid="ignore"):
        both = np.corrcoef(np.hstack([measured, predicted]).T + 0.0)[:n, n:]
    order = [samples.joints.index(name) for name in log.header.torque_joints]
    ratio = measured.std(axis=0) / np.maximum(predicted.std(axis=0), 1e-9)
    return np.nan_to_num(both[np.ix_(order, order)]), ratio


def _flipped(trial: Trial, i: int) -> Trial:
    tau = np.array(trial.tau)
    tau[:, i] *= -1.0
    return replace(trial, tau=tau)


def _swapped(trial: Trial, i: int, k: int) -> Trial:
    tau = np.array(trial.tau)
    tau[:, [i, k]] = tau[:, [k, i]]
    return replace(trial, tau=tau)
