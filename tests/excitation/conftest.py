"""Motions made of a few sines, which excite whatever moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from excite.motion.motion import Motion
from excite.robot.robot import Robot


def sines(
    robot: Robot, name: str, seed: int, moving: Sequence[int] | None = None, duration: float = 4.0
) -> Motion:
    """A motion about the rest posture; ``moving`` are the velocity coordinates that move, all if None."""
    random = np.random.default_rng(seed)
    nv, time = robot.model.nv, np.arange(0.0, duration + 1e-9, 0.005)
    moves = np.zeros(nv)
    moves[list(range(nv)) if moving is None else list(moving)] = 1.0
    d, v, a = (np.zeros((len(time), nv)) for _ in range(3))
    for harmonic in (1, 2, 3):
        w = 2.0 * np.pi * harmonic / duration
        size, phase = moves * random.uniform(0.1, 0.4, nv), random.uniform(0.0, 2.0 * np.pi, nv)
        angle = w * time[:, None] + phase
        d, v, a = d + size * np.sin(angle), v + size * w * np.cos(angle), a - size * w**2 * np.sin(angle)
    q = np.array([pin.integrate(robot.model, robot.rest, step) for step in d])
    if robot.floating:
        # The base's increments are about the rest pose: its twist follows by differences.
        step = np.array([pin.difference(robot.model, x, y) for x, y in zip(q[:-2], q[2:], strict=True)])
        v[1:-1, :6] = step[:, :6] / 0.01
        a[:, :6] = np.gradient(v[:, :6], time, axis=0)
    return Motion(name, robot.name, robot.joint_names, time, q, v, a)
