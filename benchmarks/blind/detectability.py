"""How far a hidden effect stands above the noise, known from simulations without noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.signal import butter, sosfiltfilt

from excite.arrays import Array
from excite.robot.robot import Robot
from excite.simulation.virtual_robot import Recording

BAND_HZ = 10.0
# An effect whose rest is less than this share of a channel's noise in the band may be missed by anyone.
DETECTABLE = 0.3
_EVERY = 8
_EDGE = 40
_SIGN_WIDTH = 5e-3
_STILL = 0.02


@dataclass(frozen=True, eq=False)
class Band:
    """The frequencies at which robots are compared, and the noise in them.

    Attributes:
        sos: second-order sections of the low-pass, which runs forth and back.
        noise: ``(n_joints,)`` standard deviation of what passes of the torques' white noise [N·m].
    """

    sos: Array
    noise: Array

    @staticmethod
    def of(run: Recording, sigma: Array) -> Band:
        """The band of a recording whose torques have white noise of standard deviation ``sigma`` ``(n_joints,)``."""
        rate = 1.0 / float(run.time[1] - run.time[0])
        sos = butter(4, BAND_HZ, fs=rate, output="sos")
        pulse = np.zeros(2 * round(rate) + 1)
        pulse[round(rate)] = 1.0
        return Band(sos, sigma * np.sqrt((sosfiltfilt(sos, pulse) ** 2).sum()))


def effect_detectability(
    robot: Robot,
    with_effect: Sequence[Recording],
    without: Sequence[Recording],
    modelled: Sequence[str],
    sigma: Array,
) -> float:
    """Rest of an effect that no parameters of the modelled terms can take, against the noise.

    Rows of both robots are low-passed alike and fitted by least squares, each channel weighted by its noise;
    the difference of the two sums of squares, less than which no fit of the modelled terms leaves (the
    noncentrality of the F-test of Scheffé 1959, section 2.6), is spread over the rows of one channel.

    Args:
        robot: the nominal model.
        with_effect: recordings of the robot with the effect, without noise.
        without: recordings of the same commands by the robot without it.
        modelled: words of ``modelled`` of the log.
        sigma: ``(n_joints,)`` standard deviation of the torques' white noise [N·m].

    Returns:
        Root mean square of the rest over that of the noise in the band.
    """
    band = Band.of(with_effect[0], sigma)
    first, last = (
        _unexplained_sum(robot, runs, modelled, band.noise, band.sos) for runs in (with_effect, without)
    )
    return float(np.sqrt(max(first - last, 0.0)))


def _unexplained_sum(
    robot: Robot, runs: Sequence[Recording], modelled: Sequence[str], noise: Array, sos: Array
) -> float:
    """Weighted sum of squares that the modelled terms leave, over the number of rows of a channel."""
    parts = [band_rows(robot, run, modelled, sos) for run in runs]
    y, a = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    moving = np.concatenate([part[2] for part in parts])
    weight = moving / noise
    rows, target = (a * weight[:, :, None]).reshape(-1, a.shape[2]), (y * weight).ravel()
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-12)
    x = np.linalg.lstsq(rows / scale, target, rcond=1e-9)[0]
    return float(((target - rows / scale @ x) ** 2).sum()) / len(y)


class BandRows(NamedTuple):
    """Equations of one recording in the band.

    Attributes:
        torque: less the nominal bodies' ``(m, n_joints)`` [N·m].
        columns: of what is modelled ``(m, n_joints, n_columns)``.
        moving: 1 where a joint moves, else 0, ``(m, n_joints)``.
    """

    torque: Array
    columns: Array
    moving: Array


def band_rows(robot: Robot, run: Recording, modelled: Sequence[str], sos: Array) -> BandRows:
    """Equations of one recording in the band, edges left out and every eighth row kept.

    Args:
        robot: the nominal model.
        run: a recording.
        modelled: words of ``modelled`` of the log.
        sos: second-order sections of the low-pass.
    """
    model, n = robot.model, robot.n_joints
    data = model.createData()
    inertial = np.array(
        [
            pin.computeJointTorqueRegressor(model, data, q, v, a)
            for q, v, a in zip(run.q, run.v, run.a, strict=True)
        ]
    )
    phi = np.concatenate([model.inertias[k].toDynamicParameters() for k in range(1, model.njoints)])
    y = run.tau_motor - inertial @ phi
    terms = {
        "viscous_friction": run.v,
        "coulomb_friction": np.tanh(run.v / _SIGN_WIDTH),
        "armature": run.a,
    }
    own = [np.einsum("tj,jk->tjk", terms[name], np.eye(n)) for name in terms if name in modelled]
    columns = [inertial] if "rigid_body" in modelled else []
    a = np.concatenate([*columns, *own], axis=2) if columns or own else np.zeros((len(y), n, 0))
    take = slice(_EDGE, -_EDGE, _EVERY)
    moving = (np.abs(run.v) > _STILL)[take]
    return BandRows(
        sosfiltfilt(sos, y, axis=0)[take], sosfiltfilt(sos, a, axis=0)[take], moving.astype(float)
    )
