"""How precisely motions would determine the base parameters, given the sensors' noise."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.arrays import Array, Flags, Moved
from excite.errors import InputError
from excite.regressor.base_parameters import BaseParameters, r_factor
from excite.regressor.columns import DRIVE_TERMS, Columns, measured_columns, regressor_rows
from excite.regressor.contact_forces import stance_flags
from excite.regressor.kernels import forward_kinematics
from excite.robot.joint_values import per_joint
from excite.robot.robot import Foot, Robot


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


def nominal_values(robot: Robot, base: BaseParameters) -> Array:
    """Base parameters of the model and its declared drives, ``(n_base,)`` [SI].

    Raises:
        InputError: base parameters of other columns than those that the robot's sensors see.
    """
    columns = _columns_of(robot, base)
    blocks = robot.description.drives
    stated = {"viscous": blocks.viscous, "coulomb": blocks.coulomb, "armature": blocks.armature}
    zero = np.zeros(robot.n_joints)
    phi = [robot.nominal_parameters[columns.inertial]]
    for term in columns.drives:
        phi.append(per_joint(stated[term], robot.joint_names, zero) if term in stated else zero)
    return base.values(np.concatenate(phi))


# Which base parameters any motion at all can excite, given joint limits and feet that stay on the ground.

# Directions with a singular value below this share of the largest say nothing, columns of unit length.
_SILENT = 1e-8
# A parameter counts as undetermined when more than this share of it lies in such directions.
_SHARE = 0.25


def excitable_parameters(robot: Robot, base: BaseParameters, seed: int = 0) -> Flags:
    """Whether some motion within joint limits, with a foot flat on the ground, shows each base parameter.

    Base parameters are those of free motion. Here the regressor is evaluated at random states that a robot on
    its feet can have: any joint positions within their limits, any velocities and accelerations, one of the feet
    still and flat on level ground (standing on two is a special case of that). What the rows then lack, no
    motion with these contacts provides, however long.

    Of a robot on feet without sensors in them the states are free, with all feet down or one in the air: what these
    cannot show, nothing can.

    Args:
        robot: the robot; one without feet is judged within its joint limits alone.
        base: its structural base parameters.
        seed: of the random states.

    Returns:
        ``(n_base,)``.

    Raises:
        InputError: base parameters of other columns than those that the robot's sensors see.
    """
    columns, random = _columns_of(robot, base), np.random.default_rng(seed)
    n, count = 3 * len(columns.names) // robot.n_equations + 1, 1 + len(robot.feet)

    def factor(foot: Foot | None, count: int, closed: Flags | None = None) -> Array:
        states = [_random_state(robot, foot, random) for _ in range(count)]
        q, v, a = (np.array([state[i] for state in states]) for i in range(3))
        rows = regressor_rows(robot, columns, q, v, a, closed)
        return r_factor(rows.reshape(-1, rows.shape[2])[:, base.independent])

    if robot.floating and not robot.measures_contacts:
        return determined_columns(factor(None, n * count, stance_flags(robot, n * count)), _SILENT)
    feet: tuple[Foot | None, ...] = robot.feet if robot.floating and robot.feet else (None,)
    return determined_columns(np.vstack([factor(foot, n) for foot in feet]), _SILENT)


def _columns_of(robot: Robot, base: BaseParameters) -> Columns:
    """Columns that the robot's sensors see, if the base parameters are of these."""
    drives = tuple(term for term in DRIVE_TERMS if f"{term}({robot.joint_names[0]})" in base.names)
    columns = measured_columns(robot, drives)
    if columns.names != base.names:
        raise InputError("base parameters of other columns than the robot's", source=robot.name)
    return columns


def determined_columns(factor: Array, tol: float) -> Flags:
    """Which columns of a factor ``(m, n)`` its rows determine, ``(n,)``.

    Args:
        factor: regressor rows or an R factor of them.
        tol: directions with a singular value below this share of the largest count as undetermined, once columns
            have been brought to unit length.
    """
    length = np.linalg.norm(factor, axis=0)
    present = length > 0.0
    scaled = factor / np.where(present, length, 1.0)
    _, values, vectors = np.linalg.svd(r_factor(scaled), full_matrices=True)
    values = np.concatenate([values, np.zeros(len(vectors) - len(values))])
    share = (vectors[values < tol * values[0]] ** 2).sum(axis=0)
    return np.asarray(present & (share <= _SHARE))


def _random_state(robot: Robot, foot: Foot | None, random: np.random.Generator) -> Moved:
    """Random q, v, a, with ``foot`` still and its sole level."""
    limits, nq, nv = robot.limits, robot.n_base_q, robot.n_base_v
    q, v, a = robot.rest.copy(), np.zeros(robot.model.nv), np.zeros(robot.model.nv)
    q[nq:] = random.uniform(limits.position_lower, limits.position_upper)
    # A joint without any range cannot move.
    free = limits.position_upper > limits.position_lower
    v[nv:] = free * random.normal(size=robot.n_joints)
    a[nv:] = free * 5.0 * random.normal(size=robot.n_joints)
    if not robot.floating:
        return Moved(q, v, a)
    if foot is None:
        quaternion = random.normal(size=4)
        q[3:7] = quaternion / np.linalg.norm(quaternion)
        v[:6], a[:6] = random.normal(size=6), 5.0 * random.normal(size=6)
        return Moved(q, v, a)
    model, data = robot.model, robot.model.createData()
    q[:7] = pin.SE3ToXYZQUAT(pin.SE3.Identity())
    pin.forwardKinematics(model, data, q)
    sole = data.oMi[foot.joint] * foot.placement
    q[:7] = pin.SE3ToXYZQUAT(sole.inverse())
    pin.computeJointJacobians(model, data, q)
    jacobian = pin.getJointJacobian(model, data, foot.joint, pin.ReferenceFrame.LOCAL)
    v[:6] = np.linalg.solve(jacobian[:, :6], -jacobian[:, 6:] @ v[6:])
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    bias = data.a[foot.joint].vector
    a[:6] = np.linalg.solve(jacobian[:, :6], -jacobian[:, 6:] @ a[6:] - bias)
    return Moved(q, v, a)
