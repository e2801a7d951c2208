"""How far a hidden effect stands above the noise of a standing robot's log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from scipy.signal import butter, sosfiltfilt

from excite.arrays import Array
from excite.logs.log import Trial
from excite.robot.robot import Robot

_BAND_HZ = 3.5
_EVERY, _EDGE = 4, 10


class Yardstick:
    """What the model's own freedom can take of a session, and what its noise is like.

    Args:
        robot: the nominal robot.
        free: whether its inertial parameters are identified.
        clean: trials of the robot without any effect, without noise.
        noisy: the same with noise.
    """

    def __init__(self, robot: Robot, free: bool, clean: Sequence[Trial], noisy: Sequence[Trial]) -> None:
        self._robot = robot
        plain = [_wrench_residual(robot, trial) for trial in clean]
        loud = [_wrench_residual(robot, trial) for trial in noisy]
        self._plain = np.concatenate(plain)
        self._sigma = (np.concatenate(loud) - self._plain).std(axis=0)
        self._basis: Array | None = None
        if free:
            rows = np.concatenate([_wrench_regressor(robot, trial) for trial in clean]) / self._sigma[:, None]
            flat = rows.reshape(-1, rows.shape[2])
            u, size, _ = np.linalg.svd(flat[:, flat.any(axis=0)], full_matrices=False)
            self._basis = u[:, size > 1e-6 * size[0]]

    def detectability(self, trials: Sequence[Trial]) -> float:
        """Rest of what differs in noiseless trials that the model cannot take, over the noise in the band.

        Each component of the base's wrench counts by its own noise, and all alike.
        """
        change = np.concatenate([_wrench_residual(self._robot, trial) for trial in trials]) - self._plain
        white = (change / self._sigma).ravel()
        if self._basis is not None:
            white = white - self._basis @ (self._basis.T @ white)
        return float(np.sqrt(np.mean(white**2)))


def _wrench_residual(robot: Robot, trial: Trial) -> Array:
    """``(m, 6)`` measured less nominal wrench at the base, in band."""
    data, rows = robot.model.createData(), []
    for k, q, v, a in _difference_states(robot, trial):
        pin.forwardKinematics(robot.model, data, q)
        total = pin.Force.Zero()
        for sensor in robot.sensors:
            pose = data.oMi[sensor.joint] * sensor.placement
            total += data.oMi[1].actInv(pose.act(pin.Force(trial.wrenches[sensor.name][k])))
        body = _base_rows(robot, data, q, v, a)
        rows.append(total.vector - body @ robot.nominal_parameters)
    return _in_band(np.array(rows), trial)


def _wrench_regressor(robot: Robot, trial: Trial) -> Array:
    data = robot.model.createData()
    rows = np.array([_base_rows(robot, data, q, v, a) for _, q, v, a in _difference_states(robot, trial)])
    return _in_band(rows, trial)


def _base_rows(robot: Robot, data: pin.Data, q: Array, v: Array, a: Array) -> Array:
    body = np.array(pin.computeJointTorqueRegressor(robot.model, data, q, v, a)[:6])
    for sensor in robot.sensors:
        for segment in sensor.excludes:
            body[:, 10 * segment : 10 * segment + 10] = 0.0
    return body


def _difference_states(robot: Robot, trial: Trial) -> list[tuple[int, Array, Array, Array]]:
    """Sample, configuration, velocity and acceleration by differences."""
    step = float(trial.time[1] - trial.time[0])
    q = np.hstack([np.asarray(trial.base), trial.q])
    out = []
    for k in range(_EDGE, len(q) - _EDGE, _EVERY):
        ahead, back = (pin.difference(robot.model, q[k], q[k + way]) for way in (1, -1))
        v, a = (ahead - back) / (2.0 * step), (ahead + back) / step**2
        out.append((k, q[k], v, a))
    return out


def _in_band(values: Array, trial: Trial) -> Array:
    rate = 1.0 / (_EVERY * float(trial.time[1] - trial.time[0]))
    sos = butter(4, _BAND_HZ, fs=rate, output="sos")
    return np.asarray(sosfiltfilt(sos, values, axis=0))
