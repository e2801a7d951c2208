"""Torques of a robot's motors and their regressor: the tree's own where each joint has one, else through its mechanism.

Between them and :mod:`excite.regressor.kernels` stands ``τ_m = Gᵀ τ`` of closed loops and coupled joints
(:mod:`excite.robot.mechanisms.mechanism`).
"""

from __future__ import annotations

from excite.arrays import Array
from excite.regressor.kernels import inverse_dynamics, joint_torque_regressor
from excite.robot.robot import Robot


def motor_torques(robot: Robot, q: Array, v: Array, a: Array, phi: Array | None = None) -> Array:
    """Forces of base and motors that a motion takes, contacts and drives' own friction aside.

    Args:
        robot: the robot.
        q: ``(n, nq)`` configurations, closed.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.
        phi: ``(10·n_segments,)`` inertial parameters; the model's own if None.

    Returns:
        ``(n, nv)`` [N·m or N], the base's wrench first; zero for joints without a motor.

    Raises:
        InputError: wrong shape; MotionError: a mechanism is at a singular position.
    """
    return robot.on_motors(q, inverse_dynamics(robot.model, q, v, a, phi))


def motor_regressor(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Regressor of :func:`motor_torques`, ``(n, nv, 10·n_segments)``; arguments and errors as there."""
    return robot.on_motors(q, joint_torque_regressor(robot.model, q, v, a))
