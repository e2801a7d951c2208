"""Which trees of a MuJoCo model are the robot, which of its joints motors drive, and which loops and equalities tie."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.mechanisms.closures import SINGULAR, join_overlapping
from excite.robot.mjcf.urdf import FREE, HINGE, SLIDE, Mimic, UrdfWriter, pose_of
from excite.robot.refusal import robot_error
from excite.robot.urdf.limits import symmetric_limit

_TRANSMISSION = mujoco.mjtTrn
_ON_JOINT = (int(_TRANSMISSION.mjTRN_JOINT), int(_TRANSMISSION.mjTRN_JOINTINPARENT))
_ON_TENDON = int(_TRANSMISSION.mjTRN_TENDON)
_CONNECT, _WELD, _JOINT, _TENDON = (
    int(kind)
    for kind in (
        mujoco.mjtEq.mjEQ_CONNECT,
        mujoco.mjtEq.mjEQ_WELD,
        mujoco.mjtEq.mjEQ_JOINT,
        mujoco.mjtEq.mjEQ_TENDON,
    )
)


def robot_root(model: mujoco.MjModel, path: Path) -> tuple[int, tuple[int, ...]]:
    """Body that floats, 0 for a robot that is bolted down; and trees that are no part of it.

    Those are objects about it, free bodies without joints, and, beside a robot that floats, bodies without geometry
    that stand for joints which this version of it lacks.

    Raises:
        RobotError: several trees move on their own, and more than one of them has joints or one floats.
    """
    free = set(model.jnt_bodyid[model.jnt_type == FREE].tolist())
    trees, joints = np.unique(model.body_rootid[model.jnt_bodyid], return_counts=True)
    sizes = dict(zip(trees.tolist(), joints.tolist(), strict=True))
    solid = set(model.body_rootid[model.geom_bodyid].tolist())
    floats = any(sizes[tree] > 1 and tree in solid for tree in free)
    objects = tuple(
        tree for tree, size in sizes.items() if (tree in free and size == 1) or (floats and tree not in solid)
    )
    robots = [tree for tree in sizes if tree not in objects]
    if (len(robots) > 1 and free - set(objects)) or (not robots and len(objects) > 1):
        moving = robots or list(objects)
        names = ", ".join(repr(model.body(body).name) for body in moving)
        what = f"holds {len(moving)} bodies that move on their own: {names}"
        raise robot_error(path, "worldbody", what, "keep the robot alone")
    if not robots and objects:
        return objects[0], ()
    return min(free - set(objects), default=0), objects


# Which joints of a MuJoCo model its motors drive, with what largest torque, and within what commands.


def single_joints(model: mujoco.MjModel, kinds: Collection[int] = (HINGE, SLIDE)) -> list[int]:
    """Joints of some kinds: hinges and slides."""
    return [int(joint) for joint in np.flatnonzero(np.isin(model.jnt_type, list(kinds)))]


def torque_limits(model: mujoco.MjModel) -> dict[int, float]:
    """Largest torque of each joint: its own force range, or its motor's where that is less, the same either way."""
    limits = {
        int(j): symmetric_limit(*model.jnt_actfrcrange[j]) for j in np.flatnonzero(model.jnt_actfrclimited)
    }
    for k in np.flatnonzero(model.actuator_trntype == _ON_JOINT[0]):
        joint, most = int(model.actuator_trnid[k, 0]), abs(float(model.actuator_gear[k, 0]))
        if model.actuator_forcelimited[k]:
            most *= symmetric_limit(*model.actuator_forcerange[k])
        elif model.actuator_biastype[k] == mujoco.mjtBias.mjBIAS_NONE and model.actuator_ctrllimited[k]:
            most *= abs(float(model.actuator_gainprm[k, 0])) * symmetric_limit(*model.actuator_ctrlrange[k])
        else:
            continue
        limits[joint] = min(most, limits.get(joint, math.inf))
    return limits


