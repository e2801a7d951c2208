"""The mechanism that a robot's description and its URDF make of a tree of joints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import MotionError, RobotError
from excite.robot.links import link_placement
from excite.robot.mechanisms.closures import Closure, Coupling, CouplingBlock, Loop, LoopBlock, Rod, TieBlock
from excite.robot.mechanisms.mechanism import Mechanism, build_mechanism
from excite.robot.quantities import MAX_RATIO
from excite.robot.urdf.numbers import read_numbers


def mimic_couplings(root: ElementTree.Element, path: Path) -> tuple[CouplingBlock, ...]:
    """Couplings of the mimic joints of a URDF as :func:`~excite.robot.urdf.reading.read_urdf` leaves it.

    Raises:
        RobotError: a joint follows itself or one that is not there, or by a number that is none.
    """
    names = {joint.get("name", "") for joint in root.findall("joint")}
    found = []
    for joint in root.findall("joint"):
        name, mimic = joint.get("name", ""), joint.find("mimic")
        if mimic is None or joint.get("type") == "fixed":
            continue
        where, master = f"joint {name!r}/mimic", mimic.get("joint", "")
        if master not in names or master == name:
            raise RobotError(
                f"follows joint {master!r}, " + ("itself" if master == name else "which is not there"),
                source=path,
                field=where,
                remedy="name the joint that it follows, or hold it still under locked_joints in robot.yaml",
            )
        (factor,) = read_numbers(mimic, "multiplier", 1, path, where, default="1")
        (offset,) = read_numbers(mimic, "offset", 1, path, where, default="0")
        if not 1.0 / MAX_RATIO**2 < abs(factor) < MAX_RATIO**2:
            raise RobotError(
                f"follows by a factor of {factor:g}",
                source=path,
                field=where,
                remedy=f"make {name!r} a fixed joint",
            )
        found.append(
            CouplingBlock(
                name=name, joints={name: 1.0, master: -factor}, offset=offset, passive=(name,), source="URDF"
            )
        )
    return tuple(found)


def read_mechanism(
    model: pin.Model,
    loops: tuple[LoopBlock, ...],
    couplings: tuple[CouplingBlock, ...],
    rest: Array,
    carrying: Sequence[int],
    path: Path,
) -> Mechanism | None:
    """The mechanism of a model, None where nothing closes it.

    Args:
        model: the tree.
        loops: of the description.
        couplings: of the description and of the URDF.
        rest: configuration near which it is closed ``(nq,)``; passive joints are a guess, but for those of legs.
        carrying: model joints that carry feet, which stay where ``rest`` has them if others can close the loops.
        path: file to name in errors.

    Raises:
        RobotError: a joint or link is not there, several blocks have one name, or the passive joints do not follow
            from the others.
    """
    blocks: tuple[TieBlock, ...] = (*loops, *couplings)
    if not blocks:
        return None
    closures: list[Closure] = [_read_loop(model, block, path) for block in loops]
    closures += [_read_coupling(model, block, path) for block in couplings]
    passive = tuple(dict.fromkeys(name for block in blocks for name in block.passive))
    for block in blocks:
        for name in block.passive:
            _joint_column(model, name, f"{_block_field(block)}.passive", path)
    if not passive:
        raise RobotError(
            "leave every joint a motor of its own",
            source=path,
            field="loops" if loops else "couplings",
            remedy="name under passive the joints that follow from the others",
        )
    try:
        return build_mechanism(model, closures, passive, rest, carrying)
    except MotionError as error:
        raise RobotError(
            f"{error.what.replace(' at sample 0', '')}",
            source=path,
            field=error.field,
            remedy="check ends, posture and passive joints: as many of these as the loops determine",
        ) from error


def _block_field(block: TieBlock) -> str:
    return f"{'loops' if isinstance(block, LoopBlock) else 'couplings'}.{block.name}"


def _read_loop(model: pin.Model, block: LoopBlock, path: Path) -> Closure:
    ends = []
    for number, end in enumerate(block.ends):
        joint, link = link_placement(model, end.link, path, f"{_block_field(block)}.ends.{number}.link")
        ends.append((joint, link * pin.SE3(pin.rpy.rpyToMatrix(*end.rpy), np.array(end.xyz))))
    joints, placements = (ends[0][0], ends[1][0]), (ends[0][1], ends[1][1])
    if joints[0] == joints[1]:
        raise RobotError(
            f"{block.ends[0].link!r} and {block.ends[1].link!r} do not move against each other",
            source=path,
            field=_block_field(block),
            remedy="remove it",
        )
    if block.kind != "rod":
        return Loop(block.name, joints, placements, rigid=block.kind == "weld")
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    points = [data.oMi[joint].act(place.translation) for joint, place in ends]
    length = float(np.linalg.norm(points[1] - points[0])) if block.length is None else block.length
    if length < 1e-6:
        raise RobotError(
            "has no length", source=path, field=_block_field(block), remedy="make it a loop of kind point"
        )
    return Rod(block.name, joints, placements, length)


def _read_coupling(model: pin.Model, block: CouplingBlock, path: Path) -> Coupling:
    columns = tuple(
        _joint_column(model, name, f"{_block_field(block)}.joints", path) for name in block.joints
    )
    factors = tuple(block.factors(name) for name in block.joints)
    return Coupling(block.name, columns, factors, block.offset)


def _joint_column(model: pin.Model, name: str, field: str, path: Path) -> tuple[int, int]:
    """A joint's index into q and v."""
    if not model.existJointName(name) or model.joints[model.getJointId(name)].nq != 1:
        moving = ", ".join(list(model.names)[1:])
        raise RobotError(
            f"no joint {name!r} that moves", source=path, field=field, remedy=f"the model has {moving}"
        )
    joint = model.getJointId(name)
    return int(model.idx_qs[joint]), int(model.idx_vs[joint])
