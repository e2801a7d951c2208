"""A robot as bodies and joints with all that files say of them, made of a subject alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import RobotError
from excite.export.models.model_format import JOINT_TERMS, SERVO_TERMS, Subject
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_shapes
from excite.robot.shapes.shape import Shape
from excite.simulation.mjcf import joint_axis, mechanical_range, segment_inertia
from excite.simulation.true_parameters import PrincipalInertia

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
        terms: those of :data:`JOINT_TERMS` and :data:`SERVO_TERMS` that are known [SI].
    """

    name: str
    parent: int
    child: int
    placement: pin.SE3
    axis: Array
    slides: bool
    range: tuple[float, float]
    terms: dict[str, float]


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
    terms = {name: subject.written(name) for name in (*JOINT_TERMS, *SERVO_TERMS)}
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
                {term: float(v[index]) for term, v in terms.items() if np.isfinite(v[index])},
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
