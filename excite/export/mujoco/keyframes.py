"""MuJoCo keyframes: every sample a ``<key>``, in a file to include beside the robot's model."""

from __future__ import annotations

import json
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from excite.arrays import Array
from excite.atomic import atomic_path
from excite.export.exporter import Exporter
from excite.export.mujoco.layout import OTHER, POSITION, Layout, model_layout, robot_layout
from excite.export.setting import Setting
from excite.export.statement import motion_remarks, motion_statement
from excite.motion.motion import Motion
from excite.motion.readers.keyframes import STATEMENT
from excite.simulation.coordinates import position_to_mujoco, velocity_to_mujoco


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
