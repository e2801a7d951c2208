"""Sequences of Unitree's LowCmd: what every motor is commanded at every instant."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.atomic import atomic_path
from excite.errors import InputError
from excite.export.exporter import Exporter
from excite.export.humanoids.unitree_motors import MODEL, motor_places
from excite.export.setting import Setting
from excite.export.statement import motion_remarks, motion_statement
from excite.motion.motion import Motion
from excite.motion.readers.unitree import HEADER
from excite.simulation.drives import nominal_drives

# At which the vendor's examples of low-level control publish.
_RATE_HZ = 500.0
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
    exact = False
    holds_base = False
    settings = (
        Setting(
            "motors", "", "joints in the motors' order, - for none; or model; known robots' where left out"
        ),
        Setting("kp", "", f"position gain [N·m/rad] of {_WHOSE}", example="60"),
        Setting("kd", "", f"velocity gain [N·m·s/rad] of {_WHOSE}", example="2"),
    )

    def rate(self, motion: Motion, asked_hz: float | None) -> float | None:
        """The rate of the vendor's examples where none is asked for."""
        return _RATE_HZ if asked_hz is None else asked_hz

    def refuse(self, motion: Motion) -> None:
        """Raise InputError where nobody says which motor a joint is, or with what gains it is to run."""
        self._gains("kp", self._order(motion))
        self._gains("kd", self._order(motion))

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        places = motor_places(self.robot, self.word("motors"))
        order = self._order(motion)
        gains = {name: self._gains(name, order) for name in _GAINS}
        said = motion_statement(motion) | {
            "motors": {str(places[motion.joint_names[k]]): motion.joint_names[k] for k in order},
            "mode_pr": 0,
            "remarks": motion_remarks(motion),
        }
        q, dq = motion.joint_positions(), motion.joint_velocities()
        with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as stream:
            stream.write(json.dumps({HEADER: said}, ensure_ascii=False) + "\n")
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
                stream.write(json.dumps({"t": float(time), "motor_cmd": commands}) + "\n")

    def _order(self, motion: Motion) -> list[int]:
        """Columns of the motion's joints in the motors' order."""
        places = motor_places(self.robot, self.word("motors"))
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
