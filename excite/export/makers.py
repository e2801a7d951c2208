"""Formats of makers' own: programs and streams for arms, sequences for humanoids and quadrupeds."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.atomic import atomic_folder, write_text
from excite.errors import InputError
from excite.export.exporter import (
    Exporter,
    Setting,
    comment_lines,
    motion_remarks,
    motion_statement,
    write_statement,
)
from excite.formats.documents import read_yaml
from excite.formats.unitree import G1, H1, QUADRUPED
from excite.motion.motion import Motion
from excite.motion.readers.programs import HEADER, STATEMENT
from excite.robot.robot import Robot
from excite.safety.ground_forces import wrench_at_world_origin, zero_moment_point
from excite.safety.verdict import Violation
from excite.simulation.true_parameters import nominal_drives

# Programs in URScript for arms of Universal Robots.


class UrScriptExporter(Exporter):
    """A program that asks the operator, moves to the start, servos through every sample, and stops.

    ``movej`` takes the arm from wherever it stands to the first sample, slowly; that way is the controller's own and no
    check has seen it, hence the question before it. Then one ``servoj`` a sample, each for one period: the controller
    smooths the setpoints over ``lookahead`` and pulls the arm along with ``gain``, so the arm follows the motion a
    little late. The last posture is held for ``settle``, then ``stopj`` ends it. At a speed slider below 100 % each
    ``servoj`` takes longer than its period: another, slower motion.

    Ranges of lookahead and gain are those of Universal Robots' script manual (servoj). An e-Series or UR-Series
    controller runs at 500 Hz, a CB3 one at 125 Hz.
    """

    name = "ur-script"
    suffix = ".script"
    summary = "URScript program for an arm of Universal Robots: movej to the start, servoj, stopj"
    rates_hz = (500.0, 125.0)
    chain = 6
    settings = (
        Setting("lookahead", 0.1, "smoothing of the setpoints", 0.03, 0.2, "s"),
        Setting("gain", 300.0, "proportional gain of the servo", 100.0, 2000.0),
        # A quarter of what movej does where nothing is said, 1.05 rad/s and 1.4 rad/s²: a hand reaches the stop.
        Setting("approach_speed", 0.25, "speed of the way to the start", 0.01, 1.05, "rad/s"),
        Setting("approach_acceleration", 0.35, "acceleration of the way to the start", 0.01, 1.4, "rad/s²"),
        Setting("settle", 0.5, "how long the last posture is held", 0.0, 10.0, "s"),
        Setting("stop", 2.0, "deceleration of the last stop", 0.1, 10.0, "rad/s²"),
        Setting(
            "confirm", "yes", "whether the operator is asked before the arm moves", choices=("yes", "no")
        ),
    )

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        write_text(path, comment_lines(motion) + self._write_program(motion))

    def _write_program(self, motion: Motion) -> str:
        rate = (motion.n_samples - 1) / motion.duration
        servo = f"0, 0, {1.0 / rate:.6g}, {self.number('lookahead'):g}, {self.number('gain'):g})"
        # URScript has no exponents; 1e-12 rad at 500 Hz are 1e-6 rad/s² of acceleration.
        rows = [f"[{', '.join(f'{x + 0.0:.12f}' for x in row)}]" for row in motion.joint_positions().tolist()]
        speed, acceleration = self.number("approach_speed"), self.number("approach_acceleration")
        # URScript allows letters of ASCII, digits and underscores.
        word = re.sub(r"[^A-Za-z0-9_]", "_", motion.name)
        lines = [f"def {word if word[:1].isalpha() else f'motion_{word}'}():"]
        if self.word("confirm") == "yes":
            # The warning of a motion that is not safe, else whose it is; as long as fits a window of the teach pendant.
            first = motion_remarks(motion)[0].replace('"', "'").replace("\\", "/")[:200]
            question = f"{first}. Is the way to its start free?"
            lines.append(f'  popup("{question}", "excite", False, False, True)')
        lines.append(f"  movej({rows[0]}, a={acceleration:g}, v={speed:g})")
        lines += [f"  servoj({row}, {servo}" for row in rows]
        lines += [
            "  held = 0",
            f"  while held < {math.ceil(self.number('settle') * rate)}:",
            f"    servoj({rows[-1]}, {servo}",
            "    held = held + 1",
            "  end",
            f"  stopj({self.number('stop'):g})",
            "end",
        ]
        return "\n".join([*lines, ""])


# What Franka's control interface lets joints do: a command that is beyond a limit in one millisecond ends the motion.

RATE_HZ = 1000.0
PERIOD_S = 1.0 / RATE_HZ


@dataclass(frozen=True)
class FrankaLimits:
    """Limits of the seven joints of one model.

    Attributes:
        velocity: [rad/s].
        acceleration: [rad/s²].
        jerk: [rad/s³].
        braking: by joint ``(offset, slope, lower end, upper end)``: near an end of its range at distance d a joint may
            be no faster towards it than √(slope·d) − offset [rad/s]; empty for a model that has constant limits.
    """

    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    jerk: tuple[float, ...]
    braking: tuple[tuple[float, float, float, float], ...] = ()

    def velocity_bounds(self, q: Array) -> tuple[Array, Array]:
        """Lowest and highest velocity at positions ``(n, 7)``, the same shape each."""
        top = np.tile(self.velocity, (len(q), 1))
        if not self.braking:
            return -top, top
        offset, slope, lower, upper = np.array(self.braking).T
        up = np.maximum(0.0, np.sqrt(np.maximum(0.0, slope * (upper - q))) - offset)
        down = np.maximum(0.0, np.sqrt(np.maximum(0.0, slope * (q - lower))) - offset)
        return -np.minimum(top, down), np.minimum(top, up)


LIMITS = {
    name: FrankaLimits(**{key: tuple(values) for key, values in row.items()})
    for name, row in read_yaml(Path(__file__).with_name("franka_limits.yaml")).items()
}


def franka_violations(limits: FrankaLimits, q: Array, joints: tuple[str, ...]) -> tuple[Violation, ...]:
    """Where a stream of positions is beyond the limits, the first time of each kind and joint.

    Velocity, acceleration and jerk are differences from millisecond to millisecond, as the robot takes them, from and
    to a robot that stands still.

    Args:
        q: ``(n, 7)`` positions, one a millisecond [rad].
    """
    # Three milliseconds of standing still before the first and after the last sample: jerk is of third order.
    still = np.pad(q, ((3, 3), (0, 0)), mode="edge")
    v = np.diff(still, axis=0) / PERIOD_S
    a = np.diff(v, axis=0) / PERIOD_S
    jerk = np.diff(a, axis=0) / PERIOD_S
    low, high = limits.velocity_bounds(still[1:])
    found: list[Violation] = []
    for kind, values, limit in (
        ("franka_velocity", v, np.where(v >= 0.0, high, -low)),
        ("franka_acceleration", a, np.array(limits.acceleration)),
        ("franka_jerk", jerk, np.array(limits.jerk)),
    ):
        # libfranka compares with limits that are smaller by this.
        beyond = np.abs(values) > limit - 1e-3
        for joint in np.flatnonzero(beyond.any(axis=0)):
            row = int(np.argmax(beyond[:, joint]))
            time = max(0.0, (row + len(still) - len(values) - 3) * PERIOD_S)
            most = float(np.broadcast_to(limit, values.shape)[row, joint])
            found.append(Violation(kind, time, joints[joint], float(abs(values[row, joint])), most))
    return tuple(found)


# Rows of positions, velocities and accelerations at 1 kHz for arms of Franka.


class FrankaExporter(Exporter):
    """Numbers between spaces: q of the seven joints, then their dq, then their ddq [rad, s], a row a millisecond.

    Lines that start with ``#`` say whose motion it is and name the columns. What libfranka's callback for joint
    positions or velocities returns is a row's first or second seven. Beyond the robot's own limits those of Franka's
    interface are checked on what is written: velocity (of a Franka Research 3 also near the ends of the ranges),
    acceleration and jerk between milliseconds, from and to standing still.
    """

    name = "franka"
    suffix = ".txt"
    summary = "rows of q, dq, ddq at 1 kHz for libfranka, within its own limits"
    rates_hz = (RATE_HZ,)
    chain = 7
    settings = (
        Setting("model", "", "whose limits hold; by the joints' names where left out", choices=("", *LIMITS)),
    )

    def refuse(self, motion: Motion) -> None:
        """Raise InputError for robots other than chains of seven, and where nobody says which model it is."""
        super().refuse(motion)
        if not self._find_model():
            raise InputError(
                f"joint {self.robot.joint_names[0]!r} does not say which arm of Franka it is",
                source=motion.name,
                field="model",
                remedy=f"give --set model={' or '.join(LIMITS)}",
            )

    def violations(self, motion: Motion) -> tuple[Violation, ...]:
        """See :class:`Exporter`."""
        return franka_violations(LIMITS[self._find_model()], motion.joint_positions(), motion.joint_names)

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        names = [f"{prefix}.{joint}" for prefix in "qva" for joint in motion.joint_names]
        rows = np.hstack([motion.joint_positions(), motion.joint_velocities(), motion.joint_accelerations()])
        lines = [f"{' '.join(map(repr, row))}\n" for row in rows.tolist()]
        write_text(path, comment_lines(motion, rate_hz=RATE_HZ, columns=names) + "".join(lines))

    def _find_model(self) -> str:
        """Name of the model in ``LIMITS``, by the setting or the joints' names; empty where neither says."""
        first = self.robot.joint_names[0]
        named = "fr3" if first.startswith("fr3") else "panda" if first.startswith(("panda", "fer_")) else ""
        return self.word("model") or named


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
    settings = (Setting("joints", "", "joints between commas by jointId; the model's order where left out"),)

    def refuse(self, motion: Motion) -> None:
        """Raise InputError where the order that is set is none of the robot's joints."""
        self._joint_order()

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; ``path`` is the folder, numbers are written with all their digits."""
        order = self._joint_order()
        files = {"pos": motion.joint_positions()[:, order]}
        if motion.floating:
            rotations = np.array([pin.Quaternion(row).matrix() for row in motion.q[:, 3:7]])
            angles = np.unwrap([pin.rpy.matrixToRpy(rotation) for rotation in rotations], axis=0)
            files |= {"waist": np.hstack([motion.q[:, :3], angles]), "hip": angles}
            if self.robot.feet:
                files["zmp"] = _zmp_in_base(self.robot, motion, rotations)
        time = (motion.time - motion.time[0])[:, None]
        with atomic_folder(path) as folder:
            folder.mkdir()
            for ending, values in files.items():
                rows = np.hstack([time, values]).tolist()
                text = "".join(f"{' '.join(map(repr, row))}\n" for row in rows)
                (folder / f"{motion.name}.{ending}").write_text(text, encoding="utf-8")
            write_statement(motion, folder / STATEMENT, joints=[motion.joint_names[k] for k in order])

    def _joint_order(self) -> list[int]:
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
    settings = (
        Setting(
            "motors", "", "joints in the motors' order, - for none; or model; known robots' where left out"
        ),
        Setting("kp", "", f"position gain [N·m/rad] of {_WHOSE}", example="60"),
        Setting("kd", "", f"velocity gain [N·m·s/rad] of {_WHOSE}", example="2"),
    )

    def refuse(self, motion: Motion) -> None:
        """Raise InputError where nobody says which motor a joint is, or with what gains it is to run."""
        self._motor_gains("kp", self._joint_order(motion))
        self._motor_gains("kd", self._joint_order(motion))

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        places, order = self.motor_places(), self._joint_order(motion)
        gains = {name: self._motor_gains(name, order) for name in _GAINS}
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
                    **{"q": float(q[row, k]), "dq": float(dq[row, k]), "tau": 0.0},
                    **{name: float(values[k]) for name, values in gains.items()},
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

    def _joint_order(self, motion: Motion) -> list[int]:
        """Columns of the motion's joints in the motors' order."""
        places = self.motor_places()
        return sorted(range(len(motion.joint_names)), key=lambda k: places[motion.joint_names[k]])

    def _motor_gains(self, name: str, order: list[int]) -> Array:
        """Gains by column of the motion, ``(n_joints,)``."""
        text, cap = self.word(name), _GAINS[name]
        if text == MODEL:
            gains = np.asarray(getattr(nominal_drives(self.robot), name))
            above = np.flatnonzero(gains > cap.high)
            if len(above):
                joint, value = self.robot.joint_names[above[0]], gains[above[0]]
                raise InputError(
                    f"is {value:g} {cap.unit} at {joint} in the robot's description, a virtual robot's, and may be at"
                    f" most {cap.high:g}",
                    source=self.name,
                    field=name,
                    remedy=f"write the machine's own under controller in robot.yaml, or give --set {name}=NUMBER",
                )
            return gains
        values = [float(cap.read(part, self.name)) for part in text.split(",")] if text else []
        if len(values) not in {1, len(order)}:
            raise InputError(
                f"has {len(values)} values for {len(order)} motors" if values else "is not given",
                source=self.name,
                field=name,
                remedy=f"give --set {name}=NUMBER as the machine is to run, or one a motor with commas; {name}={MODEL} "
                "takes those of the robot's description, a virtual robot's unless you wrote them",
            )
        gains = np.empty(len(order))
        gains[order] = values
        return gains
