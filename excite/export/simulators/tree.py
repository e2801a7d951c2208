"""Robots as bodies and joints, on the way into files and out of them again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError, RobotError
from excite.export.models.verification import States
from excite.export.simulators.model_format import (
    JOINT_TERMS,
    SERVO_TERMS,
    LoadedModel,
    Subject,
    with_friction,
)
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_shapes
from excite.robot.shapes.shape import Shape
from excite.simulation.mjcf import joint_axis, mechanical_range, segment_inertia
from excite.simulation.true_parameters import PrincipalInertia

# A robot as bodies and joints with all that files say of them, made of a subject alone.

BASE = "base"
"""Name of the body that a fixed base is, where the robot's description has no link there."""


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body in the frame of the joint that carries it.

    Attributes:
        name: its link.
        inertia: mass, centre of mass, principal moments and axes; None of a fixed base without mass.
        pose: of its frame where all joints are at zero, in the world.
        shapes: its collision shapes, in its frame.
    """

    name: str
    inertia: PrincipalInertia | None
    pose: pin.SE3
    shapes: tuple[Shape, ...]


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two bodies, and its drive.

    Attributes:
        name: its name.
        parent: index of the body that carries it.
        child: index of the body that it carries, whose frame is its own.
        placement: its frame in the parent's.
        axis: ``(3,)`` in its frame.
        slides: whether it is prismatic.
        range: lower and upper end of its travel [rad or m].
        terms: viscous, coulomb and armature [SI].
        servo: terms of its servo [SI]; those that are not known are left out.
    """

    name: str
    parent: int
    child: int
    placement: pin.SE3
    axis: Array
    slides: bool
    range: tuple[float, float]
    terms: dict[str, float]
    servo: dict[str, float]


@dataclass(frozen=True, eq=False)
class Tree:
    """Bodies and joints.

    Attributes:
        bodies: the first is the base, fixed or free.
        joints: the others' joints, in the robot's order.
        free: whether the base floats.
        frames: other links, with the body that each is fixed to and its pose in that.
        notes: what is not in it, one sentence each.
    """

    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    free: bool
    frames: tuple[tuple[str, int, pin.SE3], ...]
    notes: tuple[str, ...]


def described_tree(subject: Subject) -> Tree:
    """Bodies and joints of a subject.

    Raises:
        UnphysicalParametersError: a segment's parameters belong to no body.
        InputError: a joint has more than one coordinate.
    """
    robot, model = subject.robot, subject.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    shapes, notes = _collision_shapes_of(robot) if subject.shapes else ((), ())
    first = 1 if robot.floating else 0
    root = robot.segments[0].link if robot.floating else _root_link(model)
    ten = subject.parameters.reshape(-1, 10)
    bodies = [
        Body(
            robot.segments[joint - 1].link if joint else root,
            segment_inertia(robot, joint, ten[joint - 1]) if joint else _base_inertia(model),
            pin.SE3(data.oMi[joint]),
            tuple(shape for shape in shapes if shape.joint == joint and shape.link != "table"),
        )
        for joint in range(first, model.njoints)
    ]
    terms = {name: subject.written(name) for name in JOINT_TERMS}
    servo = {name: subject.servo(name) for name in SERVO_TERMS}
    joints = []
    for index, name in enumerate(robot.joint_names):
        joint = model.getJointId(name)
        axis, slides = joint_axis(model, joint)
        lower, upper = mechanical_range(robot, joint)
        joints.append(
            Joint(
                name,
                model.parents[joint] - first,
                joint - first,
                pin.SE3(model.jointPlacements[joint]),
                axis,
                slides,
                (lower, upper),
                {term: float(values[index]) for term, values in terms.items()},
                {term: float(v[index]) for term, v in servo.items() if np.isfinite(v[index])},
            )
        )
    taken = {body.name for body in bodies}
    frames = tuple(
        (str(frame.name), int(frame.parentJoint) - first, pin.SE3(frame.placement))
        for frame in model.frames
        if frame.type == pin.FrameType.BODY and frame.name not in taken and frame.parentJoint >= first
    )
    return Tree(tuple(bodies), tuple(joints), robot.floating, frames, notes)


def _root_link(model: pin.Model) -> str:
    """The link that stands at a fixed base's origin."""
    names = [
        str(frame.name)
        for frame in model.frames
        if frame.type == pin.FrameType.BODY and frame.parentJoint == 0 and frame.placement.isIdentity(1e-12)
    ]
    return next((name for name in names if name not in ("world", "universe")), BASE)


