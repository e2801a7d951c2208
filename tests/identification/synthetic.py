"""Problems made from known parameters: smooth random motions, and noise of known spectrum."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.signal import butter, sosfiltfilt

from excite.identification.problem import IdentificationProblem
from excite.regressor.kernels import base_link_regressor, joint_torque_regressor
from excite.robot.robot import Robot

NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


def smooth(
    rng: np.random.Generator, time: np.ndarray, size: np.ndarray, harmonics: int = 5, top_hz: float = 1.2
):
    """Sums of sines of random frequency and phase with their two derivatives, each ``(n, len(size))``."""
    n = len(size)
    omega = 2 * np.pi * rng.uniform(0.15, top_hz, (harmonics, n))
    phase = rng.uniform(0, 2 * np.pi, (harmonics, n))
    gain = size / harmonics * rng.uniform(0.5, 1.5, (harmonics, n))
    angle = omega * time[:, None, None] + phase
    return (
        (gain * np.sin(angle)).sum(1),
        (gain * omega * np.cos(angle)).sum(1),
        (-gain * omega**2 * np.sin(angle)).sum(1),
    )


def add_body(parameters: np.ndarray, mass: float, at: np.ndarray, radius: float) -> np.ndarray:
    """Ten parameters of a segment after a uniform ball has been put on it."""
    ten = parameters.copy()
    inertia = 0.4 * mass * radius**2 * np.eye(3) + mass * ((at @ at) * np.eye(3) - np.outer(at, at))
    ten[0] += mass
    ten[1:4] += mass * at
    ten[4:] += inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return ten


def wrench_problem(
    robot: Robot,
    true: np.ndarray,
    *,
    seed: int,
    trials: int = 4,
    duration: float = 10.0,
    rate: float = 50.0,
    noise: float = 1.0,
    cutoff: float | None = None,
    unmeasured: tuple[int, ...] = (),
) -> IdentificationProblem:
    """Base-link rows of a floating base that moves smoothly; noise 1 N and 0.1 N·m times ``noise``."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration, 1.0 / rate)
    middle = 0.5 * (robot.limits.position_lower + robot.limits.position_upper)
    size = 0.45 * (robot.limits.position_upper - robot.limits.position_lower)
    rows, measured = [], []
    sigma = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1]) * noise
    for _ in range(trials):
        x, v, a = smooth(rng, time, size)
        lean, _, _ = smooth(rng, time, np.full(3, 0.15))
        _, twist, wrench = smooth(rng, time, np.array([0.05, 0.05, 0.05, 0.15, 0.15, 0.15]))
        quaternion = np.column_stack([lean / 2, np.ones(len(time))])
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        q = np.column_stack([np.zeros((len(time), 3)), quaternion, middle + x])
        y = base_link_regressor(robot.model, q, np.column_stack([twist, v]), np.column_stack([wrench, a]))
        for segment in unmeasured:
            y[:, :, robot.parameter_columns(segment)] = 0.0
        f = y @ true + sigma * rng.standard_normal((len(time), 6))
        if cutoff is not None:
            sos = butter(4, cutoff, fs=rate, output="sos")
            y, f = sosfiltfilt(sos, y, axis=0), sosfiltfilt(sos, f, axis=0)
        rows.append(y.reshape(-1, y.shape[2]))
        measured.append(f.ravel())
    names = tuple(f"{segment.link}.{name}" for segment in robot.segments for name in NAMES)
    bandwidth = 1.0 if cutoff is None else min(1.0, 2 * cutoff / rate)
    return assemble(
        robot, rows, measured, ("fx", "fy", "fz", "tx", "ty", "tz"), sigma, time, names, unmeasured, bandwidth
    )


def assemble(robot, rows, measured, channels, sigma, time, names, unmeasured=(), bandwidth=1.0, prior=None):
    """Stack trials whose rows run through the channels at each instant."""
    n_channels, trials = len(channels), len(rows)
    n = len(time)
    channel = np.tile(np.arange(n_channels), n * trials)
    inertial = robot.nominal_parameters
    return IdentificationProblem(
        robot=robot,
        Y=np.vstack(rows),
        y=np.concatenate(measured),
        weights=1.0 / np.asarray(sigma)[channel],
        channel=channel,
        channel_names=tuple(channels),
        channel_units=tuple("N" if name in ("fx", "fy", "fz") else "N·m" for name in channels),
        time=np.tile(np.repeat(time, n_channels), trials),
        trial=np.repeat(np.arange(trials), n * n_channels),
        trial_names=tuple(f"trial_{k:02d}" for k in range(trials)),
        parameter_names=tuple(names),
        prior=inertial if prior is None else prior,
        n_inertial=len(inertial),
        unmeasured=tuple(unmeasured),
        noise_bandwidth=bandwidth,
    )


def segment_index(robot: Robot, link: str) -> int:
    """Index of the segment that carries a link."""
    return [segment.link for segment in robot.segments].index(link)


@cache
def modified_g1_parameters(robot: Robot) -> np.ndarray:
    """The nominal G1 with 5 kg added: 4 kg behind the torso, half a kilogram in each hand."""
    true = robot.nominal_parameters.copy()
    for link, mass, at, radius in (
        ("torso_link", 4.0, (-0.08, 0.01, 0.15), 0.08),
        ("left_wrist_yaw_link", 0.5, (0.08, 0.0, 0.01), 0.03),
        ("right_wrist_yaw_link", 0.5, (0.08, 0.0, 0.01), 0.03),
    ):
        columns = robot.parameter_columns(segment_index(robot, link))
        true[columns] = add_body(true[columns], mass, np.array(at), radius)
    true.setflags(write=False)
    return true


def arm_rows(robot: Robot, rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    """Joint torque rows of an arm that moves smoothly, ``(n, n_joints, 10·n_segments)``."""
    middle = 0.5 * (robot.limits.position_lower + robot.limits.position_upper)
    size = 0.45 * (robot.limits.position_upper - robot.limits.position_lower)
    x, v, a = smooth(rng, time, size)
    return joint_torque_regressor(robot.model, middle + x, v, a)


def arm_problem(
    robot: Robot,
    *,
    seed: int,
    trials: int = 1,
    duration: float = 4.0,
    rate: float = 100.0,
    noise: float = 0.05,
    error: float = 0.1,
) -> IdentificationProblem:
    """Joint torque rows of an arm whose bodies are uniformly heavier than the model, each by its own share."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration, 1.0 / rate)
    n_joints = len(robot.joint_names)
    share = 1.0 + error * rng.standard_normal(len(robot.segments))
    true = robot.nominal_parameters * np.repeat(share, 10)
    sigma = noise * rng.uniform(0.5, 2.0, n_joints)
    rows, measured = [], []
    for _ in range(trials):
        y = arm_rows(robot, rng, time)
        f = y @ true + sigma * rng.standard_normal((len(time), n_joints))
        rows.append(y.reshape(-1, y.shape[2]))
        measured.append(f.ravel())
    names = tuple(f"{segment.link}.{name}" for segment in robot.segments for name in NAMES)
    return assemble(robot, rows, measured, robot.joint_names, sigma, time, names)
