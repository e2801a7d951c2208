"""A MuJoCo model made from a robot and a vector of inertial parameters, with no URDF in between."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.robot.robot import Foot, Robot
from excite.simulation.coordinates import body_name
from excite.simulation.drives import Drives
from excite.simulation.inertial import PrincipalInertia, principal_inertia
from excite.simulation.mjcf_closures import add_closures
from excite.simulation.mjcf_shapes import GROUND, mujoco_quaternion

if TYPE_CHECKING:
    import mujoco

SOLE_RADIUS = 0.005


@dataclass(frozen=True)
class World:
    """Numerical settings of a simulated world.

    Attributes:
        timestep: integration step, at most [s].
        solref: time constant [s] and damping ratio of the contacts' reference dynamics.
        solimp: impedance of the contacts at zero and full depth, and the depth between them [m].
        sole_friction: factor on every sole's friction coefficient.
    """

    timestep: float = 5e-4
    solref: tuple[float, float] = (0.01, 1.0)
    solimp: tuple[float, float, float] = (0.95, 0.99, 0.001)
    sole_friction: float = 1.0


def build_spec(robot: Robot, phi: Array, drives: Drives, world: World) -> mujoco.MjSpec:
    """An editable MuJoCo model of a robot: one body and one joint per segment, in the robot's own order.

    Every body's frame is the frame of its pinocchio joint, so that ``q`` needs no conversion but the order of
    the base's quaternion. Position servos, one per joint, produce ``kp (ctrl - q) - kd v`` clipped at the
    torque limit; soles are spheres of 5 mm whose lowest points are the sole's corners.

    Args:
        robot: the robot.
        phi: inertial parameters, ``(10·n_segments,)``, joint frames.
        drives: servo gains, friction, armature.
        world: numerical settings.

    Returns:
        The specification, not yet compiled.

    Raises:
        UnphysicalParametersError: a segment's parameters belong to no body.
        InputError: ``phi`` has the wrong length.
    """
    import mujoco

    n = len(robot.segments)
    if np.shape(phi) != (10 * n,):
        raise InputError(
            f"phi has shape {np.shape(phi)}, not ({10 * n},)", remedy="ten parameters per segment"
        )
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False
    option = spec.option
    option.timestep = world.timestep
    option.gravity = np.array(robot.description.gravity)
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.impratio = 10.0
    option.tolerance = 1e-10
    option.iterations = 50
    bodies = [spec.worldbody]
    for segment in robot.segments:
        bodies.append(_add_body(robot, bodies, segment.joint, phi[10 * (segment.joint - 1) :][:10]))
    offset = 1 if robot.floating else 0
    for index, name in enumerate(robot.joint_names):
        _add_drive(spec, bodies[index + 1 + offset], name, drives, index)
    add_closures(spec, bodies, robot, world.timestep)
    if robot.feet:
        spec.worldbody.add_geom(
            name=GROUND, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], contype=1, conaffinity=0
        )
    for foot in robot.feet:
        _add_sole(bodies[foot.joint], foot, world)
    if robot.floating and not robot.feet:
        _hang_base(spec, bodies[1], robot)
    return spec


def _add_body(robot: Robot, bodies: list[mujoco.MjsBody], joint: int, phi: Array) -> mujoco.MjsBody:
    import mujoco

    model = robot.model
    placement = model.jointPlacements[joint]
    inertia = segment_inertia(robot, joint, phi)
    body = bodies[model.parents[joint]].add_body(
        name=body_name(robot.segments[joint - 1].link),
        pos=placement.translation,
        quat=mujoco_quaternion(placement.rotation),
        explicitinertial=True,
        mass=inertia.mass,
        ipos=inertia.com,
        iquat=mujoco_quaternion(inertia.rotation),
        inertia=inertia.moments,
    )
    if joint == 1 and robot.floating:
        body.add_joint(name=model.names[joint], type=mujoco.mjtJoint.mjJNT_FREE, align=False)
        return body
    axis, prismatic = joint_axis(model, joint)
    body.add_joint(
        name=model.names[joint],
        type=mujoco.mjtJoint.mjJNT_SLIDE if prismatic else mujoco.mjtJoint.mjJNT_HINGE,
        axis=axis,
        limited=True,
        range=mechanical_range(robot, joint),
    )
    return body


def segment_inertia(robot: Robot, joint: int, phi: Array) -> PrincipalInertia:
    """The body of the segment that a joint carries; raises UnphysicalParametersError.

    What the description accepts of its model is accepted here; other parameters ``(10,)`` have to be a body's.
    """
    nominal = np.array_equal(phi, robot.model.inertias[joint].toDynamicParameters())
    accepted = nominal and bool(robot.description.model.acknowledged)
    return principal_inertia(phi, robot.segments[joint - 1].name, accepted=accepted)


def mechanical_range(robot: Robot, joint: int) -> list[float]:
    """The model's range of a joint, or the declared one where that is wider [rad or m]."""
    position = robot.model.idx_qs[joint]
    index = robot.joint_index(robot.model.names[joint])
    lower = min(robot.model.lowerPositionLimit[position], robot.limits.position_lower[index])
    upper = max(robot.model.upperPositionLimit[position], robot.limits.position_upper[index])
    return [float(lower), float(upper)]


