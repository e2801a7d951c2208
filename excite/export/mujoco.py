"""Motions for MuJoCo: keyframes of any model."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np

from excite.arrays import Array
from excite.atomic import atomic_path
from excite.errors import InputError
from excite.export.exporter import Exporter, Setting, motion_remarks, motion_statement
from excite.formats.child import in_child
from excite.motion.motion import Motion
from excite.motion.readers.programs import KEYFRAMES_STATEMENT as STATEMENT
from excite.robot.mjcf.scan import scan_mjcf
from excite.simulation.coordinates import position_to_mujoco, velocity_to_mujoco

if TYPE_CHECKING:
    from excite.robot.robot import Robot

# MuJoCo keyframes: every sample a ``<key>``, in a file to include beside the robot's model.


class KeyframesExporter(Exporter):
    """``<key>`` with time [s], qpos, qvel and ctrl, named ``MOTION.0000`` and on, for ``<include file=…/>``.

    Without the setting ``model`` the keys fit the model that ``excite model --format mjcf`` writes: the robot's joints
    in their order and a position servo each. With it they fit that MJCF: joints are found by their names, others stay
    where the model has them. ``ctrl`` is the joint's position (or velocity) times the gear for servos of position (or
    velocity), zero for motors. The state of a free base is MuJoCo's: quaternion w x y z, linear velocity in the world.
    Accelerations and contacts have no place in a key.
    """

    name = "mujoco-keyframes"
    whole = True
    suffix = ".xml"
    summary = "MuJoCo keyframes (qpos, qvel, ctrl) in a file to include beside the robot's model"
    exact = False
    holds_base = False
    settings = (Setting("model", "", "MJCF file whose keys are written; the robot's own where left out"),)

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        model = self.word("model")
        layout = model_layout(Path(model), self.robot) if model else robot_layout(self.robot)
        names = motion.joint_names
        said = motion_statement(motion) | {
            "qpos": [layout.positions[name] for name in names],
            "zero": [float(layout.qpos[layout.positions[name]]) for name in names],
            "qvel": [layout.velocities[name] for name in names],
        }
        lines = ["<mujoco>"]
        # Two hyphens end a comment's text.
        lines += [f"  <!-- {line.replace('--', '- -')} -->" for line in motion_remarks(motion)]
        text = quoteattr(json.dumps(said))
        lines += [
            f"  <custom><text name={quoteattr(f'{STATEMENT}.{motion.name}')} data={text}/></custom>",
            "  <keyframe>",
            *self._keys(motion, layout),
            "  </keyframe>",
            "</mujoco>",
        ]
        with atomic_path(path) as temporary:
            temporary.write_text("\n".join([*lines, ""]), encoding="utf-8")

    def _keys(self, motion: Motion, layout: Layout) -> list[str]:
        names = motion.joint_names
        qpos = np.tile(layout.qpos, (motion.n_samples, 1))
        qvel = np.zeros((motion.n_samples, layout.n_dof))
        qpos[:, [layout.positions[name] for name in names]] += motion.joint_positions()
        qvel[:, [layout.velocities[name] for name in names]] = motion.joint_velocities()
        if motion.floating and layout.free is not None:
            q, v = layout.free
            rows = list(zip(motion.q, motion.v, strict=True))
            qpos[:, q : q + 7] = [position_to_mujoco(row, floating=True)[:7] for row, _ in rows]
            qvel[:, v : v + 6] = [velocity_to_mujoco(row, rate, floating=True)[:6] for row, rate in rows]
        ctrl = _keyframe_controls(layout, qpos, qvel)
        digits = len(str(motion.n_samples - 1))
        return [
            f'    <key name={quoteattr(f"{motion.name}.{k:0{digits}d}")} time="{float(time)!r}"'
            f' qpos="{_format_row(qpos[k])}" qvel="{_format_row(qvel[k])}"'
            + (f' ctrl="{_format_row(ctrl[k])}"/>' if layout.actuators else "/>")
            for k, time in enumerate(motion.time)
        ]


def _keyframe_controls(layout: Layout, qpos: Array, qvel: Array) -> Array:
    """Controls that ask for the state itself, ``(n, n_actuators)``."""
    ctrl = np.zeros((len(qpos), len(layout.actuators)))
    for k, actuator in enumerate(layout.actuators):
        if actuator.kind == OTHER or actuator.joint not in layout.positions:
            continue
        state = (
            qpos[:, layout.positions[actuator.joint]]
            if actuator.kind == POSITION
            else qvel[:, layout.velocities[actuator.joint]]
        )
        ctrl[:, k] = actuator.gear * state
    return ctrl


def _format_row(values: Array) -> str:
    return " ".join(map(repr, values.tolist()))


# Where a MuJoCo model keeps the state of its joints, and what drives them.

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
    layout: Layout = in_child("excite.export.mujoco:compiled_layout", path, source=path, error=InputError)
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
