"""How precisely motions would determine the base parameters, given the sensors' noise."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.errors import InputError
from excite.excitation.conditioning import MotionFactor
from excite.excitation.sub_regressors import RANK_TOLERANCE
from excite.regressor.base_parameters import BaseParameters
from excite.regressor.columns import DRIVE_TERMS, measured_columns
from excite.regressor.kernels import forward_kinematics
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot


def row_noise(robot: Robot) -> Array:
    """Standard deviation of the noise in each of a sample's rows, from ``robot.yaml``.

    Rows of a robot on wrench sensors sum all of them, and a sensor's force noise reaches the base's moment
    over its lever arm, which is taken at the rest posture. Noise of positions and of the base's pose is left
    out.

    Returns:
        ``(6,)`` [N, N, N, N·m, N·m, N·m] for a robot on wrench sensors, else ``(n_joints,)`` [N·m or N].

    Raises:
        InputError: joint torques whose description does not state the noise of its torques.
    """
    if not robot.measures_contacts:
        block = robot.description.sensors.noise_torque
        noise = per_joint(block, robot.joint_names, np.full(robot.n_joints, np.nan))
        if np.isnan(noise).any():
            joint = robot.joint_names[int(np.argmax(np.isnan(noise)))]
            raise InputError(
                f"no noise of joint {joint!r}",
                source=robot.source,
                field="sensors.noise_torque",
                remedy="state its standard deviation",
            )
        return noise
    poses = forward_kinematics(robot.model, robot.rest[None])
    base_rotation, base_origin = poses.rotation[0, 1], poses.translation[0, 1]
    variance = np.zeros(6)
    for sensor in robot.sensors:
        lever = base_rotation.T @ (poses.point(sensor.joint, sensor.placement.translation)[0] - base_origin)
        variance[:3] += sensor.noise_force**2
        variance[3:] += sensor.noise_moment**2 + sensor.noise_force**2 * (lever @ lever - lever**2)
    return np.sqrt(variance)


def predicted_std(
    robot: Robot, factor: MotionFactor, base: BaseParameters, noise: Array | None = None
) -> Array:
    """Standard deviations that least squares would have on the base parameters.

    The sensors' noise is white at the robot's log rate. Exact where the factor's rows were divided by
    ``noise`` (``motion_factor(..., row_std=noise)``) or the noise is equal in all rows; else an upper bound,
    since (YᵀY)⁻¹YᵀΣY(YᵀY)⁻¹ is at most max σ² (YᵀY)⁻¹.

    Args:
        robot: the robot.
        factor: of all the motions that will be run.
        base: structural base parameters.
        noise: ``(r,)`` standard deviation of each of a sample's rows; :func:`row_noise` if None.

    Returns:
        ``(n_base,)`` [SI]; infinite for parameters that the motions do not determine.

    Raises:
        InputError: noise of a wrong shape, or base parameters of other columns.
    """
    noise = row_noise(robot) if noise is None else np.asarray(noise, dtype=float)
    weights = np.ones_like(noise) if factor.row_std is None else factor.row_std
    if noise.shape != (robot.n_equations,) or noise.shape != weights.shape:
        raise InputError(
            f"noise of shape {noise.shape}", field="noise", remedy="one number a row of a sample"
        )
    if base.names != factor.columns.names:
        raise InputError(
            "base parameters of other columns than the motion's", source=", ".join(factor.motions)
        )
    scale = (noise / weights).max() * np.sqrt(factor.rate_hz / robot.description.sensors.rate_hz)
    _, found, vectors = np.linalg.svd(factor.matrix[:, base.independent], full_matrices=True)
    values = np.concatenate([found, np.zeros(base.rank - len(found))])
    known = values > RANK_TOLERANCE * values[0]
    std = scale * np.sqrt(((vectors[known] / values[known, None]) ** 2).sum(axis=0))
    undetermined = (vectors[~known] ** 2).sum(axis=0) > 1e-12
    return np.where(undetermined, np.inf, std)


def nominal_values(robot: Robot, base: BaseParameters) -> Array:
    """Base parameters of the model and its declared drives, ``(n_base,)`` [SI].

    Raises:
        InputError: base parameters of other columns than those that the robot's sensors see.
    """
    drives = tuple(term for term in DRIVE_TERMS if f"{term}({robot.joint_names[0]})" in base.names)
    columns = measured_columns(robot, drives)
    if columns.names != base.names:
        raise InputError("base parameters of other columns than the robot's", source=robot.name)
    blocks = robot.description.drives
    stated = {"viscous": blocks.viscous, "coulomb": blocks.coulomb, "armature": blocks.armature}
    zero = np.zeros(robot.n_joints)
    phi = [robot.nominal_parameters[columns.inertial]]
    for term in columns.drives:
        phi.append(per_joint(stated[term], robot.joint_names, zero) if term in stated else zero)
    return base.values(np.concatenate(phi))
