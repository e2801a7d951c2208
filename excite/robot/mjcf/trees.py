"""Which trees of a MuJoCo model are the robot, and which of its joints close loops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.mechanisms.closures import SINGULAR, join_overlapping
from excite.robot.mjcf.urdf import Mimic, pose_of
from excite.robot.refusal import robot_error

if TYPE_CHECKING:
    import mujoco


def robot_root(model: mujoco.MjModel, path: Path) -> tuple[int, tuple[int, ...]]:
    """Body that floats, 0 for a robot that is bolted down; and trees that are no part of it.

    Those are objects about it, free bodies without joints, and, beside a robot that floats, bodies without geometry
    that stand for joints which this version of it lacks.

    Raises:
        RobotError: several trees move on their own, and more than one of them has joints or one floats.
    """
    import mujoco

    free = {
        int(model.jnt_bodyid[j]) for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE
    }
    trees = sorted({int(model.body_rootid[model.jnt_bodyid[j]]) for j in range(model.njnt)})
    joints = {tree: int(sum(model.body_rootid[model.jnt_bodyid] == tree)) for tree in trees}
    solid = {int(root) for root in model.body_rootid[model.geom_bodyid]}
    floats = any(joints[tree] > 1 and tree in solid for tree in trees if tree in free)
    objects = tuple(
        tree for tree in trees if (tree in free and joints[tree] == 1) or (floats and tree not in solid)
    )
    robots = [tree for tree in trees if tree not in objects]
    if (len(robots) > 1 and free - set(objects)) or (not robots and len(objects) > 1):
        moving = robots or list(objects)
        names = ", ".join(repr(model.body(body).name) for body in moving)
        raise robot_error(
            path,
            "worldbody",
            f"holds {len(moving)} bodies that move on their own: {names}",
            "keep the robot alone",
        )
    if not robots and objects:
        return objects[0], ()
    floating = sorted(free - set(objects))
    return (floating[0] if floating else 0), objects


def loop_joints(model: mujoco.MjModel, number: int, path: Path) -> set[int]:
    """Hinges and slides between the two bodies that an equality connects or welds: they move in a closed loop.

    Raises:
        RobotError: there is no such joint.
    """
    import mujoco

    first, second = (_to_root(model, body) for body in _tied_bodies(model, number))
    between = set(first) ^ set(second)
    found = {
        joint
        for joint in range(model.njnt)
        if int(model.jnt_bodyid[joint]) in between and model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE
    }
    if not found:
        word = "connects" if model.eq_type[number] == mujoco.mjtEq.mjEQ_CONNECT else "welds"
        raise robot_error(
            path,
            f"equality {model.equality(number).name or number}",
            f"{word} two bodies between which no joint moves",
            "remove it: a base that is bolted down has no free joint",
        )
    return found


def _tied_bodies(model: mujoco.MjModel, number: int) -> list[int]:
    """The two bodies that an equality of bodies or of sites ties."""
    import mujoco

    ends = [int(model.eq_obj1id[number]), int(model.eq_obj2id[number])]
    sites = model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_SITE
    return [int(model.site_bodyid[site]) for site in ends] if sites else ends


def _to_root(model: mujoco.MjModel, body: int) -> list[int]:
    chain = []
    while body:
        chain.append(body)
        body = int(model.body_parentid[body])
    return chain


# Closed loops and coupled joints of a MuJoCo model, and which of their joints no motor drives.


@dataclass(frozen=True, eq=False)
class MjcfClosures:
    """What ties joints of a MuJoCo model together.

    Attributes:
        solved: numbers of the equalities that a description can hold.
        passive: joints that follow from the others in those, by the first of the equalities that share joints.
        held: joints of other equalities, by why they cannot be told from the motors.
        still: joints that an equality holds at one value, with it [rad or m], from the reference position.
        handles: numbers of equalities with a body that a program moves (mocap), which no machine has.
    """

    solved: tuple[int, ...]
    passive: dict[int, set[int]]
    held: dict[str, set[int]]
    still: dict[int, float]
    handles: tuple[int, ...] = ()


def read_closures(model: mujoco.MjModel, path: Path) -> MjcfClosures:
    """Sort a model's equalities by whether their joints without a motor follow from those with one.

    Raises:
        RobotError: an equality ties bodies between which no joint moves, or is of a kind that no description has.
    """
    import mujoco

    tied: dict[int, set[int]] = {}
    still: dict[int, float] = {}
    handles = tuple(int(k) for k in np.flatnonzero(model.eq_active0) if _is_handle(model, int(k)))
    for number in (int(k) for k in np.flatnonzero(model.eq_active0) if k not in handles):
        kind = mujoco.mjtEq(int(model.eq_type[number]))
        if kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            tied[number] = loop_joints(model, number, path)
        elif kind == mujoco.mjtEq.mjEQ_JOINT and model.eq_obj2id[number] < 0:
            still[int(model.eq_obj1id[number])] = float(model.eq_data[number, 0])
        elif kind == mujoco.mjtEq.mjEQ_JOINT:
            tied[number] = {int(model.eq_obj1id[number]), int(model.eq_obj2id[number])}
        elif kind == mujoco.mjtEq.mjEQ_TENDON and not np.any(model.eq_data[number, 2:5]):
            ends = [int(k) for k in (model.eq_obj1id[number], model.eq_obj2id[number]) if k >= 0]
            tied[number] = {joint for tendon in ends for joint, _ in tendon_joints(model, tendon)}
        else:
            raise robot_error(
                path,
                f"equality {model.equality(number).name or number}",
                "is an equality of a kind that is not modelled",
                "remove it, or say it with connect, weld, joint or fixed tendons",
            )
    passive: dict[int, set[int]] = {}
    held: dict[str, set[int]] = {}
    solved: list[int] = []
    jacobian = _equality_jacobian(model) if tied else {}
    for numbers in _group_equalities(tied):
        joints = set().union(*(tied[k] for k in numbers))
        why, found = _passive_joints(model, np.vstack([jacobian[k] for k in numbers]), joints)
        if why:
            held.setdefault(why, set()).update(joints)
        else:
            solved += sorted(numbers)
            passive[min(numbers)] = found
    return MjcfClosures(tuple(solved), passive, held, still, handles)


def _is_handle(model: mujoco.MjModel, number: int) -> bool:
    """Whether an equality ties a body to one that a program moves."""
    import mujoco

    kind = mujoco.mjtEq(int(model.eq_type[number]))
    if kind not in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
        return False
    return bool((model.body_mocapid[_tied_bodies(model, number)] >= 0).any())


def find_mimics(model: mujoco.MjModel, closures: MjcfClosures) -> dict[int, Mimic]:
    """Joints without a motor that follow another one by a factor and an offset, and no other equality: mimic joints."""
    import mujoco

    found = {}
    for number, passive in closures.passive.items():
        follower, master = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        data = model.eq_data[number]
        alone = model.eq_type[number] == mujoco.mjtEq.mjEQ_JOINT and passive == {follower}
        if alone and data[1] and not np.any(data[2:5]):
            # MuJoCo couples differences from the reference positions, which are zero in the URDF.
            found[follower] = Mimic(master, float(data[1]), float(data[0]))
    return found


def tendon_joints(model: mujoco.MjModel, tendon: int) -> list[tuple[int, float]]:
    """Joints of a fixed tendon with their factors."""
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    places = range(first, first + count)
    return [(int(model.wrap_objid[k]), float(model.wrap_prm[k])) for k in places]


def _group_equalities(tied: dict[int, set[int]]) -> list[list[int]]:
    """Equalities that share joints."""
    groups = join_overlapping(frozenset(joints) for joints in tied.values())
    return [sorted(number for number, joints in tied.items() if joints <= group) for group in groups]


def _equality_jacobian(model: mujoco.MjModel) -> dict[int, Array]:
    """Rows of each equality's Jacobian a little off the reference position, where few mechanisms are singular."""
    import mujoco

    option = int(model.opt.jacobian)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    mujoco.mj_integratePos(model, data.qpos, 0.02 * rng.uniform(-1.0, 1.0, model.nv), 1.0)
    mujoco.mj_forward(model, data)
    rows = data.efc_J.reshape(-1, model.nv)[: data.nefc]
    equality = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    found = {
        int(k): rows[equality & (data.efc_id[: data.nefc] == k)].copy()
        for k in np.flatnonzero(model.eq_active0)
    }
    model.opt.jacobian = option
    return found


