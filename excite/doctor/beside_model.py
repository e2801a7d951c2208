"""A trial's torques as they stand in a log and as they were repaired, beside what the nominal model needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.doctor.drive_fit import Drive
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.joint_rows import JointRows
from excite.rows.kinematics import TrialKinematics, forces_on_grid, trial_kinematics
from excite.rows.settings import ProblemSettings


@dataclass(frozen=True, eq=False)
class BesideModel:
    """Torques of one trial, filtered alike.

    Attributes:
        trial: its name.
        joints: of the columns.
        units: of each column.
        time: ``(n,)`` by the repaired log's clock [s].
        model: of the nominal model's bodies, with an offset, friction and a rotor fitted to the repaired torques:
            ``(n, n_joints)`` [N·m or N].
        logged: as they stand in the log, likewise; samples keep their places where the clock was repaired.
        repaired: as they were repaired, likewise.
    """

    trial: str
    joints: tuple[str, ...]
    units: tuple[str, ...]
    time: Array
    model: Array
    logged: Array
    repaired: Array


def beside_model(robot: Robot, log: Log, repaired: Log) -> BesideModel | None:
    """The torques of the trial that judges, or of the first, beside the nominal model's.

    Args:
        robot: the nominal model.
        log: as it stands.
        repaired: the same as it was repaired.

    Returns:
        None of robots that move freely or hold their joints together, and where a log or its repair has no torques
        or is too poor for any.
    """
    header = repaired.header
    if header.free_base or header.torque == "none" or robot.mechanism is not None:
        return None
    mended = (repaired.role("validation") or repaired.trials)[0]
    stands = next((trial for trial in log.trials if trial.name == mended.name), None)
    if stands is None or log.header.torque_joints != header.torque_joints:
        return None
    try:
        mechanics, settings = robot_in_log(robot, header, repaired.folder), ProblemSettings()
        filters = settings.filters(floating=False)
        k = trial_kinematics(mechanics, header, mended, settings, filters)
        rows = [JointRows(mechanics, of.header, settings, filters, ()) for of in (log, repaired)]
        both = [_torques(rows[0].torque(stands), stands, k), _torques(rows[1].torque(mended), mended, k)]
        smooth = [lowpass(torques, k.rate_hz, filters.cutoff_hz, filters.order) for torques in both]
    except LogError:
        return None
    columns = [mechanics.joint_index(name) for name in header.torque_joints]
    model = inverse_dynamics(mechanics.model, k.q, k.v, k.a)[:, columns]
    model = _with_drives(model, smooth[1], k, columns)
    use = k.valid
    return BesideModel(
        mended.name, header.torque_joints, rows[1].channel_units, k.time[use] - k.time[0],
        model[use], smooth[0][use], smooth[1][use],
    )  # fmt: skip


def _torques(torques: Array, trial: Trial, k: TrialKinematics) -> Array:
    """At the samples of ``k``; a trial by another clock is laid out over the same time."""
    time = k.time[0] + (trial.time - trial.time[0]) * (k.time[-1] - k.time[0]) / (
        trial.time[-1] - trial.time[0]
    )
    return forces_on_grid(time, torques, k.time)


def _with_drives(model: Array, torques: Array, k: TrialKinematics, columns: list[int]) -> Array:
    """Torques of the bodies with what offset, friction and rotor of each joint say of what they leave."""
    made, v, a = model.copy(), k.v[:, columns], k.a[:, columns]
    drive = Drive.of(v, a)
    for j in range(model.shape[1]):
        own = np.column_stack([np.ones(len(model)), *(values[:, j] for values in drive)])
        left = torques[:, j] - model[:, j]
        made[:, j] += own @ np.linalg.lstsq(own[k.valid], left[k.valid], rcond=1e-10)[0]
    return made