def narrow_to_commands(model: mujoco.MjModel) -> list[int]:
    """Narrow joints' ranges to what their position servos may be told, and name those that this changed.

    A servo of gear one whose force is ``kp (ctrl - q)`` is told a position, and MuJoCo keeps that in ``ctrlrange``.
    """
    gain = model.actuator_gainprm[:, 0]
    servo = (
        (model.actuator_trntype == _ON_JOINT[0])
        & (model.actuator_biastype == int(mujoco.mjtBias.mjBIAS_AFFINE))
        & (gain > 0.0)
        & np.isclose(model.actuator_biasprm[:, 1], -gain)
        & (model.actuator_gear[:, 0] == 1.0)
        & (model.actuator_ctrllimited != 0)
    )
    changed = []
    for actuator in np.flatnonzero(servo):
        joint = int(model.actuator_trnid[actuator, 0])
        low, high = model.actuator_ctrlrange[actuator]
        if model.jnt_limited[joint]:
            stated = model.jnt_range[joint]
            low, high = max(low, stated[0]), min(high, stated[1])
            if low >= high or (low == stated[0] and high == stated[1]):
                continue
        model.jnt_limited[joint], model.jnt_range[joint] = 1, (low, high)
        changed.append(joint)
    return changed


def idle_joints(model: mujoco.MjModel, kinds: Collection[int] = (HINGE, SLIDE)) -> set[int]:
    """Joints of some kinds on which no motor acts directly, such as an acrobot's shoulder or a caster's ball.

    None of a model without motors, which does not tell, or, of hinges and slides, with motors that act on sites or
    bodies, which may move any.
    """
    direct = np.isin(model.actuator_trntype, _ON_JOINT)
    told = direct | (model.actuator_trntype == _ON_TENDON)
    if (not direct.any() and (not model.nu or HINGE not in kinds)) or (HINGE in kinds and not told.all()):
        return set()
    return set(single_joints(model, kinds)) - set(model.actuator_trnid[direct, 0].tolist())


def tendon_groups(model: mujoco.MjModel) -> list[set[int]]:
    """Joints that an actuator drives through a tendon, together with others, actuator by actuator."""
    driving = np.flatnonzero(model.actuator_trntype == _ON_TENDON)
    return [set(_tendon_joints(model, int(model.actuator_trnid[k, 0]))) for k in driving]


def _tendon_joints(model: mujoco.MjModel, tendon: int) -> dict[int, float]:
    """Joints of a fixed tendon with their factors; nothing of a tendon below zero, which is none."""
    places = model.tendon_adr[tendon] + np.arange(model.tendon_num[tendon]) if tendon >= 0 else ()
    return {int(model.wrap_objid[k]): float(model.wrap_prm[k]) for k in places}


def driven_joints(model: mujoco.MjModel) -> set[int]:
    """Joints with an actuator; of those that one drives together through a tendon, the first that is left for it."""
    coupled = (model.eq_active0 != 0) & (model.eq_type == _JOINT)
    followers = set(model.eq_obj1id[coupled].tolist())
    driven: set[int] = set()
    for kind, target in zip(model.actuator_trntype, model.actuator_trnid[:, 0].tolist(), strict=True):
        if kind == _ON_TENDON:
            driven |= set(sorted(_tendon_joints(model, target).keys() - followers - driven)[:1])
        elif kind in _ON_JOINT:
            driven.add(target)
    return driven


# Closed loops and coupled joints of a MuJoCo model, and which of their joints no motor drives.


@dataclass(eq=False)
class Closures:
    """What ties joints of a MuJoCo model together.

    Attributes:
        solved: numbers of the equalities that a description can hold.
        passive: joints that follow from the others in those, by the first of the equalities that share joints.
        held: joints of other equalities, by why they cannot be told from the motors.
        still: joints that an equality holds at one value, with it [rad or m], from the reference position.
        handles: numbers of equalities with a body that a program moves (mocap), which no machine has.
    """

    solved: list[int] = field(default_factory=list)
    passive: dict[int, set[int]] = field(default_factory=dict)
    held: dict[str, set[int]] = field(default_factory=dict)
    still: dict[int, float] = field(default_factory=dict)
    handles: list[int] = field(default_factory=list)