def joint_axis(model: pin.Model, joint: int) -> tuple[Array, bool]:
    """Axis of a one-coordinate joint in its own frame, and whether it slides; raises InputError for other joints."""
    if model.joints[joint].nv != 1 or model.joints[joint].nq != 1:
        raise InputError(
            f"joint {model.names[joint]!r} has {model.joints[joint].nv} degrees of freedom",
            remedy="only revolute and prismatic joints can be simulated",
        )
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    # A robot with a single joint gets a vector for its one column.
    column = pin.getJointJacobian(model, data, joint, pin.LOCAL).reshape(6, -1)[:, model.idx_vs[joint]]
    prismatic = bool(np.linalg.norm(column[:3]) > np.linalg.norm(column[3:]))
    return (column[:3] if prismatic else column[3:]), prismatic


def _add_drive(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, drives: Drives, index: int) -> None:
    import mujoco

    joint = body.joints[0]
    joint.damping = [drives.total_viscous[index], 0.0, 0.0]
    joint.frictionloss = drives.total_coulomb[index]
    # Stop within one step where friction suffices: MuJoCo's default reference lets friction push a joint that
    # slows down faster than the reference would.
    joint.solref_friction = [-1.0, -1.0 / spec.option.timestep]
    joint.solimp_friction = [0.99, 0.99, 0.001, 0.5, 2.0]
    joint.armature = drives.armature[index]
    kp, kd, limit = (float(values[index]) for values in (drives.kp, drives.kd, drives.torque_limit))
    actuator = spec.add_actuator(
        name=name,
        target=name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        forcelimited=True,
        forcerange=[-limit, limit],
    )
    actuator.gainprm[0] = kp
    actuator.biasprm[:3] = [0.0, -kp, -kd]


# Height of the harness's hook above the robot's centre of mass at rest [m]: ropes to a gantry, from the shoulders.
_HOOK = 0.5


def _hang_base(spec: mujoco.MjSpec, base: mujoco.MjsBody, robot: Robot) -> None:
    """Hang the base on a point straight above the centre of mass, about which it swings."""
    import mujoco

    data = robot.model.createData()
    hook = np.array(pin.centerOfMass(robot.model, data, robot.rest)) + np.array([0.0, 0.0, _HOOK])
    pose = pin.XYZQUATToSE3(robot.rest[:7])
    equality = spec.add_equality(
        name="harness",
        type=mujoco.mjtEq.mjEQ_CONNECT,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=base.name,
        name2="world",
    )
    equality.data[:3] = pose.actInv(hook)


def _add_sole(body: mujoco.MjsBody, foot: Foot, world: World) -> None:
    import mujoco

    radius = foot.radius or SOLE_RADIUS
    for number, corner in enumerate(foot.sole):
        body.add_geom(
            name=f"{foot.name}.sole.{number}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[radius, 0.0, 0.0],
            pos=corner + radius * foot.placement.rotation[:, 2],
            contype=0,
            conaffinity=1,
            priority=1,
            condim=3,
            friction=[foot.friction * world.sole_friction, 0.005, 0.0001],
            solref=list(world.solref),
            solimp=[*world.solimp, 0.5, 2.0],
        )
