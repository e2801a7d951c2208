"""Walks: move the centre of mass so that the whole robot's zero-moment point is where it shall be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import scipy
from scipy.linalg import solve_banded

from excite.arrays import Array
from excite.motion.generators.candidate import Candidate
from excite.motion.generators.polynomials import hermite_curve
from excite.robot.robot import Robot
from excite.safety.contact_wrench import wrench_at_world_origin, zero_moment_point
from excite.safety.repairs.path import MotionPath, coordinates_of


def follow_zmp(robot: Robot, candidate: Candidate, s: Array, q: Array) -> Candidate:
    """The candidate with a centre of mass that brings the zero-moment point nearer to where it shall be.

    The zero-moment point that a body motion ``q`` has and the one asked for differ by ``e``; a pendulum whose centre of
    mass moves by ``d`` with ``d − d̈/ω² = e`` makes up for it. In differences this is a tridiagonal system (Kagami et
    al. 2002); what the rest of the body then does is small, and is left to the next pass.

    Args:
        robot: the robot.
        candidate: a walk, with the centre of mass that ``q`` has.
        s: path parameters, ``(n,)``, evenly spaced.
        q: configurations at these, ``(n, nq)``.
    """
    if candidate.com is None or candidate.zmp is None or candidate.speed is None:
        return candidate
    com, squared = _pendulum_model(robot)
    rate = candidate.speed
    error = com + candidate.zmp.evaluate(s) - _zmp_of(robot, s, q, rate)
    step = (s[1] - s[0]) / rate
    coupling = 1.0 / (squared * step**2)
    bands = np.zeros((3, len(s) - 2))
    bands[0, 1:] = bands[2, :-1] = -coupling
    bands[1] = 1.0 + 2.0 * coupling
    moved = np.zeros_like(error)
    moved[1:-1] = solve_banded((1, 1), bands, error[1:-1])
    # Standing on both feet the robot starts and ends as it would without.
    moved *= _walking_window(candidate, s)[:, None]
    values = candidate.com.evaluate(s) + moved
    first = np.gradient(values, s, axis=0, edge_order=2)
    second = np.gradient(first, s, axis=0, edge_order=2)
    for derivative in (first, second):
        derivative[[0, -1]] = 0.0
    return replace(candidate, com=hermite_curve(s, values, first, second))


def _pendulum_model(robot: Robot) -> tuple[Array, float]:
    """Horizontal centre of mass at rest, ``(2,)`` [m], and the square of the pendulum's frequency [1/s²]."""
    centre = np.array(pin.centerOfMass(robot.model, robot.model.createData(), robot.rest))
    return centre[:2], float(np.linalg.norm(robot.model.gravity.linear)) / float(centre[2])


def _zmp_of(robot: Robot, s: Array, q: Array, rate: float) -> Array:
    sample = MotionPath(robot, s, coordinates_of(robot, q)).knots
    data = robot.model.createData()
    forces = np.array(
        [
            pin.rnea(robot.model, data, *row)[:6]
            for row in zip(sample.q, sample.twist * rate, sample.curvature * rate**2, strict=True)
        ]
    )
    rotation = scipy.spatial.transform.Rotation.from_quat(sample.q[:, 3:7]).as_matrix()
    return zero_moment_point(wrench_at_world_origin(forces, rotation, sample.q[:, :3]))


def _walking_window(candidate: Candidate, s: Array) -> Array:
    """1 while the robot walks, smoothly 0 at the start of the first stance and at the end of the last, ``(n,)``."""
    first, last = candidate.phases[0].end, candidate.phases[-1].start
    u = np.clip(np.minimum(s / first, (s[-1] - s) / (s[-1] - last)), 0.0, 1.0)
    return np.asarray(u**3 * (10.0 - 15.0 * u + 6.0 * u**2))
