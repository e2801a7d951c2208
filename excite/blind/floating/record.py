"""From what perfect sensors would log to what a laboratory does: noise, then the filters of its recorder."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.signal import butter, sosfiltfilt

from excite.arrays import Array
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import Trial
from excite.robot.robot import Robot
from excite.simulation.recording import Recording

# Joint angles [rad], base position [m] and orientation [rad], standard deviations before the filter.
_JOINTS, _POSITION, _ORIENTATION = 1e-4, 3e-4, 3e-4
_KINEMATICS_HZ, _WRENCH_HZ = 5.0, 25.0


def trial_of(
    robot: Robot, recording: Recording, header: TrialHeader, noise: float, rng: np.random.Generator
) -> Trial:
    """The trial as it is logged.

    Args:
        robot: with the sensors, whose noise counts.
        recording: what perfect sensors would log.
        header: of the trial.
        noise: factor on the usual noise of kinematics; 0 for none at all.
        rng: source of the noise.
    """
    n = len(recording.time)
    rate = 1.0 / float(recording.time[1] - recording.time[0])
    q = recording.q[:, 7:] + noise * _JOINTS * rng.standard_normal((n, robot.n_joints))
    position = recording.q[:, :3] + noise * _POSITION * rng.standard_normal((n, 3))
    turns = noise * _ORIENTATION * rng.standard_normal((n, 3))
    quaternions = np.array(
        [
            (pin.Quaternion(row) * pin.Quaternion(pin.exp3(turn))).coeffs()
            for row, turn in zip(recording.q[:, 3:7], turns, strict=True)
        ]
    )
    quaternions = _filter_values(quaternions, rate, _KINEMATICS_HZ)
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    wrenches = {}
    for sensor in robot.sensors:
        sigma = np.repeat([sensor.noise_force, sensor.noise_moment], 3) * (noise > 0.0)
        logged = recording.wrenches[sensor.name] + sigma * rng.standard_normal((n, 6))
        wrenches[sensor.name] = _filter_values(logged, rate, _WRENCH_HZ)
    return Trial(
        name=recording.name,
        role=header.role,
        time=recording.time,
        q=_filter_values(q, rate, _KINEMATICS_HZ),
        base=np.hstack([_filter_values(position, rate, _KINEMATICS_HZ), quaternions]),
        wrenches=wrenches,
    )


def _filter_values(values: Array, rate: float, cutoff: float) -> Array:
    return np.asarray(sosfiltfilt(butter(4, cutoff, fs=rate, output="sos"), values, axis=0))