def _passive_joints(model: mujoco.MjModel, jacobian: Array, joints: set[int]) -> tuple[str, set[int]]:
    """Joints that follow from those with motors, or why they do not."""
    order = sorted(joints)
    columns = jacobian[:, [int(model.jnt_dofadr[joint]) for joint in order]]
    scale = float(np.abs(columns).max(initial=0.0))

    def rank(which: list[int]) -> int:
        return int(np.linalg.matrix_rank(columns[:, which], tol=SINGULAR * scale)) if which else 0

    driven = driven_joints(model)
    loose = [k for k, joint in enumerate(order) if joint not in driven]
    whole = rank(list(range(len(order))))
    if not model.nu:
        # Nobody says where the motors are: at the joints nearest to the root.
        loose = []
        for k in reversed(range(len(order))):
            if rank([*loose, k]) == len(loose) + 1:
                loose.append(k)
    if rank(loose) < len(loose):
        return "joints of a closed loop with fewer motors than freedoms", set()
    if len(loose) < whole:
        return "joints of a closed loop with more motors than freedoms", set()
    return "", {order[k] for k in loose}


def driven_joints(model: mujoco.MjModel) -> set[int]:
    """Joints with an actuator; of those that one drives together through a tendon, the first that is left for it."""
    import mujoco

    followers = {
        int(model.eq_obj1id[k])
        for k in np.flatnonzero(model.eq_active0)
        if model.eq_type[k] == mujoco.mjtEq.mjEQ_JOINT
    }
    driven: set[int] = set()
    for actuator in range(model.nu):
        target = int(model.actuator_trnid[actuator, 0])
        kind = mujoco.mjtTrn(int(model.actuator_trntype[actuator]))
        if kind == mujoco.mjtTrn.mjTRN_TENDON:
            joints = {joint for joint, _ in tendon_joints(model, target)}
            driven |= set(sorted(joints - followers - driven)[:1])
        elif kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            driven.add(target)
    return driven


