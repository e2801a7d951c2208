"""Bodies and joints as a reader found them in a file, and the torques that they need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.export.models.verification import States
from excite.export.simulators.friction import with_friction
from excite.export.simulators.model_format import LoadedModel
from excite.robot.robot import Robot

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

    def torques(self, states: States, drives: Mapping[str, Array] | None = None) -> Array:
        """See :class:`LoadedModel`; ``drives`` in place of those of the file."""
        base, data = self._robot.n_base_v, self._model.createData()
        at = [*range(base), *self._columns]
        place = [*range(self._robot.n_base_q), *(c + self._robot.n_base_q - base for c in self._columns)]
        bodies = np.zeros_like(states.torque)
        q, v, a = np.zeros(self._model.nq), np.zeros(self._model.nv), np.zeros(self._model.nv)
        for row in range(len(states.q)):
            q[place], v[at], a[at] = states.q[row], states.v[row], states.a[row]
            bodies[row] = pin.rnea(self._model, data, q, v, a)[at]
        return with_friction(self._robot, bodies, states, self.drives if drives is None else drives)


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
