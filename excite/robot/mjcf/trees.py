"""Which trees of a MuJoCo model are the robot, and which of its joints close loops."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from excite.errors import RobotError

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
        raise RobotError(
            f"holds {len(moving)} bodies that move on their own: {names}",
            source=path,
            field="worldbody",
            remedy="keep the robot alone",
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

    ends = [int(model.eq_obj1id[number]), int(model.eq_obj2id[number])]
    if model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_SITE:
        ends = [int(model.site_bodyid[site]) for site in ends]
    first, second = (_to_root(model, body) for body in ends)
    between = set(first) ^ set(second)
    found = {
        joint
        for joint in range(model.njnt)
        if int(model.jnt_bodyid[joint]) in between and model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE
    }
    if not found:
        word = "connects" if model.eq_type[number] == mujoco.mjtEq.mjEQ_CONNECT else "welds"
        raise RobotError(
            f"{word} two bodies between which no joint moves",
            source=path,
            field=f"equality {model.equality(number).name or number}",
            remedy="remove it: a base that is bolted down has no free joint",
        )
    return found


def _to_root(model: mujoco.MjModel, body: int) -> list[int]:
    chain = []
    while body:
        chain.append(body)
        body = int(model.body_parentid[body])
    return chain
