"""When a run is over before its motion is: the robot has fallen, or has done what it may not do."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.simulation.plant import Plant

# A base that tilts or sinks further than this from where the motion wants it has fallen.
FALL_TILT_RAD = 0.5
FALL_HEIGHT_M = 0.15
_FALL_COSINE = math.cos(FALL_TILT_RAD)
# A foot has this long after touchdown to come to rest before its slip counts.
_TOUCHDOWN_S = 0.05
# Feet that stand are looked at so often [s]: looking takes as long as two steps of the physics.
_LOOK_S = 0.05
# MuJoCo's place of a foot and pinocchio's differ by rounding: a slip that ends a run is one by either.
_CLEARLY = 1.0 + 1e-6


class Fall:
    """Ends a run as soon as the base has left the motion for good."""

    def __init__(self, planned: Motion) -> None:
        # Looked at at every sample: in plain numbers, which takes a tenth of what arrays of one row take.
        self.vertical, self.height = vertical_axis(planned.q[:, 3:7]).tolist(), planned.q[:, 2].tolist()

    def __call__(self, sample: int, plant: Plant) -> bool:
        """Whether the base is lost after the step that began at a sample."""
        height, w, x, y, z = plant.data.qpos[plant.qpos[2:7]].tolist()
        a, b, c = self.vertical[sample]
        cosine = 2.0 * a * (x * z + w * y) + 2.0 * b * (y * z - w * x) + c * (1.0 - 2.0 * (x * x + y * y))
        return bool(cosine < _FALL_COSINE or self.height[sample] - height > FALL_HEIGHT_M)


class FirstFault:
    """Ends a run as soon as the robot falls, touches itself or the ground, or slips: its verdict cannot change."""

    def __init__(self, robot: Robot, planned: Motion, slip_m: float) -> None:
        """Of a planned motion at the instants of the run's samples; ``slip_m`` is what a foot may slip in a phase."""
        self._fall, self._limit = Fall(planned), slip_m * _CLEARLY
        self._bodies = np.array([foot.joint for foot in robot.feet])
        self._centres = np.array([foot.placement.translation for foot in robot.feet])[:, :, None]
        shape = (planned.n_samples, len(robot.feet))
        self._starts: NDArray[np.bool_] = np.zeros(shape, dtype=bool)
        self._counts: NDArray[np.bool_] = np.zeros(shape, dtype=bool)
        for number, phases in enumerate(standing_phases(robot, planned).values()):
            for start, end in phases:
                self._starts[start, number], self._counts[start:end, number] = True, True
        self._stood = np.zeros((len(robot.feet), 2))
        self._looked: NDArray[np.bool_] = np.asarray(self._starts.any(axis=1))
        self._looked[:: max(1, round(_LOOK_S * robot.description.sensors.rate_hz))] = True
        if math.isinf(slip_m):
            self._looked[:] = False

    def __call__(self, sample: int, plant: Plant) -> bool:
        """Whether something went wrong at a sample."""
        if plant.touching or self._fall(sample, plant):
            return True
        if not self._looked[sample]:
            return False
        data = plant.data
        # MuJoCo's bodies are where they were when the step began.
        turned = data.xmat[self._bodies].reshape(-1, 3, 3) @ self._centres
        points = data.xpos[self._bodies, :2] + turned[:, :2, 0]
        starts = self._starts[sample]
        if starts.any():
            self._stood[starts] = points[starts]
        slip = np.hypot(*(points - self._stood).T)
        return bool((slip[self._counts[sample]] > self._limit).any())


def standing_phases(robot: Robot, planned: Motion) -> dict[str, list[tuple[int, int]]]:
    """Half-open ranges of samples in which each foot stands and its slip counts, by name of the foot."""
    settle = round(_TOUCHDOWN_S * robot.description.sensors.rate_hz)
    found = {}
    for foot in robot.feet:
        flags = planned.contacts.get(foot.name, np.ones(planned.n_samples, dtype=bool))
        phases = [(start + settle if start > 0 else 0, end) for start, end in _true_runs(flags)]
        found[foot.name] = [(start, end) for start, end in phases if end > start]
    return found


def vertical_axis(quaternions: Array) -> Array:
    """The body's z axis in the world for quaternions x y z w, ``(n, 3)``."""
    x, y, z, w = quaternions.T
    return np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x**2 + y**2)])


def _true_runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open index ranges over which ``flags`` is True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(start), int(end)) for start, end in zip(edges[::2], edges[1::2], strict=True)]
