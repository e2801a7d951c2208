"""From a log's trials to samples on a uniform grid: filtered, differentiated, in the robot's order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial, Bands
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.standstill import rows_of_motion, standstill_speed
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import central_differences, lowpass
from excite.logs.signals.coupling import coupling_matrix
from excite.logs.signals.resample import near_samples
from excite.robot.robot import Robot
from excite.rows.kinematics import (
    forces_on_grid,
    in_configurations,
    in_velocities,
    positions_on_grid,
    trial_grid,
    trial_rate,
)
from excite.rows.saturation import beyond_on_grid, bridge_torques


def arm_samples(robot: Robot, log: Log, trials: Sequence[Trial], bands: Bands | None = None) -> ArmSamples:
    """Resample, filter and differentiate the trials of an arm.

    Standstill before and after a trial's motion makes no rows: friction holds the joints there with any torque.

    Args:
        robot: the robot in the log.
        log: the log, for its header.
        trials: repaired trials.
        bands: frequencies.

    Returns:
        The samples.

    Raises:
        LogError: a trial has no torques or is too short for the filter.
    """
    bands = bands or Bands()
    header = log.header
    joints = tuple(name for name in robot.joint_names if name in header.torque_joints)
    columns = [header.joints.index(name) for name in joints]
    rate = float(np.median([trial_rate(log.header, trial) for trial in trials]))
    starts = [trial.start_s for trial in trials]
    known = all(start is not None for start in starts)
    made, clock = [], 0.0
    for trial in trials:
        start = float(trial.start_s) if known and trial.start_s is not None else clock
        made.append(_arm_trial(robot, trial, header.joints, columns, rate, bands, start))
        clock += float(made[-1].time[-1])
    index = tuple(robot.joint_index(name) for name in joints)
    still = np.array([standstill_speed([t.q[:, k] for t in trials], bands.kinematics_hz) for k in columns])
    coupling = coupling_matrix(joints, header.coupling)
    samples = ArmSamples(robot, joints, index, tuple(made), rate, bands, coupling, still)
    if all(trial.beyond is None for trial in made):
        return samples
    nominal = samples.by_trial(samples.nominal_torques)
    return replace(
        samples, trials=tuple(_bridge_lost_torques(t, part) for t, part in zip(made, nominal, strict=True))
    )


def _bridge_lost_torques(trial: ArmTrial, nominal: Array) -> ArmTrial:
    """A trial whose lost torques are guessed by nominal ones."""
    return (
        trial
        if trial.beyond is None
        else replace(trial, tau=bridge_torques(trial.tau, nominal, trial.beyond))
    )


def _arm_trial(
    robot: Robot,
    trial: Trial,
    logged: tuple[str, ...],
    columns: list[int],
    rate: float,
    bands: Bands,
    start: float,
) -> ArmTrial:
    if trial.tau is None:
        raise LogError("has no torques", source=trial.name, field="tau", remedy="log tau.* for a diagnosis")
    grid = trial_grid(trial, rate)
    tau = forces_on_grid(trial.time, trial.tau[:, columns], grid)
    positions = positions_on_grid(trial.time, trial.q, grid)
    d = central_differences(lowpass(positions, rate, bands.kinematics_hz), rate)
    q = in_configurations(robot, logged, d.value)
    v, a = (in_velocities(robot, logged, values) for values in (d.first, d.second))
    if robot.mechanism is not None:
        q, v, a = robot.mechanism.complete_motion(q, v, a)
    commanded = None
    if trial.q_cmd is not None:
        q_cmd = positions_on_grid(trial.time, trial.q_cmd, grid)
        commanded = in_configurations(robot, logged, q_cmd)
    rows = rows_of_motion(v, rate, bands, trial.name)
    beyond = beyond_on_grid(trial, columns, grid, None)
    # What was interpolated over a long gap is no more known than what was beyond its range. Of gaps of 30, 50 and 80 ms
    # in logs of three arms without a fault, those of 80 ms left a gap of the model; the rows' filter takes 50 ms.
    beyond = beyond | ~near_samples(trial.time, grid, max(0.5 / bands.rows_hz, 2.0 / rate))[:, None]
    return ArmTrial(
        name=trial.name,
        identification=trial.role == "identification",
        repeats=trial.repeats,
        time=grid - grid[0],
        session_s=start + grid - grid[0],
        q=q,
        v=v,
        a=a,
        tau=tau,
        rows=rows,
        q_cmd=commanded,
        beyond=beyond if beyond.any() else None,
    )
