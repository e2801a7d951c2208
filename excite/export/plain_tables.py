"""Motions as plain tables: CSV, NumPy archives, LeRobot data sets."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv

from excite.atomic import atomic_folder, atomic_path
from excite.errors import InputError
from excite.export.exporter import Exporter, Setting, as_comments, motion_warnings, write_statement
from excite.formats.arrays import NpzFormat
from excite.formats.arrow import arrow_table
from excite.formats.lerobot import write_data_set
from excite.motion.content import motion_columns
from excite.motion.motion import Motion
from excite.motion.readers.tables import STATEMENT

# Comma-separated values: a header line with names, then one line a sample.


class CsvExporter(Exporter):
    """Columns ``time`` [s], ``q.JOINT``, ``v.JOINT``, ``a.JOINT`` [SI]; where there are any,
    ``base.*`` and ``contact.*``. A motion that is not safe has its violations, and why it was written all the same, in
    lines above the names that start with ``#``.
    """

    name = "csv"
    suffix = ".csv"
    summary = "comma-separated columns time, q.JOINT, v.JOINT, a.JOINT (and base.*, contact.*)"

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        options = pa.csv.WriteOptions(quoting_style="none")
        with atomic_path(path) as temporary, temporary.open("wb") as stream:
            stream.write(as_comments(motion_warnings(motion)).encode())
            pa.csv.write_csv(arrow_table(motion_columns(motion)), stream, options)


# LeRobot data sets with one episode: the motion as actions to replay.


class LeRobotExporter(Exporter):
    """A data set in LeRobot's layout 3.0.

    ``action`` and ``observation.state`` are the joints' positions of the motion, ``observation.velocity`` their
    velocities [rad or m, s], named ``JOINT.pos`` and ``JOINT.vel``, in single precision as everywhere there; a robot
    that takes degrees has to be set to radians. Frames are evenly spaced at a whole number a second. Whose motion it is
    and what the check said of it stands in ``meta/excite.json``: LeRobot drops what it does not know from its files.
    """

    name = "lerobot"
    suffix = ""
    summary = "LeRobot data set of one episode, to replay"
    settings = (Setting("task", "excite the robot's dynamics", "what the episode is said to do"),)

    def rate(self, motion: Motion, asked_hz: float | None) -> float | None:
        """A whole number of frames a second; the motion's own, or twice that, where none is asked for."""
        if asked_hz is None:
            own = (motion.n_samples - 1) / motion.duration
            steps = np.diff(motion.time) * round(own)
            # Samples between those of another grid keep the motion only where they are more.
            return float(round(own) if np.abs(steps - 1.0).max() < 1e-6 else np.ceil(2.0 * own))
        if asked_hz != round(asked_hz):
            raise InputError(
                f"is {asked_hz:g} Hz, and LeRobot counts whole frames a second",
                source=self.name,
                field="rate_hz",
                remedy=f"give {max(1, round(asked_hz))}",
            )
        return asked_hz

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; ``path`` is the data set's folder."""
        q, v = (x.astype(np.float32) for x in (motion.joint_positions(), motion.joint_velocities()))
        columns = {"action": q, "observation.state": q, "observation.velocity": v}
        endings = dict(zip(columns, ("pos", "pos", "vel"), strict=True))
        with atomic_folder(path) as folder:
            write_data_set(
                columns,
                {name: [f"{joint}.{end}" for joint in motion.joint_names] for name, end in endings.items()},
                folder,
                fps=round((motion.n_samples - 1) / motion.duration),
                robot=motion.robot,
                task=self.word("task"),
            )
            write_statement(motion, folder / STATEMENT)


# NumPy archives: one matrix a quantity.


class NpzExporter(Exporter):
    """Arrays ``time`` (n,), ``q``, ``v``, ``a`` (n, n_joints) [SI] and ``joint_names``; no pickled objects.

    A free base adds ``base_pose`` (n, 7: x y z qx qy qz qw, world frame), ``base_twist`` and
    ``base_acceleration`` (n, 6: linear, angular, base frame); feet add ``contact.FOOT`` (n,) booleans. ``robot``,
    ``robot_hash`` and ``verdict`` (JSON) say whose it is and what the independent check said of it.
    """

    name = "npz"
    suffix = ".npz"
    summary = "NumPy archive with matrices time, q, v, a and joint_names"

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`."""
        arrays: dict[str, Any] = {
            "time": motion.time,
            "joint_names": np.array(motion.joint_names),
            "q": motion.joint_positions(),
            "v": motion.joint_velocities(),
            "a": motion.joint_accelerations(),
        }
        if motion.floating:
            arrays |= {
                "base_pose": motion.q[:, :7],
                "base_twist": motion.v[:, :6],
                "base_acceleration": motion.a[:, :6],
            }
        metadata = motion.metadata
        arrays |= {"robot": np.array(motion.robot), "robot_hash": np.array(metadata.robot_hash)}
        if metadata.verdict is not None:
            arrays["verdict"] = np.array(json.dumps(metadata.verdict))
        arrays |= {f"contact.{foot}": flags for foot, flags in motion.contacts.items()}
        with atomic_path(path) as temporary:
            NpzFormat().write(arrays, temporary)
