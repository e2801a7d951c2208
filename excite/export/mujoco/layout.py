"""Where a MuJoCo model keeps the state of its joints, and what drives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.arrays import Array
from excite.errors import InputError
from excite.reading.child import in_child
from excite.robot.mjcf.scan import scan_mjcf

if TYPE_CHECKING:
    # What compiles a model for it does so in a process that needs no robot.
    from excite.robot.robot import Robot

# What an actuator's control is, per unit of the joint it drives.
POSITION, VELOCITY, OTHER = "position", "velocity", "other"


@dataclass(frozen=True, eq=False)
class Actuator:
    """An actuator of one joint: its name, what its control is, and its gear."""

    joint: str
    kind: str
    gear: float


@dataclass(frozen=True, eq=False)
class Layout:
    """Addresses in ``qpos`` and ``qvel``.

    Attributes:
        qpos: ``(nq,)`` where nobody says otherwise: the model's reference, which is zero of the robot's joints.
        n_dof: length of ``qvel``.
        positions: by joint of one coordinate, its address in ``qpos``.
        velocities: by joint, its address in ``qvel``.
        free: addresses of the first free joint in ``qpos`` and in ``qvel``, None without one.
        actuators: in the order of ``ctrl``.
    """

    qpos: Array
    n_dof: int
    positions: Mapping[str, int]
    velocities: Mapping[str, int]
    free: tuple[int, int] | None
    actuators: tuple[Actuator, ...]


def robot_layout(robot: Robot) -> Layout:
    """Of the model that ``excite model --format mjcf`` writes of a robot: its own order, a position servo a joint."""
    names = robot.joint_names
    return Layout(
        np.zeros(robot.model.nq),
        robot.model.nv,
        {name: robot.n_base_q + i for i, name in enumerate(names)},
        {name: robot.n_base_v + i for i, name in enumerate(names)},
        (0, 0) if robot.floating else None,
        tuple(Actuator(name, POSITION, 1.0) for name in names),
    )


def model_layout(path: Path, robot: Robot) -> Layout:
    """Of a MuJoCo model that somebody has; joints that the robot holds locked are where it holds them.

    Raises:
        InputError: MuJoCo cannot compile it, or it lacks a joint of the robot, or its free base.
    """
    scan_mjcf(path)
    layout: Layout = in_child(
        "excite.export.mujoco.layout:compiled_layout", path, source=path, error=InputError
    )
    missing = [name for name in robot.joint_names if name not in layout.positions]
    if missing or (robot.floating and layout.free is None):
        what = f"joint {missing[0]!r}" if missing else "free joint"
        raise InputError(
            f"has no {what} of robot {robot.name!r}", source=path, field="model", remedy="give its own model"
        )
    for name, value in robot.description.locked_joints.items():
        if name in layout.positions and isinstance(value, int | float):
            layout.qpos[layout.positions[name]] += value
    return layout


def compiled_layout(path: Path) -> Layout:
    """As :func:`model_layout`, in this process and of whatever the model holds."""
    import mujoco

    mujoco.set_mju_user_warning(lambda _: None)
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, OSError, RuntimeError) as error:
        line = " ".join(str(error).split())
        raise InputError(
            f"MuJoCo cannot compile it ({line[:160]})", source=path, remedy="mend it there"
        ) from error
    single = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
    free = np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE))
    joints = [k for k in range(model.njnt) if int(model.jnt_type[k]) in single]
    return Layout(
        np.array(model.qpos0),
        int(model.nv),
        {model.joint(k).name: int(model.jnt_qposadr[k]) for k in joints},
        {model.joint(k).name: int(model.jnt_dofadr[k]) for k in joints},
        (int(model.jnt_qposadr[free[0]]), int(model.jnt_dofadr[free[0]])) if len(free) else None,
        tuple(_read_actuator(model, k) for k in range(model.nu)),
    )


def _read_actuator(m: Any, k: int) -> Actuator:
    """A servo of position pulls with gain·ctrl − gain·q, one of velocity with gain·ctrl − gain·v."""
    import mujoco

    of_joint = m.actuator_trntype[k] == int(mujoco.mjtTrn.mjTRN_JOINT)
    name = m.joint(int(m.actuator_trnid[k, 0])).name if of_joint else ""
    gain, bias = float(m.actuator_gainprm[k, 0]), m.actuator_biasprm[k]
    kind = OTHER
    if m.actuator_biastype[k] == int(mujoco.mjtBias.mjBIAS_AFFINE) and gain != 0.0:
        kind = POSITION if bias[1] == -gain else VELOCITY if bias[1] == 0.0 and bias[2] == -gain else OTHER
    return Actuator(name, kind, float(m.actuator_gear[k, 0]))
