"""Motions for MuJoCo: keyframes of any model."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from excite.arrays import Array
from excite.atomic import write_text
from excite.export.exporter import Exporter, Setting, motion_remarks, motion_statement
from excite.export.models.mjcf import read_mjcf
from excite.export.models.mjcf_compiled import compile_mjcf
from excite.export.models.verification import MujocoPlaces, mujoco_places
from excite.motion.motion import Motion
from excite.motion.readers.programs import KEYFRAMES_STATEMENT as STATEMENT

if TYPE_CHECKING:
    from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class _Layout:
    """Where a MuJoCo model keeps the state of a robot's joints, and what drives them.

    Attributes:
        places: of the robot's coordinates.
        position: ``(n_actuators, nq)`` what each control asks for, by ``qpos``.
        velocity: ``(n_actuators, nv)`` the same by ``qvel``; zero of motors.
    """

    places: MujocoPlaces
    position: Array
    velocity: Array


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
    settings = (Setting("model", "", "MJCF file whose keys are written; the robot's own where left out"),)

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        robot, model = self.robot, self.word("model")
        layout = model_layout(Path(model), robot) if model else robot_layout(robot)
        place = layout.places
        qpos = place.q[robot.n_base_q :]
        said = motion_statement(motion) | {
            "qpos": qpos.tolist(),
            "zero": place.start[qpos].tolist(),
            "qvel": place.v[robot.n_base_v :].tolist(),
        }
        lines = ["<mujoco>"]
        # Two hyphens end a comment's text.
        lines += [f"  <!-- {line.replace('--', '- -')} -->" for line in motion_remarks(motion)]
        name, text = quoteattr(f"{STATEMENT}.{motion.name}"), quoteattr(json.dumps(said))
        lines += [f"  <custom><text name={name} data={text}/></custom>", "  <keyframe>"]
        digits = len(str(motion.n_samples - 1))
        for k, time in enumerate(motion.time):
            q, v = place.mujoco_state(robot, motion.q[k], motion.v[k])
            state = {"qpos": q, "qvel": v}
            if len(layout.position):
                state["ctrl"] = layout.position @ q + layout.velocity @ v
            key = quoteattr(f"{motion.name}.{k:0{digits}d}")
            numbers = (f'{word}="{" ".join(map(repr, values.tolist()))}"' for word, values in state.items())
            lines.append(f'    <key name={key} time="{float(time)!r}" {" ".join(numbers)}/>')
        write_text(path, "\n".join([*lines, "  </keyframe>", "</mujoco>", ""]))


def robot_layout(robot: Robot) -> _Layout:
    """Of the model that ``excite model --format mjcf`` writes of a robot: its own order, a position servo a joint."""
    nq, nv = robot.model.nq, robot.model.nv
    places = MujocoPlaces(np.arange(nq), np.arange(nv), np.zeros(nq), nv)
    return _Layout(places, np.eye(nq)[robot.n_base_q :], np.zeros((robot.n_joints, nv)))


def model_layout(path: Path, robot: Robot) -> _Layout:
    """Of a MuJoCo model that somebody has; joints that the robot holds locked are where it holds them.

    Raises:
        InputError: MuJoCo cannot compile it, or it lacks a joint of the robot, or its free base.
    """
    import mujoco

    model = compile_mjcf(read_mjcf(path), path)
    places = mujoco_places(robot, model, source=path)
    position, velocity = np.zeros((model.nu, model.nq)), np.zeros((model.nu, model.nv))
    single = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
    for k in range(model.nu):
        joint = int(model.actuator_trnid[k, 0])
        if model.actuator_trntype[k] != int(mujoco.mjtTrn.mjTRN_JOINT) or model.jnt_type[joint] not in single:
            continue
        # A servo of position pulls with gain·ctrl − gain·q, one of velocity with gain·ctrl − gain·v.
        gain, bias = model.actuator_gainprm[k, 0], model.actuator_biasprm[k]
        if model.actuator_biastype[k] == int(mujoco.mjtBias.mjBIAS_AFFINE) and gain != 0.0:
            if bias[1] == -gain:
                position[k, model.jnt_qposadr[joint]] = model.actuator_gear[k, 0]
            elif bias[1] == 0.0 and bias[2] == -gain:
                velocity[k, model.jnt_dofadr[joint]] = model.actuator_gear[k, 0]
    return _Layout(places, position, velocity)
