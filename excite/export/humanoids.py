"""Sequences for humanoids and quadrupeds, and motions of people."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from excite.arrays import Array
from excite.atomic import atomic_folder, atomic_path, write_text
from excite.errors import InputError
from excite.export.exporter import Exporter, Setting, motion_remarks, motion_statement
from excite.formats.markers import write_storage
from excite.formats.unitree import G1, H1, QUADRUPED
from excite.human.models import PELVIS, TO_ISB, coordinate_names
from excite.motion.motion import Motion
from excite.motion.readers.programs import HEADER, STATEMENT
from excite.robot.robot import Robot
from excite.safety.ground_forces import wrench_at_world_origin, zero_moment_point
from excite.simulation.drives import nominal_drives

# Pattern files of OpenHRP and Choreonoid: .pos, .waist, .hip and .zmp.


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
        order = self.joint_order(names, "joints")
        return sorted(range(len(names)), key=order.__getitem__)


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


# OpenSim motions of people.


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
        rows = np.hstack([motion.time[:, None], _pelvis_coordinates(motion), motion.joint_positions()])
        columns = dict(zip(["time", *PELVIS, *motion.joint_names], rows.T, strict=True))
        head = [motion.name, "version=1", "inDegrees=no", *motion_remarks(motion)]
        with atomic_path(path) as temporary:
            write_storage(columns, temporary, head)


def _pelvis_coordinates(motion: Motion) -> Array:
    """Tilt, list, rotation [rad] and translation [m] of the pelvis in OpenSim's axes, ``(n, 6)``."""
    turns = np.array([TO_ISB @ pin.Quaternion(row).matrix() @ TO_ISB.T for row in motion.q[:, 3:7]])
    angles = np.unwrap(Rotation.from_matrix(turns).as_euler("ZXY"), axis=0)
    return np.hstack([angles, motion.q[:, :3] @ TO_ISB.T])


# In which place of Unitree's ``motor_cmd`` each joint stands.

MODEL = "model"
"""Setting for the order of the robot's own joints."""

KNOWN = (QUADRUPED, G1, H1)
"""Orders that are known by the joints' names."""


# Sequences of Unitree's LowCmd: what every motor is commanded at every instant.

_WHOSE = f"all motors, or of each in their order, with commas; {MODEL}: of the robot's description"
# Beyond what any of the vendor's motors takes.
_GAINS = {
    "kp": Setting("kp", 0.0, "", 0.0, 5000.0, "N·m/rad"),
    "kd": Setting("kd", 0.0, "", 0.0, 500.0, "N·m·s/rad"),
}


