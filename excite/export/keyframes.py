"""Motions for MuJoCo: keyframes of the robot's model."""

from __future__ import annotations

import json
from pathlib import Path
from xml.sax.saxutils import quoteattr

from excite.atomic import write_text
from excite.export.exporter import Exporter, motion_remarks, motion_statement
from excite.motion.motion import Motion
from excite.motion.readers.programs import KEYFRAMES_STATEMENT as STATEMENT
from excite.simulation.coordinates import position_to_mujoco, velocity_to_mujoco


class KeyframesExporter(Exporter):
    """``<key>`` with time [s], qpos, qvel and ctrl, named ``MOTION.0000`` and on, for ``<include file=…/>``.

    The keys fit the model that ``excite model --format mjcf`` writes: the robot's joints in their order and a position
    servo each, whose ``ctrl`` is the joint's position. The state of a free base is MuJoCo's: quaternion w x y z, linear
    velocity in the world. Accelerations and contacts have no place in a key.
    """

    name = "mujoco-keyframes"
    whole = True
    suffix = ".xml"
    summary = "MuJoCo keyframes (qpos, qvel, ctrl) in a file to include beside the robot's model"

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        robot, floating = self.robot, self.robot.floating
        said = motion_statement(motion) | {
            "qpos": list(range(robot.n_base_q, robot.model.nq)),
            "zero": [0.0] * robot.n_joints,
            "qvel": list(range(robot.n_base_v, robot.model.nv)),
        }
        lines = ["<mujoco>"]
        # Two hyphens end a comment's text.
        lines += [f"  <!-- {line.replace('--', '- -')} -->" for line in motion_remarks(motion)]
        name, text = quoteattr(f"{STATEMENT}.{motion.name}"), quoteattr(json.dumps(said))
        lines += [f"  <custom><text name={name} data={text}/></custom>", "  <keyframe>"]
        digits = len(str(motion.n_samples - 1))
        for k, time in enumerate(motion.time):
            q = position_to_mujoco(motion.q[k], floating=floating)
            v = velocity_to_mujoco(motion.q[k], motion.v[k], floating=floating)
            state = {"qpos": q, "qvel": v, "ctrl": q[robot.n_base_q :]}
            key = quoteattr(f"{motion.name}.{k:0{digits}d}")
            numbers = (f'{word}="{" ".join(map(repr, values.tolist()))}"' for word, values in state.items())
            lines.append(f'    <key name={key} time="{float(time)!r}" {" ".join(numbers)}/>')
        write_text(path, "\n".join([*lines, "  </keyframe>", "</mujoco>", ""]))
