"""A MuJoCo model made from a robot and a vector of inertial parameters, with no URDF in between."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.robot.mechanisms.closures import Closure, Coupling, Loop, Rod
from excite.robot.robot import Foot, Robot
from excite.robot.shapes.collision import collision_model, collision_shapes, links_below
from excite.robot.shapes.shape import Shape
from excite.simulation.coordinates import body_name
from excite.simulation.true_parameters import Drives, PrincipalInertia, principal_inertia

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
    ends = base.name, WORLD
    equality = _add_equality(spec, "harness", mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_BODY, *ends)
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


# Closed loops and coupled joints of a robot in a MuJoCo model: constraints that it solves for at each step.

# A mechanism gives way like its links do, that is not at all: the time constant is two steps, the least that is stable,
# and the impedance so near to one that a four-bar's torques are those of rigid links to 1e-6.
_STEPS, _IMPEDANCE = 2.0, 0.9999


def add_closures(spec: mujoco.MjSpec, bodies: list[mujoco.MjsBody], robot: Robot, timestep: float) -> None:
    """Constraints for a robot's mechanism.

    Args:
        spec: the model.
        bodies: by joint index, the world first; each body's frame is its joint's.
        robot: the robot.
        timestep: of the simulation [s].

    Raises:
        InputError: a coupling that MuJoCo has no constraint for.
    """
    for closure in () if robot.mechanism is None else robot.mechanism.closures:
        if isinstance(closure, Coupling):
            equality = _add_coupling(spec, robot, closure)
        else:
            equality = _add_loop(spec, bodies, closure)
        equality.solref = [_STEPS * timestep, 1.0]
        equality.solimp = [_IMPEDANCE, _IMPEDANCE, 0.001, 0.5, 2.0]
        equality.active = True


def _add_loop(spec: mujoco.MjSpec, bodies: list[mujoco.MjsBody], closure: Closure) -> mujoco.MjsEquality:
    import mujoco

    if not isinstance(closure, Loop | Rod):
        raise InputError("is no loop that MuJoCo has a constraint for", field=closure.name)
    names = []
    for number, (joint, place) in enumerate(zip(closure.joints, closure.placements, strict=True)):
        names.append(f"{closure.name}.end.{number}")
        bodies[joint].add_site(name=names[-1], pos=place.translation, quat=mujoco_quaternion(place.rotation))
    if isinstance(closure, Rod):
        tendon = spec.add_tendon(name=closure.name)
        for name in names:
            tendon.wrap_site(name)
        return _add_tendon_equality(spec, closure.name)
    kind = mujoco.mjtEq.mjEQ_WELD if closure.rigid else mujoco.mjtEq.mjEQ_CONNECT
    equality = _add_equality(spec, closure.name, kind, mujoco.mjtObj.mjOBJ_SITE, *names)
    if closure.rigid:
        equality.data[10] = 1.0
    return equality


def _add_coupling(spec: mujoco.MjSpec, robot: Robot, closure: Coupling) -> mujoco.MjsEquality:
    import mujoco

    names = [robot.joint_names[column - robot.n_base_v] for _, column in closure.columns]
    if all(len(factors) == 1 for factors in closure.factors):
        tendon = spec.add_tendon(name=closure.name)
        for name, factors in zip(names, closure.factors, strict=True):
            tendon.wrap_joint(name, factors[0])
        equality = _add_tendon_equality(spec, closure.name)
        equality.data[0] = closure.offset
        return equality
    linear = [k for k, factors in enumerate(closure.factors) if len(factors) == 1]
    if len(names) != 2 or not linear:
        raise InputError(
            "couples more than two joints by more than factors, and MuJoCo has no constraint for that",
            field=f"couplings.{closure.name}",
            remedy="couple joints two by two, one of them by a factor",
        )
    follower, master = linear[0], 1 - linear[0]
    scale = closure.factors[follower][0]
    kind, of = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
    equality = _add_equality(spec, closure.name, kind, of, names[follower], names[master])
    values = [closure.offset / scale, *(-factor / scale for factor in closure.factors[master])]
    equality.data[: len(values)] = values
    return equality


def _add_equality(
    spec: mujoco.MjSpec, name: str, kind: Any, of: Any, first: str, second: str = ""
) -> mujoco.MjsEquality:
    return spec.add_equality(name=name, type=kind, objtype=of, name1=first, name2=second)


def _add_tendon_equality(spec: mujoco.MjSpec, name: str) -> mujoco.MjsEquality:
    import mujoco

    return _add_equality(spec, name, mujoco.mjtEq.mjEQ_TENDON, mujoco.mjtObj.mjOBJ_TENDON, name)


# Collision shapes of a robot in a MuJoCo model that is asked which of them meet.

GROUND = "ground"
# What MuJoCo calls the body that nothing moves.
WORLD = "world"


def watch_shapes(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add collision shapes, and make their pairs that must not meet, also with the ground, the only ones that do.

    What rests on soles or nearer to the ground than bodies keep from each other, such as the part between an ankle's
    two joints, is no further from it when the robot stands.
    """
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    shapes = collision_shapes(robot)
    for shape in shapes:
        carrier = body_name(robot.segments[shape.joint - 1].link) if shape.joint else WORLD
        _add_shape(spec, spec.body(carrier), shape)
    for pair in collision_model(robot).collisionPairs:
        spec.add_pair(geomname1=shapes[pair.first].name, geomname2=shapes[pair.second].name)
    if not robot.feet:
        return
    soles = {foot.joint for foot in robot.feet}
    low = links_below(robot.model, shapes, robot.rest, 0.0, robot.description.collision.margin)
    for shape in shapes:
        if shape.joint not in soles and shape.link not in low:
            spec.add_pair(geomname1=GROUND, geomname2=shape.name)


def _add_shape(spec: mujoco.MjSpec, body: mujoco.MjsBody, shape: Shape) -> None:
    import mujoco

    kinds = {
        "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
        "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
        "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
        "box": mujoco.mjtGeom.mjGEOM_BOX,
        "convex": mujoco.mjtGeom.mjGEOM_MESH,
    }
    geom = body.add_geom(
        name=shape.name,
        type=kinds[shape.kind],
        pos=shape.placement.translation,
        quat=mujoco_quaternion(shape.placement.rotation),
        contype=0,
        conaffinity=0,
    )
    if shape.vertices is not None and shape.faces is not None:
        mesh = spec.add_mesh(name=shape.name)
        mesh.uservert = np.ravel(shape.vertices)
        mesh.userface = np.ravel(shape.faces)
        geom.meshname = shape.name
    elif shape.kind == "box":
        geom.size = [0.5 * length for length in shape.size]
    elif shape.kind == "sphere":
        geom.size = [shape.size[0], 0.0, 0.0]
    else:
        geom.size = [shape.size[0], 0.5 * shape.size[1], 0.0]


def mujoco_quaternion(rotation: Array) -> Array:
    """Quaternion of a rotation ``(3, 3)`` in MuJoCo's order, ``(4,)``."""
    x, y, z, w = pin.Quaternion(rotation).normalized().coeffs()
    return np.array([w, x, y, z])
