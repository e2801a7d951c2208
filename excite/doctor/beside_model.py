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
    """The torques of a trial beside the nominal model's: of the first that judges, or else of the first.

    Args:
        robot: the nominal model.
        log: as it stands.
        repaired: the same as it was repaired.

    Returns:
        None of robots that move freely or hold their joints together, and where no trial has torques or is long enough.
    """
    if repaired.header.free_base or robot.mechanism is not None:
        return None
    standing = {trial.name: trial for trial in log.trials}
    for trial in (*repaired.role("validation"), *repaired.role("identification")):
        try:
            seen = _of_trial(robot, (log, standing[trial.name]), (repaired, trial))
        except (KeyError, LogError):
            continue
        if seen is not None:
            return seen
    return None


def _of_trial(robot: Robot, stands: tuple[Log, Trial], repaired: tuple[Log, Trial]) -> BesideModel | None:
    (log, as_logged), (mended, trial) = stands, repaired
    mechanics, settings = robot_in_log(robot, mended.header, mended.folder), ProblemSettings()
    filters = settings.filters(floating=False)
    k = trial_kinematics(mechanics, mended.header, trial, settings, filters)
    rows = [JointRows(mechanics, of.header, settings, filters, ()) for of in (log, mended)]
    # A torque that is none is left out by the repair.
    shown = [name for name in rows[1].channel_names if name in rows[0].channel_names]
    if not shown or not k.valid.any():
        return None
    places = [[names.channel_names.index(name) for name in shown] for names in rows]
    # Samples that were put on another clock keep their places.
    time = trial.time if len(trial.time) == len(as_logged.time) else as_logged.time
    columns = [mechanics.joint_index(name) for name in shown]

    def smooth(values: Array) -> Array:
        return lowpass(values, k.rate_hz, filters.cutoff_hz, filters.order)[k.valid]

    torques = smooth(forces_on_grid(trial.time, rows[1].torque(trial)[:, places[1]], k.time))
    model = smooth(inverse_dynamics(mechanics.model, k.q, k.v, k.a)[:, columns])
    own = [smooth(values) for values in _own(mended, k, columns)]
    return BesideModel(
        trial.name,
        tuple(shown),
        tuple(rows[1].channel_units[i] for i in places[1]),
        k.time[k.valid] - k.time[0],
        _with_drives(model, torques, own),
        smooth(forces_on_grid(time, rows[0].torque(as_logged)[:, places[0]], k.time)),
        torques,
    )


def _own(log: Log, k: TrialKinematics, columns: list[int]) -> list[Array]:
    """What each joint's torque may hold besides the bodies': ``(n, n_joints)`` each, of a coefficient one."""
    v, a = k.v[:, columns], k.a[:, columns]
    # Behind the gear neither its friction nor the rotor is felt.
    return [np.ones_like(v), *(() if log.header.torque == "link_side" else Drive.of(v, a))]


def _with_drives(model: Array, torques: Array, own: list[Array]) -> Array:
    """Torques of the bodies with what of each joint's own says most of what they leave."""
    made = model.copy()
    for j in range(model.shape[1]):
        columns = np.column_stack([values[:, j] for values in own])
        made[:, j] += columns @ np.linalg.lstsq(columns, torques[:, j] - model[:, j], rcond=1e-10)[0]
    return made
