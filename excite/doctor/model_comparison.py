"""Torques of a trial beside those of the nominal model, and what a model of the drive explains of them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.doctor.thresholds import THRESHOLD
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.drive_terms import smooth_sign
from excite.rows.joint_rows import JointRows
from excite.rows.kinematics import forces_on_grid, trial_kinematics
from excite.rows.settings import ProblemSettings

# A trial's torques as they stand in a log and as they were repaired, beside what the nominal model needs.


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
            seen = _compare_trial(robot, (log, standing[trial.name]), (repaired, trial))
        except (KeyError, LogError):
            continue
        if seen is not None:
            return seen
    return None


def _compare_trial(
    robot: Robot, stands: tuple[Log, Trial], repaired: tuple[Log, Trial]
) -> BesideModel | None:
    (log, as_logged), (mended, trial) = stands, repaired
    mechanics, settings = robot_in_log(robot, mended.header, mended.folder), ProblemSettings()
    filters = settings.filters(floating=False)
    k = trial_kinematics(mechanics, mended.header, trial, settings, filters)
    before, after = (JointRows(mechanics, of.header, settings, filters, ()) for of in (log, mended))
    # A torque that is none is left out by the repair.
    shown = [name for name in after.channel_names if name in before.channel_names]
    if not shown or not k.valid.any():
        return None
    # Samples that were put on another clock keep their places.
    time = trial.time if len(trial.time) == len(as_logged.time) else as_logged.time
    columns = [mechanics.joint_index(name) for name in shown]

    def smooth(values: Array) -> Array:
        return lowpass(values, k.rate_hz, filters.cutoff_hz, filters.order)[k.valid]

    def smooth_torques(rows: JointRows, one: Trial, clock: Array) -> Array:
        places = [rows.channel_names.index(name) for name in shown]
        return smooth(forces_on_grid(clock, rows.torque(one)[:, places], k.time))

    torques = smooth_torques(after, trial, trial.time)
    model = smooth(inverse_dynamics(mechanics.model, k.q, k.v, k.a)[:, columns])
    # Behind the gear neither its friction nor the rotor is felt.
    v, a = k.v[:, columns], k.a[:, columns]
    own = [np.ones_like(v), *(() if mended.header.torque == "link_side" else Drive.of(v, a))]
    drives = np.stack([smooth(values) for values in own], axis=2)
    for j, missing in enumerate((torques - model).T):
        model[:, j] += drives[:, j] @ np.linalg.lstsq(drives[:, j], missing, rcond=1e-10)[0]
    units = dict(zip(after.channel_names, after.channel_units, strict=True))
    return BesideModel(
        trial.name,
        tuple(shown),
        tuple(units[name] for name in shown),
        k.time[k.valid] - k.time[0],
        model,
        smooth_torques(before, as_logged, time),
        torques,
    )


# Torques of joints beside the nominal model's: what model and drive explain of them.

# Width over which dry friction changes sign [rad/s]: slower motion is mostly noise of the encoder after filtering.
WIDTH = 0.02


class Drive(NamedTuple):
    """Motion of measured joints, which their drives feel.

    Attributes:
        v: velocities ``(n, n_torques)``.
        sign: of the velocities, smooth, likewise.
        a: accelerations, likewise.
    """

    v: Array
    sign: Array
    a: Array

    @classmethod
    def of(cls, v: Array, a: Array, speed: float | Array = 1.0) -> Drive:
        """From velocities and accelerations that are read as ``speed`` times what was logged, all or each joint's.

        Dry friction changes its sign over the same rows whatever the clock and the unit: its shape is not known well
        enough to tell how fast a joint is.
        """
        return cls(v, smooth_sign(v, WIDTH * speed), a)


class Predicted(NamedTuple):
    """What a model says of measured joints.

    Attributes:
        torque: of rigid bodies ``(n, n_torques)`` [N·m].
        drive: motion of the joints.
    """

    torque: Array
    drive: Drive


def shares_left(torque: Array, models: Array, drive: Drive, mixtures: Array | None = None) -> Array:
    """Share of each torque's power that the model and the joint's own drive leave.

    The model's gain is free within bounds, an offset is free; friction takes power out and rotors are heavy: these
    coefficients are not negative. So a torque with its sign turned is explained by nothing. Of the least squares of
    four unknowns the best of all sets of bounds that hold is taken, so that no tolerance has to be chosen.

    Args:
        torque: measured, ``(n, m)`` [N·m].
        models: nominal, ``(n, m)`` [N·m]; or parts of it, ``(k, n, m)``, with ``mixtures``.
        drive: motions of the joints, each ``(n, m)``.
        mixtures: ``(r, k)`` weights of the parts in each of several models.

    Returns:
        ``(m,)``, or ``(r, m)`` with mixtures; one for a torque that never changes.
    """
    parts = models[None] if mixtures is None else models
    weights = np.ones((1, 1)) if mixtures is None else np.asarray(mixtures, dtype=float)
    columns = np.concatenate([parts, np.stack([*drive, torque])])
    columns = (columns - columns.mean(axis=1, keepdims=True)).transpose(2, 0, 1)
    # Sums of products of the mixed model, velocity, its sign, acceleration and torque.
    mix = np.zeros((len(weights), 1, 5, len(parts) + 4))
    mix[:, 0, 0, : len(parts)] = weights
    mix[:, 0, 1:, len(parts) :] = np.eye(4)
    sums = mix @ (columns @ columns.transpose(0, 2, 1)) @ mix.swapaxes(2, 3)
    low, high = THRESHOLD.least_model_gain, THRESHOLD.most_model_gain
    scale = np.maximum(np.sqrt(np.maximum(np.diagonal(sums, axis1=2, axis2=3)[..., :4], 0.0)), 1e-150)
    gram = sums[..., :4, :4] / scale[..., None] / scale[..., None, :]
    right = (sums[..., :4, 4] - low * sums[..., :4, 0]) / scale
    most = (high - low) * scale[..., 0]
    # Each unknown free or zero, the gain at its upper bound besides: (24, r, m, 4).
    states = np.array(list(product((0, 1, 2), (0, 1), (0, 1), (0, 1))))[:, None, None]
    free = states == 1
    fixed = np.where(states == 2, most[..., None], 0.0)
    kept = np.where(free[..., None] & free[..., None, :], gram + THRESHOLD.trace * np.eye(4), np.eye(4))
    target = np.where(free, right - (gram @ fixed[..., None])[..., 0], 0.0)
    x = fixed + np.linalg.solve(kept, target[..., None])[..., 0]
    gained = (2.0 * x * right - x * (gram @ x[..., None])[..., 0]).sum(axis=3)
    holds = (x >= 0.0).all(axis=3) & (x[..., 0] <= most)
    gain = np.where(holds, gained, -np.inf).max(axis=0)
    power = sums[..., 4, 4]
    rest = power - 2.0 * low * sums[..., 0, 4] + low**2 * sums[..., 0, 0] - gain
    # A torque that never changes, filters' rounding aside, is explained by nothing.
    dead = power <= THRESHOLD.dead_share * (torque**2).sum(axis=0)
    shares = np.where(dead, 1.0, np.maximum(rest, 0.0) / np.maximum(power, 1e-300))
    return np.asarray(shares[0] if mixtures is None else shares)


def shares_across(torque: Array, model: Array, drive: Drive) -> Array:
    """Share of every torque's power that every joint's model and drive leave, of either sign the better.

    Args:
        torque: measured, ``(n, m)``; ``model`` nominal, ``(n, m)`` [N·m].
        drive: motions of the joints.

    Returns:
        ``(m, m)``: of each joint as it explains each torque.
    """
    found = []
    for j in range(torque.shape[1]):
        one, *moved = (np.repeat(values[:, [j]], torque.shape[1], axis=1) for values in (model, *drive))
        either = [shares_left(turned, one, Drive(*moved)) for turned in (torque, -torque)]
        found.append(np.minimum(*either))
    return np.array(found)


def remove_drives(drive: Drive, *values: Array) -> list[Array]:
    """Values without what each joint's offset, friction and rotor explain of them.

    Args:
        drive: motions of the joints.
        values: ``(n, m)`` or ``(n, m, k)`` each.
    """
    columns = np.stack([np.ones_like(drive.v), *drive], axis=2).transpose(1, 0, 2)
    size = np.maximum(np.linalg.norm(columns, axis=1, keepdims=True), 1e-300)
    basis, _ = np.linalg.qr(columns / size)
    found = []
    for one in values:
        part = one.reshape(*drive.v.shape, -1).transpose(1, 0, 2)
        rest = part - basis @ (basis.transpose(0, 2, 1) @ part)
        found.append(rest.transpose(1, 0, 2).reshape(one.shape))
    return found


def drive_fit(torque: Array, model: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Least-squares weights of model, offset, viscous, dry friction and inertia ``(5,)``, what each makes ``(n, 5)``.

    Args:
        torque: measured, ``(n,)`` [N·m].
        model: nominal, ``(n,)`` [N·m].
        v: velocity of the joint, ``(n,)``; ``a`` its acceleration. The weights may have any sign.
    """
    columns = np.column_stack([model, np.ones_like(v), v, smooth_sign(v, WIDTH), a])
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    weights = np.linalg.lstsq(columns / scale, torque, rcond=1e-10)[0] / scale
    return weights, columns * weights