class UnitreeExporter(Exporter):
    """JSON lines: what the file is, then an object an instant with ``t`` [s] and ``motor_cmd``.

    Each command has the motor's ``index`` and LowCmd's fields of that motor: ``mode`` 1 (the servo runs), ``q`` [rad],
    ``dq`` [rad/s], ``tau`` [N·m], which is zero, ``kp`` [N·m/rad] and ``kd`` [N·m·s/rad]. Gains have to be
    given: those of the robot's description are a virtual robot's, of a G1's knee a hundred times those of the vendor's
    examples, unless somebody wrote the machine's own there. Motors that the robot's model does not have are left out:
    whoever sends the message has to hold them. Ankles and waists behind linkages are commanded as pitch and roll
    (``mode_pr`` 0). A free base has no place in it: nothing balances the robot but the motion.
    """

    name = "unitree"
    suffix = ".jsonl"
    summary = "Unitree LowCmd sequence in JSON lines: q, dq, kp, kd, tau by motor index"
    # At which the vendor's examples of low-level control publish.
    usual_hz = 500.0
    exact = False
    holds_base = False
    settings = (
        Setting(
            "motors", "", "joints in the motors' order, - for none; or model; known robots' where left out"
        ),
        Setting("kp", "", f"position gain [N·m/rad] of {_WHOSE}", example="60"),
        Setting("kd", "", f"velocity gain [N·m·s/rad] of {_WHOSE}", example="2"),
    )

    def refuse(self, motion: Motion) -> None:
        """Raise InputError where nobody says which motor a joint is, or with what gains it is to run."""
        self._gains("kp", self._order(motion))
        self._gains("kd", self._order(motion))

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        places, order = self.motor_places(), self._order(motion)
        gains = {name: self._gains(name, order) for name in _GAINS}
        said = motion_statement(motion) | {
            "motors": {str(places[motion.joint_names[k]]): motion.joint_names[k] for k in order},
            "mode_pr": 0,
            "remarks": motion_remarks(motion),
        }
        q, dq = motion.joint_positions(), motion.joint_velocities()
        lines = [json.dumps({HEADER: said}, ensure_ascii=False)]
        for row, time in enumerate(motion.time - motion.time[0]):
            commands = [
                {
                    "index": places[motion.joint_names[k]],
                    "mode": 1,
                    "q": float(q[row, k]),
                    "dq": float(dq[row, k]),
                    "tau": 0.0,
                    "kp": float(gains["kp"][k]),
                    "kd": float(gains["kd"][k]),
                }
                for k in order
            ]
            lines.append(json.dumps({"t": float(time), "motor_cmd": commands}))
        write_text(path, "\n".join([*lines, ""]))

    def motor_places(self) -> dict[str, int]:
        """By joint of the robot, its place in ``motor_cmd``.

        Raises:
            InputError: a joint has no place, or two; nobody knows the robot's motors and nothing is said.
        """
        joints, stated = self.robot.driven_names, self.word("motors")
        if stated:
            places = (
                [*range(len(joints))] if stated == MODEL else self.joint_order(joints, "motors", blank="-")
            )
            return dict(zip(joints, places, strict=True))
        short = [joint.removesuffix("_joint") for joint in joints]
        found = [
            tuple(names.index(name) for name in short)
            for names in KNOWN
            if all(name in names for name in short)
        ]
        if len(set(found)) != 1:
            raise InputError(
                f"nobody knows the order of the motors of {self.robot.name!r}",
                source=self.name,
                field="motors",
                remedy="give --set motors=JOINT,JOINT,… as motor_cmd has them, "
                f"or motors={MODEL} for the model's order",
            )
        return dict(zip(joints, found[0], strict=True))

    def _order(self, motion: Motion) -> list[int]:
        """Columns of the motion's joints in the motors' order."""
        places = self.motor_places()
        return sorted(range(len(motion.joint_names)), key=lambda k: places[motion.joint_names[k]])

    def _gains(self, name: str, order: list[int]) -> Array:
        """Gains by column of the motion, ``(n_joints,)``."""
        text = self.word(name)
        if text == MODEL:
            return self._own_gains(name)
        values = [float(_GAINS[name].read(part, self.name)) for part in text.split(",")] if text else []
        if len(values) not in {1, len(order)}:
            found = f"has {len(values)} values for {len(order)} motors" if values else "is not given"
            raise InputError(
                found,
                source=self.name,
                field=name,
                remedy=f"give --set {name}=NUMBER as the machine is to run, or one a motor with commas; {name}={MODEL} "
                "takes those of the robot's description, a virtual robot's unless you wrote them",
            )
        gains = np.empty(len(order))
        gains[order] = values
        return gains

    def _own_gains(self, name: str) -> Array:
        """Gains of the robot's description; raises InputError where one is more than may be given as a number."""
        drives, cap = nominal_drives(self.robot), _GAINS[name]
        gains = drives.kp if name == "kp" else drives.kd
        above = np.flatnonzero(gains > cap.high)
        if len(above):
            raise InputError(
                f"is {gains[above[0]]:g} {cap.unit} at {self.robot.joint_names[above[0]]} in the robot's description, "
                f"a virtual robot's, and may be at most {cap.high:g}",
                source=self.name,
                field=name,
                remedy=f"write the machine's own under controller in robot.yaml, or give --set {name}=NUMBER",
            )
        return gains
