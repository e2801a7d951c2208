"""A trial on a uniform grid, with velocities and accelerations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import scipy

from excite.arrays import Array, Flags
from excite.logs.log import LogHeader, Trial
from excite.logs.robot import base_offset, imu_placement
from excite.logs.signals.base_pose import base_motion, continuous_quaternions
from excite.logs.signals.butterworth import (
    central_differences,
    decimation_step,
    kept_samples,
    lowpass,
    settling_samples,
)
from excite.logs.signals.resample import (
    is_uniform,
    moving_span,
    near_samples,
    resample_noisy,
    resample_smooth,
    uniform_grid,
)
from excite.robot.robot import Robot
from excite.rows.settings import Filters, ProblemSettings


@dataclass(frozen=True, eq=False)
class TrialKinematics:
    """Filtered kinematics of a trial on a uniform grid.

    Attributes:
        time: ``(n,)`` [s].
        rate_hz: its rate.
        q: ``(n, nq)`` filtered configurations, pinocchio's layout.
        v: ``(n, nv)``.
        a: ``(n, nv)``.
        valid: ``(n,)`` False in gaps and at the ends, where the filter's transient is.
        moving: span in which a joint moves; empty where none ever does.
    """

    time: Array
    rate_hz: float
    q: Array
    v: Array
    a: Array
    valid: Flags
    moving: slice

    @property
    def standing(self) -> bool:
        """Whether no joint ever moves."""
        return bool(self.moving.start == self.moving.stop)

    @property
    def in_motion(self) -> Flags:
        """Valid samples between the first and the last at which a joint moves, ``(n,)``."""
        use = self.valid.copy()
        use[: self.moving.start] = use[self.moving.stop :] = False
        return use

    def at_rest(self) -> TrialKinematics:
        """The same with no velocity and no acceleration: those of a robot that stands are its encoders' noise."""
        return replace(self, v=np.zeros_like(self.v), a=np.zeros_like(self.a))


def trial_kinematics(
    robot: Robot, header: LogHeader, trial: Trial, settings: ProblemSettings, filters: Filters
) -> TrialKinematics:
    """Resample, filter and differentiate the positions of a trial.

    Args:
        robot: the robot (joints that the log lacks stay at rest, or follow from the others in a mechanism).
        header: the log's header.
        trial: the trial.
        settings: standstill and gaps.
        filters: the filter before differentiation.

    Returns:
        The kinematics at the trial's own rate.

    Raises:
        LogError: too short for the filter.
        MotionError: a mechanism cannot be closed at what was logged.
    """
    rate, cutoff_hz = trial_rate(header, trial), filters.kinematics_cutoff_hz
    grid = trial_grid(trial, rate)
    positions = positions_on_grid(trial.time, trial.q, grid)
    joints = central_differences(lowpass(positions, rate, cutoff_hz, filters.order), rate)
    n = len(grid)
    q = in_configurations(robot, header.joints, joints.value)
    v, a = (in_velocities(robot, header.joints, values) for values in (joints.first, joints.second))
    if header.uses_imu and trial.imu is not None:
        readings = lowpass(positions_on_grid(trial.time, trial.imu, grid), rate, cutoff_hz, filters.order)
        if trial.base is not None:
            pose = root_pose(trial.base, base_offset(robot, header))
            q[:, :7] = base_motion(
                positions_on_grid(trial.time, pose, grid), rate, cutoff_hz, filters.order
            ).pose
        a[:, :6], v[:, 3:6] = imu_motion(robot, header, readings, q[:, 3:7], rate)
    elif robot.floating and trial.base is not None:
        pose = root_pose(trial.base, base_offset(robot, header))
        base = base_motion(positions_on_grid(trial.time, pose, grid), rate, cutoff_hz, filters.order)
        q[:, :7], v[:, :6], a[:, :6] = base.pose, base.twist, base.acceleration
    if robot.mechanism is not None:
        q, v, a = robot.mechanism.complete_motion(q, v, a)
    valid = near_samples(trial.time, grid, max(settings.longest_gap_s, 2.0 / rate))
    edge = max(3, settling_samples(rate, cutoff_hz))
    valid[:edge] = valid[n - edge :] = False
    moves = robot.floating or bool((np.abs(joints.first) > settings.standstill_velocity).any())
    moving = slice(0, 0) if not moves else slice(0, n)
    if moves and not robot.floating:
        moving = moving_span(joints.first, settings.standstill_velocity)
    return TrialKinematics(grid, rate, q, v, a, valid, moving)