def read_closures(model: mujoco.MjModel, path: Path) -> Closures:
    """Sort a model's equalities by whether their joints without a motor follow from those with one.

    Raises:
        RobotError: an equality ties bodies between which no joint moves, or is of a kind that no description has.
    """
    found, tied = Closures(), dict[int, set[int]]()
    for number in np.flatnonzero(model.eq_active0).tolist():
        kind, where = int(model.eq_type[number]), f"equality {model.equality(number).name or number}"
        first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        if kind in {_CONNECT, _WELD}:
            bodies = [body for body, _ in _loop_ends(model, number)]
            if (model.body_mocapid[bodies] >= 0).any():
                found.handles.append(number)
                continue
            between = set(_to_root(model, bodies[0])) ^ set(_to_root(model, bodies[1]))
            tied[number] = {
                int(joint)
                for joint in np.flatnonzero(model.jnt_type != FREE)
                if int(model.jnt_bodyid[joint]) in between
            }
            if not tied[number]:
                what = (
                    f"{'connects' if kind == _CONNECT else 'welds'} two bodies between which no joint moves"
                )
                raise robot_error(
                    path, where, what, "remove it: a base that is bolted down has no free joint"
                )
        elif kind == _JOINT and second < 0:
            found.still[first] = float(model.eq_data[number, 0])
        elif kind == _JOINT:
            tied[number] = {first, second}
        elif kind == _TENDON and not np.any(model.eq_data[number, 2:5]):
            tied[number] = {*_tendon_joints(model, first), *_tendon_joints(model, second)}
        else:
            what = "is an equality of a kind that is not modelled"
            remedy = "remove it, or say it with connect, weld, joint or fixed tendons"
            raise robot_error(path, where, what, remedy)
    jacobian = _equality_jacobian(model) if tied else {}
    # Equalities that share joints.
    for group in join_overlapping(frozenset(joints) for joints in tied.values()):
        numbers = sorted(number for number, joints in tied.items() if joints <= group)
        passive = _passive_joints(model, np.vstack([jacobian[k] for k in numbers]), sorted(group))
        if isinstance(passive, str):
            found.held.setdefault(passive, set()).update(group)
        else:
            found.solved += numbers
            found.passive[numbers[0]] = passive
    return found


def _to_root(model: mujoco.MjModel, body: int) -> list[int]:
    return [body, *_to_root(model, int(model.body_parentid[body]))] if body else []


def _loop_ends(model: mujoco.MjModel, number: int) -> list[tuple[int, pin.SE3]]:
    """Bodies that an equality of bodies or sites ties, and frames on them that meet."""
    first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
    if model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_SITE:
        places = [pose_of(model.site_pos[k], model.site_quat[k]) for k in (first, second)]
        return list(zip(model.site_bodyid[[first, second]].tolist(), places, strict=True))
    data, level = model.eq_data[number], np.array([1.0, 0.0, 0.0, 0.0])
    if model.eq_type[number] == _CONNECT:
        return [(first, pose_of(data[:3], level)), (second, pose_of(data[3:6], level))]
    return [(first, pose_of(data[3:6], data[6:10])), (second, pose_of(data[:3], level))]


def _equality_jacobian(model: mujoco.MjModel) -> dict[int, Array]:
    """Rows of each equality's Jacobian a little off the reference position, where few mechanisms are singular."""
    option = int(model.opt.jacobian)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    mujoco.mj_integratePos(model, data.qpos, 0.02 * rng.uniform(-1.0, 1.0, model.nv), 1.0)
    mujoco.mj_forward(model, data)
    model.opt.jacobian = option
    rows = data.efc_J.reshape(-1, model.nv)[: data.nefc]
    numbers = np.where(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY, data.efc_id, -1)[: data.nefc]
    return {k: rows[numbers == k].copy() for k in np.flatnonzero(model.eq_active0).tolist()}


