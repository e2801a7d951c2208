"""OpenSim motions of people."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from excite.arrays import Array
from excite.atomic import atomic_path
from excite.errors import InputError
from excite.export.exporter import Exporter
from excite.export.statement import motion_remarks
from excite.human.osim import PELVIS, TO_ISB, coordinate_names
from excite.motion.motion import Motion


class OpenSimExporter(Exporter):
    """A ``.mot`` with the coordinates of the ``.osim`` that ``excite human`` writes of a person: radians and metres.

    Angles of joints are those of the robot; the pelvis' tilt, list and rotation are turns about its own z, x and y, in
    OpenSim's axes (x forward, y up, z to the right), and its translation is in these axes too.
    """

    name = "opensim"
    suffix = ".mot"
    summary = "OpenSim motion (.mot) of a person that excite human measured"
    # Neither velocities nor the pelvis' twist stand in it.
    readable = False
    exact = False
    holds_base = False

    def refuse(self, motion: Motion) -> None:
        """Raise InputError for robots that are no person measured by ``excite human``."""
        known = set(coordinate_names())
        other = [joint for joint in self.robot.joint_names if joint not in known]
        if other or not self.robot.floating:
            what = f"joint {other[0]!r}" if other else "a fixed base"
            raise InputError(
                f"robot {self.robot.name!r} has {what}, which no person of excite human has",
                source=motion.name,
                field=self.name,
                remedy="choose another format",
            )

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        names = ["time", *PELVIS, *motion.joint_names]
        rows = np.hstack([motion.time[:, None], _pelvis_coordinates(motion), motion.joint_positions()])
        head = [
            motion.name,
            "version=1",
            f"nRows={len(rows)}",
            f"nColumns={len(names)}",
            "inDegrees=no",
            *motion_remarks(motion),
            "endheader",
            "\t".join(names),
        ]
        with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as stream:
            stream.writelines(f"{line}\n" for line in head)
            stream.writelines("\t".join(map(repr, row)) + "\n" for row in rows.tolist())


def _pelvis_coordinates(motion: Motion) -> Array:
    """Tilt, list, rotation [rad] and translation [m] of the pelvis in OpenSim's axes, ``(n, 6)``."""
    turns = np.array([TO_ISB @ pin.Quaternion(row).matrix() @ TO_ISB.T for row in motion.q[:, 3:7]])
    angles = np.unwrap(Rotation.from_matrix(turns).as_euler("ZXY"), axis=0)
    return np.hstack([angles, motion.q[:, :3] @ TO_ISB.T])
