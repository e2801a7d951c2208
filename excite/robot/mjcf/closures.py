"""Closed loops and coupled joints of a MuJoCo model, and which of their joints no motor drives."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.errors import RobotError
from excite.robot.mechanisms.closures import SINGULAR
from excite.robot.mjcf.trees import loop_joints
from excite.robot.mjcf.urdf import Mimic

if TYPE_CHECKING:
    import mujoco


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
            raise RobotError(
                "is an equality of a kind that is not modelled",
                source=path,
                field=f"equality {model.equality(number).name or number}",
                remedy="remove it, or say it with connect, weld, joint or fixed tendons",
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
    ends = [int(model.eq_obj1id[number]), int(model.eq_obj2id[number])]
    if model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_SITE:
        ends = [int(model.site_bodyid[end]) for end in ends]
    return bool((model.body_mocapid[ends] >= 0).any())


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
    groups: list[tuple[list[int], set[int]]] = []
    for number, joints in tied.items():
        touched = [group for group in groups if group[1] & joints]
        groups = [group for group in groups if not group[1] & joints]
        numbers = [k for group in touched for k in group[0]] + [number]
        groups.append((numbers, joints.union(*(group[1] for group in touched))))
    return [sorted(numbers) for numbers, _ in groups]


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