# Equalities of a MuJoCo model as blocks ``loops`` and ``couplings`` of a ``robot.yaml``.

_SOURCE = "the MuJoCo model's equality"


@dataclass(frozen=True, eq=False)
class BlockWriter:
    """Writes equalities as blocks of a ``robot.yaml``.

    Attributes:
        model: the compiled model.
        closures: its equalities.
        joint_name: of a joint's number.
        link_name: of a body's number.
        anchor: of each body, where its link's frame is in the body's frame ``(3,)`` [m].
    """

    model: mujoco.MjModel
    closures: MjcfClosures
    joint_name: Callable[[int], str]
    link_name: Callable[[int], str]
    anchor: dict[int, Array]

    def loops(self) -> tuple[dict[str, Any], ...]:
        """Blocks of ``loops``."""
        import mujoco

        kinds = {mujoco.mjtEq.mjEQ_CONNECT: "point", mujoco.mjtEq.mjEQ_WELD: "weld"}
        found = [
            (number, kinds[kind])
            for number in self.closures.solved
            if (kind := mujoco.mjtEq(int(self.model.eq_type[number]))) in kinds
        ]
        return tuple(
            {
                "name": self._name(number),
                "kind": kind,
                "ends": [self._end(*end) for end in _loop_ends(self.model, number)],
                "passive": self._passive(number),
                "source": _SOURCE,
            }
            for number, kind in found
        )

    def couplings(self) -> tuple[dict[str, Any], ...]:
        """Blocks of ``couplings``."""
        import mujoco

        found, written = [], find_mimics(self.model, self.closures)
        for number in self.closures.solved:
            if int(self.model.eq_obj1id[number]) in written and self.closures.passive.get(number):
                continue
            kind, data = mujoco.mjtEq(int(self.model.eq_type[number])), self.model.eq_data[number]
            ends = [int(self.model.eq_obj1id[number]), int(self.model.eq_obj2id[number])]
            if kind == mujoco.mjtEq.mjEQ_JOINT:
                powers = [-float(x) for x in np.trim_zeros(data[1:5], "b")] or [0.0]
                joints: dict[int, list[float]] = {ends[0]: [1.0], ends[1]: powers}
            elif kind == mujoco.mjtEq.mjEQ_TENDON:
                joints = {joint: [factor] for joint, factor in tendon_joints(self.model, ends[0])}
                for joint, factor in tendon_joints(self.model, ends[1]) if ends[1] >= 0 else ():
                    joints[joint] = [joints.get(joint, [0.0])[0] - float(data[1]) * factor]
            else:
                continue
            found.append(
                {
                    "name": self._name(number),
                    "joints": {
                        self.joint_name(joint): factors[0] if len(factors) == 1 else factors
                        for joint, factors in joints.items()
                    },
                    "offset": float(data[0]),
                    "passive": self._passive(number),
                    "source": _SOURCE,
                }
            )
        return tuple(found)

    def _name(self, number: int) -> str:
        return self.model.equality(number).name or f"equality_{number}"

    def _passive(self, number: int) -> list[str]:
        return [self.joint_name(joint) for joint in sorted(self.closures.passive.get(number, ()))]

    def _end(self, body: int, place: pin.SE3) -> dict[str, Any]:
        link = pin.SE3(np.eye(3), -self.anchor.get(body, np.zeros(3))) * place
        rpy = pin.rpy.matrixToRpy(link.rotation)
        return {
            "link": self.link_name(body),
            "xyz": [float(x) + 0.0 for x in link.translation],
            **({"rpy": [float(x) for x in rpy]} if np.abs(rpy).max() > 0.0 else {}),
        }


def _loop_ends(model: mujoco.MjModel, number: int) -> list[tuple[int, pin.SE3]]:
    """Bodies that an equality of bodies or sites ties, and frames on them that meet."""
    import mujoco

    ids = (int(model.eq_obj1id[number]), int(model.eq_obj2id[number]))
    if model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_SITE:
        return [(int(model.site_bodyid[k]), pose_of(model.site_pos[k], model.site_quat[k])) for k in ids]
    data, level = model.eq_data[number], np.array([1.0, 0.0, 0.0, 0.0])
    if model.eq_type[number] == mujoco.mjtEq.mjEQ_CONNECT:
        return [(ids[0], pose_of(data[:3], level)), (ids[1], pose_of(data[3:6], level))]
    return [(ids[0], pose_of(data[3:6], data[6:10])), (ids[1], pose_of(data[:3], level))]
