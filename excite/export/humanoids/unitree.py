"""Sequences of Unitree's LowCmd: what every motor is commanded at every instant."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from excite.atomic import atomic_path
from excite.export.exporter import Exporter
from excite.export.humanoids.unitree_motors import motor_places
from excite.export.setting import Setting
from excite.export.statement import remarks, statement
from excite.motion.motion import Motion
from excite.motion.readers.unitree import HEADER
from excite.simulation.drives import nominal_drives

# At which the vendor's examples of low-level control publish.
_RATE_HZ = 500.0


class UnitreeExporter(Exporter):
    """JSON lines: what the file is, then an object an instant with ``t`` [s] and ``motor_cmd``.

    Each command has the motor's ``index`` and LowCmd's fields of that motor: ``mode`` 1 (the servo runs), ``q`` [rad],
    ``dq`` [rad/s], ``tau`` [N·m], which is zero, ``kp`` [N·m/rad] and ``kd`` [N·m·s/rad]. Gains are those of the
    robot's description unless they are set for all joints. Motors that the robot's model does not have are left out:
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
        Setting(
            "kp", 0.0, "position gain of every joint; the robot's own where zero", 0.0, 5000.0, "N·m/rad"
        ),
        Setting(
            "kd", 0.0, "velocity gain of every joint; the robot's own where zero", 0.0, 500.0, "N·m·s/rad"
        ),
    )

    def rate(self, motion: Motion, asked_hz: float | None) -> float | None:
        """The rate of the vendor's examples where none is asked for."""
        return _RATE_HZ if asked_hz is None else asked_hz

    def refuse(self, motion: Motion) -> None:
        """Raise InputError where nobody says which motor a joint is."""
        motor_places(self.robot, self.word("motors"))

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        places = motor_places(self.robot, self.word("motors"))
        order = sorted(range(len(motion.joint_names)), key=lambda k: places[motion.joint_names[k]])
        drives = nominal_drives(self.robot)
        gains = {
            name: np.full(len(order), self.number(name)) if self.number(name) else own
            for name, own in (("kp", drives.kp), ("kd", drives.kd))
        }
        said = statement(motion) | {
            "motors": {str(places[motion.joint_names[k]]): motion.joint_names[k] for k in order},
            "mode_pr": 0,
            "remarks": remarks(motion),
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