def trial_grid(trial: Trial, rate_hz: float) -> Array:
    """Uniform times of a trial ``(n,)`` [s]: its very stamps where they are uniform."""
    return trial.time if is_uniform(trial.time, rate_hz) else uniform_grid(trial.time, rate_hz)


def in_configurations(robot: Robot, joints: Sequence[str], positions: Array) -> Array:
    """Positions of a log's joints ``(n, n_joints)`` in configurations ``(n, nq)``; all else at rest."""
    q = np.tile(robot.rest, (len(positions), 1))
    q[:, [robot.n_base_q + robot.joint_index(name) for name in joints]] = positions
    return q


def in_velocities(robot: Robot, joints: Sequence[str], values: Array) -> Array:
    """Velocities or accelerations of a log's joints ``(n, n_joints)`` in those of the model, ``(n, nv)``."""
    v = np.zeros((len(values), robot.model.nv))
    v[:, [robot.n_base_v + robot.joint_index(name) for name in joints]] = values
    return v


def trial_rate(header: LogHeader, trial: Trial) -> float:
    """Rate of a trial [Hz]: the header's where the stamps keep to it within 0.1 %, else their own mean."""
    own = 1.0 / float(np.median(np.diff(trial.time)))
    if abs(own - header.rate_hz) < 1e-3 * header.rate_hz:
        return header.rate_hz
    span = trial.time[-1] - trial.time[0]
    return float((len(trial.time) - 1 + trial.cleaning.missing_rows) / span)


def positions_on_grid(time: Array, values: Array, grid: Array) -> Array:
    """Positions at ``grid``; unchanged where the grid is the trial's own.

    Args:
        time: stamps ``(n,)`` [s].
        values: ``(n, k)`` [rad or m].
        grid: ``(m,)`` [s]; the very array ``time`` where nothing is to be interpolated.

    Returns:
        ``(m, k)``.
    """
    return values if grid is time else resample_smooth(time, values, grid)


def forces_on_grid(time: Array, values: Array, grid: Array) -> Array:
    """Torques, currents or wrenches at ``grid``, ``(m, k)``: as :func:`positions_on_grid`, without overshooting."""
    return values if grid is time else resample_noisy(time, values, grid)


def root_pose(pose: Array, offset: pin.SE3) -> Array:
    """Poses of the free-flyer from poses of a link at ``offset`` on it, signs of the quaternions continuous.

    Args:
        pose: of the link in the world, ``(n, 7)``: position [m], quaternion x y z w.
        offset: of the link's frame in the free-flyer's.

    Returns:
        ``(n, 7)``, as ``pose``.
    """
    pose = np.hstack([pose[:, :3], continuous_quaternions(pose[:, 3:])])
    if offset.isIdentity(1e-12):
        return pose
    inverse = offset.inverse()
    return np.array([pin.SE3ToXYZQUAT(pin.XYZQUATToSE3(row) * inverse) for row in pose])


# Motion of a free base from the inertial measurement unit on it, without its pose.


