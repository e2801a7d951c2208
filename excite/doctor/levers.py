"""Where contact sensors are beside the base: what makes wrenches on the base of theirs, for any reading of a log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.doctor.reading import Reading
from excite.regressor.kernels import forward_kinematics
from excite.regressor.tree import KinematicTree
from excite.robot.robot import Robot

# Readings whose levers are kept.
_KEPT = 64


class Levers:
    """Levers of a robot's contact sensors along the motions that a log may be of."""

    def __init__(self, robot: Robot, places: NDArray[np.int64], tree: KinematicTree):
        """Of the log's joints, whose indices into ``v`` are ``places``."""
        self._robot, self._tree = robot, tree
        supports = {int(joint) for sensor in robot.sensors for joint in robot.model.supports[sensor.joint]}
        owners = np.searchsorted(robot.model.idx_vs, places, side="right") - 1
        self._carrying = np.flatnonzero([int(owner) in supports for owner in owners])
        self._known: dict[bytes, Array] = {}

    def at(self, reading: Reading, q: Array) -> Array:
        """What turns each sensor's wrench into that on the base, at configurations ``(n, nq)`` of the reading.

        Returns:
            ``(n, n_sensors, 6, 6)`` in the base frame.
        """
        key = self._key(reading)
        if key not in self._known:
            # One motion is asked for again and again while wrenches are read otherwise; others once or twice.
            if len(self._known) >= _KEPT:
                self._known.clear()
            self._known[key] = self._made(q)
        return self._known[key]

    def _key(self, reading: Reading) -> bytes:
        """Equal for readings that place the sensors alike: joints elsewhere, gravity and the clock do not."""
        carrying = self._carrying
        still = replace(
            reading,
            position_of=reading.position_of[carrying],
            position_sign=reading.position_sign[carrying],
            zero=reading.zero[carrying],
            tick=1.0,
            gravity=np.zeros(3),
        )
        return still.motion_key()

    def _made(self, q: Array) -> Array:
        sensors = self._robot.sensors
        poses = forward_kinematics(self._tree, q)
        back = poses.rotation[:, 1].transpose(0, 2, 1)
        found = np.zeros((len(q), len(sensors), 6, 6))
        for s, sensor in enumerate(sensors):
            turn = back @ poses.rotation[:, sensor.joint] @ sensor.placement.rotation
            away = poses.point(sensor.joint, sensor.placement.translation) - poses.translation[:, 1]
            lever = np.einsum("nij,nj->ni", back, away)
            found[:, s, :3, :3] = found[:, s, 3:, 3:] = turn
            # As np.cross, which takes as long as all the rest, some hundred times a log.
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                found[:, s, 3 + i, :3] = lever[:, j, None] * turn[:, k] - lever[:, k, None] * turn[:, j]
        return found
