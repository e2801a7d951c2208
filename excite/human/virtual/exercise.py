"""What a virtual person does: arms, trunk, head, legs and squats on two force plates, and the same done again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import fftconvolve

from excite.arrays import Array
from excite.human.body import Body
from excite.human.posture.joint_angles import pose_of
from excite.human.posture.skeleton import place_segments
from excite.human.segments import JOINT_NAMES, NAMES


@dataclass(frozen=True, eq=False)
class Performance:
    """True motion: time ``(n,)``, pelvis pose ``(n, 7)``, joint angles ``(n, 34)``, share on the right foot."""

    time: Array
    base: Array
    angles: Array
    right_share: Array


def perform_exercise(body: Body, seconds: float = 60.0, rate_hz: float = 100.0, seed: int = 0) -> Performance:
    """Arms, trunk and head all the time; right leg, left leg and squats in turn, weight over the standing foot."""
    rng = np.random.default_rng(seed)
    n = round(seconds * rate_hz)
    time = np.arange(n) / rate_hz
    angles = np.zeros((n, 34))

    def wave(amplitude: float, low: float = 0.2, high: float = 0.9) -> Array:
        parts = [
            np.sin(2 * np.pi * (f * time + p))
            for f, p in zip(rng.uniform(low, high, 4), rng.uniform(0, 1, 4), strict=True)
        ]
        return amplitude * np.sum(parts, axis=0) / 2.0

    def put(name: str, values: Array) -> None:
        angles[:, JOINT_NAMES.index(name)] = values

    for name, amplitude in {
        "lumbar_flexion": 0.3,
        "lumbar_bending": 0.2,
        "lumbar_rotation": 0.3,
        "neck_flexion": 0.3,
        "neck_bending": 0.2,
        "neck_rotation": 0.4,
    }.items():
        put(name, wave(amplitude))
    phase = 2 * np.pi * time / seconds * 3.0
    right_share = 1.0 / (1.0 + np.exp(-6.0 * np.sin(phase)))
    squat = np.exp(-4.0 * np.sin(phase) ** 2)
    for side, share in (("right", right_share), ("left", 1.0 - right_share)):
        for name, amplitude, center in (
            ("shoulder_flexion", 0.7, 0.5),
            ("shoulder_rotation", 0.3, 0.0),
            ("shoulder_adduction", 0.5, -0.5),
            ("elbow", 0.6, 0.9),
            ("wrist_pronation", 0.4, 0.0),
            ("wrist_deviation", 0.2, 0.0),
            ("wrist_flexion", 0.3, 0.0),
        ):
            values = center + wave(amplitude)
            put(
                f"{side}_{name}",
                0.1 + np.logaddexp(0.0, 4.0 * (values - 0.1)) / 4.0 if name == "elbow" else values,
            )
        free = np.clip(1.0 - 2.0 * share, 0.0, 1.0)
        free = free**3 * (10.0 - 15.0 * free + 6.0 * free**2)
        down = 0.35 * squat * (1.0 + np.sin(2 * np.pi * 0.45 * time))
        put(f"{side}_hip_flexion", 0.15 + down + free * (0.4 + wave(0.5)))
        put(f"{side}_hip_adduction", -free * 0.15 + free * wave(0.2))
        put(f"{side}_hip_rotation", free * wave(0.25))
        put(f"{side}_knee", 0.3 + 2.0 * down + free * (0.5 + wave(0.4)))
        put(f"{side}_ankle_flexion", 0.15 + down + free * wave(0.3))
        put(f"{side}_ankle_adduction", free * wave(0.15))
        put(f"{side}_ankle_rotation", free * wave(0.1))
    return balance_pelvis(body, time, angles, right_share)


def repeat_exercise(body: Body, show: Performance, rng: np.random.Generator) -> Performance:
    """The same exercise done again: timing wanders by some tenths of a second, each joint's range by some 5 %."""
    n = len(show.time)
    rate = 1.0 / (show.time[1] - show.time[0])
    late = np.cumsum(_wandering_noise(n, rate, 4.0, 1, rng)[:, 0]) * 0.05 / rate
    at = np.clip(show.time + late - late.mean(), show.time[0], show.time[-1])
    angles, share = (CubicSpline(show.time, values)(at) for values in (show.angles, show.right_share))
    middle = angles.mean(axis=0)
    angles = middle + (angles - middle) * (1.0 + 0.05 * _wandering_noise(n, rate, 3.0, angles.shape[1], rng))
    return balance_pelvis(body, show.time, angles, share)


def _wandering_noise(n: int, rate: float, seconds: float, columns: int, rng: np.random.Generator) -> Array:
    """Smooth noise of unit variance that forgets itself in so many seconds, ``(n, columns)``."""
    kernel = np.hanning(int(2 * seconds * rate))
    noise = rng.standard_normal((n + len(kernel), columns))
    smooth = np.column_stack([fftconvolve(column, kernel, "valid")[:n] for column in noise.T])
    return smooth / np.sqrt((kernel**2).sum())


def balance_pelvis(body: Body, time: Array, angles: Array, share: Array) -> Performance:
    """Put the pelvis so that the weighted feet keep their height and the centre of mass lies over them."""
    n = len(time)
    base = np.zeros((n, 7))
    base[:, 6] = 1.0
    placed = place_segments(pose_of(base, angles), body.offsets)
    masses = np.array([b.mass for b in body.inertias])
    centers = np.stack([b.center for b in body.inertias])
    points = placed.origin + np.einsum("nkij,kj->nki", placed.rotation, centers)
    com = np.einsum("k,nki->ni", masses / masses.sum(), points)
    feet = {side: placed.origin[:, NAMES.index(f"{side}_foot")] for side in ("right", "left")}
    width = 0.5 * abs(feet["right"][0, 1] - feet["left"][0, 1])
    target = np.column_stack([0.05 + 0 * time, (1 - 2 * share) * width])
    base[:, :2] = target - com[:, :2]
    height = share * feet["right"][:, 2] + (1 - share) * feet["left"][:, 2]
    base[:, 2] = body.dimensions.ankle_height - height
    return Performance(time, base, angles, share)
