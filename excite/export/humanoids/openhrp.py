"""Pattern files of OpenHRP and Choreonoid: .pos, .waist, .hip and .zmp."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.atomic import atomic_folder
from excite.errors import InputError
from excite.export.exporter import Exporter
from excite.export.setting import Setting
from excite.export.statement import motion_remarks, motion_statement
from excite.motion.motion import Motion
from excite.motion.readers.openhrp import STATEMENT
from excite.robot.robot import Robot
from excite.safety.contact_wrench import wrench_at_world_origin, zero_moment_point


class OpenHrpExporter(Exporter):
    """A folder of ``MOTION.pos`` and, of a free base, ``.waist`` and ``.hip``, of a standing robot ``.zmp``.

    Each row is a time [s] and numbers between spaces, as the sequence player of hrpsys reads them: joint positions
    [rad or m]; position [m] and roll, pitch, yaw [rad] of the base in the world; the latter alone; the zero-moment
    point in the base's frame [m]. The joints' order is theirs in the model, or the one that is set: the player counts
    by ``jointId``. Whose motion it is and what the check said of it stands in ``excite.json`` beside them.
    """

    name = "openhrp"
    suffix = ""
    summary = "OpenHRP/Choreonoid patterns .pos, .waist, .hip, .zmp"
    exact = False
    holds_base = False
    settings = (Setting("joints", "", "joints between commas by jointId; the model's order where left out"),)

    def refuse(self, motion: Motion) -> None:
        """Raise InputError where the order that is set is none of the robot's joints."""
        self._order()

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; ``path`` is the folder, numbers are written with all their digits."""
        order = self._order()
        files = {"pos": motion.joint_positions()[:, order]}
        if motion.floating:
            rotations = np.array([pin.Quaternion(row).matrix() for row in motion.q[:, 3:7]])
            angles = np.unwrap([pin.rpy.matrixToRpy(rotation) for rotation in rotations], axis=0)
            files |= {"waist": np.hstack([motion.q[:, :3], angles]), "hip": angles}
            if self.robot.feet:
                files["zmp"] = _zmp_in_base(self.robot, motion, rotations)
        said = motion_statement(motion) | {
            "joints": [motion.joint_names[k] for k in order],
            "remarks": motion_remarks(motion),
        }
        time = (motion.time - motion.time[0])[:, None]
        with atomic_folder(path) as folder:
            folder.mkdir()
            for ending, values in files.items():
                rows = np.hstack([time, values]).tolist()
                text = "".join(f"{' '.join(map(repr, row))}\n" for row in rows)
                (folder / f"{motion.name}.{ending}").write_text(text, encoding="utf-8")
            text = json.dumps(said, ensure_ascii=False, indent=2)
            (folder / STATEMENT).write_text(text + "\n", encoding="utf-8")

    def _order(self) -> list[int]:
        """Places of the joints in the motion, in the order of the files."""
        names = self.robot.joint_names
        if not self.word("joints"):
            return list(range(len(names)))
        wanted = [name.strip() for name in self.word("joints").split(",")]
        if sorted(wanted) != sorted(names):
            wrong = sorted({*wanted} ^ {*names}) or sorted(n for n in wanted if wanted.count(n) > 1)
            raise InputError(
                f"names not each joint of robot {self.robot.name!r} once: {wrong[0][:40]!r}",
                source=self.name,
                field="joints",
                remedy="name them all, in the order of jointId",
            )
        return [names.index(name) for name in wanted]


def _zmp_in_base(robot: Robot, motion: Motion, rotations: Array) -> Array:
    """Zero-moment point on the ground in the base's frame, ``(n, 3)`` [m]; raises InputError where there is none."""
    data = robot.model.createData()
    rows = zip(motion.q, motion.v, motion.a, strict=True)
    forces = np.array([pin.rnea(robot.model, data, *row)[:6] for row in rows])
    position = motion.q[:, :3]
    flat = zero_moment_point(wrench_at_world_origin(forces, rotations, position))
    if np.isnan(flat).any():
        raise InputError(
            "leaves the ground, where no zero-moment point is",
            source=motion.name,
            field="zmp",
            remedy="choose another format",
        )
    world = np.column_stack([flat, np.zeros(len(flat))])
    return np.asarray(np.einsum("nji,nj->ni", rotations, world - position))