def _passive_joints(model: mujoco.MjModel, jacobian: Array, joints: list[int]) -> set[int] | str:
    """Joints that follow from those with motors, or why they do not."""
    columns = jacobian[:, model.jnt_dofadr[joints]]
    scale = float(np.abs(columns).max(initial=0.0))

    def rank_of(which: list[int]) -> int:
        return int(np.linalg.matrix_rank(columns[:, which], tol=SINGULAR * scale)) if which else 0

    driven = driven_joints(model)
    loose = [k for k, joint in enumerate(joints) if joint not in driven]
    if not model.nu:
        # Nobody says where the motors are: at the joints nearest to the root.
        loose = []
        for k in reversed(range(len(joints))):
            loose += [k] if rank_of([*loose, k]) > len(loose) else []
    if rank_of(loose) < len(loose):
        return "joints of a closed loop with fewer motors than freedoms"
    if len(loose) < rank_of(list(range(len(joints)))):
        return "joints of a closed loop with more motors than freedoms"
    return {joints[k] for k in loose}


def find_mimics(model: mujoco.MjModel, closures: Closures) -> dict[int, Mimic]:
    """Joints without a motor that follow another one by a factor and an offset, and no other equality: mimic joints."""
    found = {}
    for number, passive in closures.passive.items():
        follower, data = int(model.eq_obj1id[number]), model.eq_data[number]
        alone = model.eq_type[number] == _JOINT and passive == {follower}
        if alone and data[1] and not np.any(data[2:5]):
            # MuJoCo couples differences from the reference positions, which are zero in the URDF.
            found[follower] = Mimic(int(model.eq_obj2id[number]), float(data[1]), float(data[0]))
    return found


class TieBlocks(NamedTuple):
    """Blocks ``loops`` and ``couplings`` of a ``robot.yaml``."""

    loops: list[dict[str, Any]]
    couplings: list[dict[str, Any]]


def write_ties(model: mujoco.MjModel, closures: Closures, writer: UrdfWriter) -> TieBlocks:
    """What a description holds of a model's equalities, once the URDF, which has the mimic joints, is written."""
    kinds, found = {_CONNECT: "point", _WELD: "weld"}, TieBlocks([], [])
    for number in closures.solved:
        kind, data = int(model.eq_type[number]), model.eq_data[number]
        first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        name = model.equality(number).name or f"equality_{number}"
        passive = [writer.joint_name(joint) for joint in sorted(closures.passive.get(number, ()))]
        told = {"passive": passive, "source": "the MuJoCo model's equality"}
        if kind in kinds:
            ends = [_end_block(writer, *end) for end in _loop_ends(model, number)]
            found.loops.append({"name": name, "kind": kinds[kind], "ends": ends, **told})
            continue
        if kind == _TENDON:
            joints: dict[int, Any] = {**_tendon_joints(model, first)}
            for joint, factor in _tendon_joints(model, second).items():
                joints[joint] = joints.get(joint, 0.0) - float(data[1]) * factor
        elif first in writer.mimics and passive:
            continue
        else:
            powers = [-float(x) for x in np.trim_zeros(data[1:5], "b")] or [0.0]
            joints = {first: 1.0, second: powers if len(powers) > 1 else powers[0]}
        ratios = {writer.joint_name(joint): factors for joint, factors in joints.items()}
        found.couplings.append({"name": name, "joints": ratios, "offset": float(data[0]), **told})
    return found


def _end_block(writer: UrdfWriter, body: int, place: pin.SE3) -> dict[str, Any]:
    link = pin.SE3(np.eye(3), -writer.anchors.get(body, np.zeros(3))) * place
    rpy = pin.rpy.matrixToRpy(link.rotation)
    turned = {"rpy": [float(x) for x in rpy]} if np.abs(rpy).max() > 0.0 else {}
    return {"link": writer.link_name(body), "xyz": [float(x) + 0.0 for x in link.translation], **turned}