def imu_motion(
    robot: Robot, header: LogHeader, readings: Array, orientation: Array, rate_hz: float
) -> tuple[Array, Array]:
    """Acceleration and angular velocity of the base, its linear velocity taken as zero.

    Inverse dynamics in the base's frame knows gravity and acceleration as their difference only, which is what an
    accelerometer reads, and does not know the base's linear velocity at all. So any orientation will do, and gravity
    in it is added to the reading; only where a ball touches the ground depends on it.

    Args:
        robot: the robot in the log; gravity is its model's.
        header: says where the IMU sits.
        readings: ``(n, 6)`` filtered angular velocity [rad/s] and acceleration less gravity [m/s²], IMU's frame.
        orientation: ``(n, 4)`` quaternions x y z w of the base, as they will stand in the configuration.
        rate_hz: their rate.

    Returns:
        ``(n, 6)`` linear and angular acceleration in the base's frame, and ``(n, 3)`` angular velocity.

    Raises:
        LogError: the IMU's link moves against the base.
    """
    # scipy.spatial takes 0.2 s to load, and rows of a fixed base need none of it.
    from scipy.spatial.transform import Rotation

    placement = imu_placement(robot, header)
    angular = readings[:, :3] @ placement.rotation.T
    turning = central_differences(angular, rate_hz).first
    lever = placement.translation
    about = np.cross(turning, lever) + np.cross(angular, np.cross(angular, lever))
    gravity = Rotation.from_quat(orientation).inv().apply(robot.model.gravity.linear)
    linear = readings[:, 3:] @ placement.rotation.T - about + gravity
    return np.hstack([linear, turning]), angular


# Rows of a regression at full rate, filtered and decimated block by block.

_BLOCK_BYTES = 64e6


@dataclass(frozen=True, eq=False)
class TrialRows:
    """Rows of one trial, decimated.

    Attributes:
        values: ``(m, n_channels, n_params + 1)``: regressor, then measurement.
        time: ``(m,)`` [s].
        use: ``(m, n_channels)`` rows worth keeping.
        freedom: ``(m, n_channels)`` share of each row's noise that is its own, below one where what was taken out
            of the rows ties them; None where nothing was.
    """

    values: Array
    time: Array
    use: Flags
    freedom: Array | None = None


RowSource = Callable[[slice], Array]
"""Rows ``(m, n_channels, n_params + 1)`` of a slice of samples, at full rate."""


def filtered_rows(source: RowSource, kinematics: TrialKinematics, filters: Filters, use: Flags) -> TrialRows:
    """Filter regressor columns and measurement alike, then keep every k-th sample.

    As the filter is linear, ``F(Y) θ = F(τ)`` holds exactly where ``Y θ = τ`` does; filtering before the
    regressor is computed would not keep it (Gautier 1997, parallel decimation).

    Args:
        source: rows at full rate by slice of samples.
        kinematics: the trial's kinematics.
        filters: cut-off, order and rate.
        use: ``(n, n_channels)`` samples whose rows may be used.

    Returns:
        The rows that stay, in order of time.
    """
    rate, cutoff, n = kinematics.rate_hz, filters.cutoff_hz, len(kinematics.time)
    settling = settling_samples(rate, cutoff)
    step = decimation_factor(rate, filters)
    kept = kept_samples(n, step)
    use = _erode_rows(use, kinematics.valid, settling)
    probe = source(slice(0, 1))
    block = max(4 * settling, int(_BLOCK_BYTES / (8 * probe[0].size)), 1)
    parts = []
    for start in range(0, n, block):
        inside = kept[(kept >= start) & (kept < start + block)]
        if not use[inside].any():
            parts.append(np.zeros((len(inside), *probe.shape[1:])))
            continue
        # Neighbouring blocks overlap by twice the filter's transient, and a short rest joins the last one.
        low, high = max(0, start - 2 * settling), min(n, start + block + 2 * settling)
        low = min(low, max(0, high - 4 * settling - 1))
        parts.append(lowpass(source(slice(low, high)), rate, cutoff, filters.order)[inside - low])
    return TrialRows(np.concatenate(parts), kinematics.time[kept], use[kept])


def decimation_factor(rate_hz: float, filters: Filters) -> int:
    """Every how manieth sample is kept."""
    return decimation_step(rate_hz, filters.rate_hz)


def _erode_rows(use: Flags, valid: Flags, settling: int) -> Flags:
    """Take away what the filter's transient reaches: all of it at the ends, half of it at gaps."""
    half = settling // 2
    if half:
        use = scipy.ndimage.binary_erosion(use, np.ones((2 * half + 1, 1), dtype=bool), border_value=0)
    ends = np.flatnonzero(valid)
    if len(ends):
        use[: ends[0] + settling] = use[ends[-1] + 1 - settling :] = False
    return use