def _base_inertia(model: pin.Model) -> PrincipalInertia | None:
    own = model.inertias[0]
    if own.mass <= 0.0:
        return None
    moments, axes = np.linalg.eigh(own.inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    return PrincipalInertia(float(own.mass), np.array(own.lever), moments, axes)


def _collision_shapes_of(robot: Robot) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Collision shapes, and what is to be said where there are none."""
    try:
        return collision_shapes(robot), ()
    except RobotError as error:
        return (), (f"it has no shapes: {error.what}",)


# Bodies and joints as a reader found them in a file, and the torques that they need.

_KINDS = {"revolute": pin.JointModelRevoluteUnaligned, "prismatic": pin.JointModelPrismaticUnaligned}


@dataclass(frozen=True, eq=False)
class ReadBody:
    """A body of a file.

    Attributes:
        mass: [kg]
        com: centre of mass in its frame ``(3,)`` [m].
        inertia: about that, axes of its frame ``(3, 3)`` [kg·m²].
    """

    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class ReadJoint:
    """A joint of a file.

    Attributes:
        name: its name.
        kind: ``revolute``, ``prismatic`` or ``fixed``.
        parent: body; empty for the world.
        child: body.
        in_parent: its frame in the parent's.
        in_child: its frame in the child's.
        axis: in its frame ``(3,)``; of a fixed one nothing.
    """

    name: str
    kind: str
    parent: str
    child: str
    in_parent: pin.SE3
    in_child: pin.SE3
    axis: Array | None = None


class LoadedTree(LoadedModel):
    """Bodies and joints of a file, put together anew.

    Args:
        robot: whose joints and order are asked for; none of its bodies.
        bodies: by name.
        joints: in any order.
        drives: terms of joints that the file holds, ``(n_joints,)`` each.
        servos: terms of servos that it holds.

    Raises:
        InputError: the joints make no tree, or are not the robot's.
    """

    def __init__(
        self,
        robot: Robot,
        bodies: Mapping[str, ReadBody],
        joints: Sequence[ReadJoint],
        drives: Mapping[str, Array],
        servos: Mapping[str, Array],
    ) -> None:
        super().__init__(drives, servos)
        self._robot = robot
        self._model = _assemble_model(robot, bodies, joints)
        self._columns = [self._model.joints[self._model.getJointId(name)].idx_v for name in robot.joint_names]

    def torques(self, states: States) -> Array:
        """See :class:`LoadedModel`."""
        base, data = self._robot.n_base_v, self._model.createData()
        at = [*range(base), *self._columns]
        place = [*range(self._robot.n_base_q), *(c + self._robot.n_base_q - base for c in self._columns)]
        bodies = np.zeros_like(states.torque)
        q, v, a = np.zeros(self._model.nq), np.zeros(self._model.nv), np.zeros(self._model.nv)
        for row in range(len(states.q)):
            q[place], v[at], a[at] = states.q[row], states.v[row], states.a[row]
            bodies[row] = pin.rnea(self._model, data, q, v, a)[at]
        return with_friction(self._robot, bodies, states, self.drives)


def _assemble_model(robot: Robot, bodies: Mapping[str, ReadBody], joints: Sequence[ReadJoint]) -> pin.Model:
    """A pinocchio model of a file's bodies and joints."""
    model = pin.Model()
    model.gravity = robot.model.gravity
    carried: dict[str, tuple[int, pin.SE3]] = {"": (0, pin.SE3.Identity())}
    children = [joint.child for joint in joints]
    for name in bodies:
        if name not in children:
            root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
            _carry_body(model, carried, bodies, name, root, pin.SE3.Identity())
    waiting = list(joints)
    while waiting:
        ready = [joint for joint in waiting if joint.parent in carried]
        if not ready:
            raise InputError(f"joint {waiting[0].name!r} hangs on nothing", source="written model")
        for joint in ready:
            support, pose = carried[joint.parent]
            placement = pose * joint.in_parent
            if joint.kind == "fixed":
                _carry_body(
                    model, carried, bodies, joint.child, support, placement * joint.in_child.inverse()
                )
                continue
            index = model.addJoint(support, _KINDS[joint.kind](joint.axis), placement, joint.name)
            _carry_body(model, carried, bodies, joint.child, index, joint.in_child.inverse())
        waiting = [joint for joint in waiting if joint not in ready]
    missing = [name for name in robot.joint_names if not model.existJointName(name)]
    if missing or model.nv != robot.model.nv:
        raise InputError("its joints are not the robot's", source="written model")
    return model


def _carry_body(
    model: pin.Model,
    carried: dict[str, tuple[int, pin.SE3]],
    bodies: Mapping[str, ReadBody],
    name: str,
    joint: int,
    pose: pin.SE3,
) -> None:
    """Put a body on a joint, its frame at ``pose`` in the joint's."""
    body = bodies[name]
    model.appendBodyToJoint(joint, pin.Inertia(body.mass, body.com, body.inertia), pose)
    carried[name] = (joint, pose)
