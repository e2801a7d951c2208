"""A log: what a robot's sensors said while it ran motions (``excite.log/1``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from excite.arrays import Array, Flags
from excite.display import count
from excite.logs.header_blocks import (
    MAX_NAMES,
    MAX_TRIALS,
    Acceleration,
    Cutoff,
    Factor,
    FootHeader,
    Guess,
    HeaderBlock,
    ImuHeader,
    Name,
    Rate,
    SensorHeader,
    Text,
    TrialHeader,
)


class LogHeader(HeaderBlock):
    """The whole of ``log.yaml``.

    Where ``lowpass_hz`` is stated, all channels went through the same low-pass at that cut-off already. ``posture`` is
    ``computed`` where joints and base were fitted to something else that was recorded, such as named markers.
    ``torque_constants`` [N·m/A] turn the currents of a ``current`` log to torques; joints in ``no_torque`` move, but
    their torque or current was not measured, or means nothing. ``coupling`` says of motors, named after their joints,
    how much they turn per turn of other joints (``{wrist_6: {wrist_5: 1.0}}``); torques and currents are then the
    motors', reflected through their own gears. ``feet`` are those that carry a floating base whose contact wrenches
    nobody measures; their flags are the columns ``contact.NAME``. The columns of an ``imu`` make the base's pose
    unnecessary there. ``guessed`` is what a conversion of somebody's recording took for granted.
    """

    schema_: Literal["excite.log/1"] = Field(alias="schema")
    robot: Text
    base: Literal["fixed", "floating", "suspended", "held"]
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, -9.81)
    rate_hz: Rate
    lowpass_hz: Cutoff | None = None
    posture: Literal["measured", "computed"] = "measured"
    joints: tuple[Name, ...] = Field(min_length=1, max_length=MAX_NAMES)
    torque: Literal["motor_side", "link_side", "current", "none"] | None = None
    torque_constants: dict[Name, Factor] = Field(default_factory=dict)
    no_torque: tuple[Name, ...] = Field(default=(), max_length=MAX_NAMES)
    coupling: dict[Name, dict[Name, Factor]] = Field(default_factory=dict)
    controller: dict[Any, Any] | None = None
    base_link: Name | None = None
    wrench: Literal["on_robot_in_sensor_frame"] | None = None
    sensors: tuple[SensorHeader, ...] = Field(default=(), max_length=MAX_NAMES)
    feet: tuple[FootHeader, ...] = Field(default=(), max_length=MAX_NAMES)
    imu: ImuHeader | None = None
    modelled: tuple[Name, ...] = Field(default=("rigid_body",), max_length=MAX_NAMES)
    guessed: tuple[Guess, ...] = Field(default=(), max_length=MAX_TRIALS)
    trials: tuple[TrialHeader, ...] = Field(min_length=1, max_length=MAX_TRIALS)

    @property
    def free_base(self) -> bool:
        """Whether the base moves, so that its pose is logged."""
        return self.base in ("floating", "suspended")

    @property
    def measures_forces(self) -> bool:
        """Whether anything can be identified from it: of a fixed base not from commands or bare amperes alone."""
        known = self.torque != "current" or {*self.joints} <= {*self.no_torque, *self.torque_constants}
        return self.free_base or (self.torque != "none" and known)

    @property
    def measures_contacts(self) -> bool:
        """Whether wrench sensors see all that carries the base, so that the base's rows are the equations."""
        return self.base == "floating" and bool(self.sensors)

    @property
    def uses_imu(self) -> bool:
        """Whether the base's motion comes from its IMU: what is free of the world's frame needs no pose."""
        return self.imu is not None and self.free_base and not self.measures_contacts

    @property
    def torque_joints(self) -> tuple[str, ...]:
        """Joints whose torque or current was measured."""
        return tuple(joint for joint in self.joints if joint not in self.no_torque)


@dataclass(frozen=True)
class Cleaning:
    """What was found wrong with a trial's samples when it was read, and what was done about it.

    Attributes:
        repeated_rows: rows whose time stamp repeats an earlier one; removed.
        reordered_rows: rows that stood before their time; put in order.
        missing_rows: rows that the median sampling interval lets one expect and that are not there.
        longest_gap_s: longest interval between two samples [s].
        rate_hz: one over the median sampling interval [Hz].
        jitter: standard deviation of the sampling interval over its median, gaps left out.
        clipped: by column, number of samples stuck at the column's largest or smallest value.
        quantised: by column, the step between neighbouring values, where it shows.
        time_unit: unit of the stamps in the file where it was another than seconds, such as ``milliseconds``.
    """

    repeated_rows: int = 0
    reordered_rows: int = 0
    missing_rows: int = 0
    longest_gap_s: float = 0.0
    rate_hz: float = 0.0
    jitter: float = 0.0
    clipped: Mapping[str, int] = field(default_factory=dict)
    quantised: Mapping[str, float] = field(default_factory=dict)
    time_unit: str = ""


@dataclass(frozen=True, eq=False)
class Trial:
    """The channels of one trial; channels that were not logged are None (or absent from ``wrenches``).

    Attributes:
        name: stem of its file.
        role: ``identification`` or ``validation``.
        time: ``(n,)`` [s].
        q: joint positions ``(n, n_joints)`` [rad or m], in the header's order of joints.
        tau: joint torques ``(n, n_joints)`` [N·m or N].
        current: motor currents ``(n, n_joints)`` [A].
        q_cmd: commanded positions ``(n, n_joints)``.
        tau_cmd: commanded torques ``(n, n_joints)`` [N·m or N].
        v: measured velocities ``(n, n_joints)``.
        a: measured accelerations ``(n, n_joints)``.
        base: base pose ``(n, 7)``: x y z qx qy qz qw, world frame.
        wrenches: by sensor name, ``(n, 6)``: force [N] then moment [N·m] on the robot, in the sensor's frame.
        contacts: by foot name, ``(n,)`` whether it carries.
        imu: ``(n, 6)``: angular velocity [rad/s], then acceleration less gravity [m/s²], frame of the IMU's link.
        session: session name.
        start_s: when the trial began within its session [s].
        repeats: stem of the trial whose command this one repeats.
        beyond: ``(n, n_joints)`` where a torque or current was beyond the range of what measured it, and what stands
            there is not what it was; None where it never was, or nobody has looked.
        cleaning: what was found and repaired when it was read.
    """

    name: str
    role: str
    time: Array
    q: Array
    tau: Array | None = None
    current: Array | None = None
    q_cmd: Array | None = None
    tau_cmd: Array | None = None
    v: Array | None = None
    a: Array | None = None
    base: Array | None = None
    wrenches: Mapping[str, Array] = field(default_factory=dict)
    contacts: Mapping[str, Flags] = field(default_factory=dict)
    imu: Array | None = None
    session: str | None = None
    start_s: float | None = None
    repeats: str | None = None
    beyond: Flags | None = None
    cleaning: Cleaning = field(default_factory=Cleaning)

    def __repr__(self) -> str:
        joints = count(self.q.shape[-1], "joint")
        return f"Trial({self.name!r}, {self.role}, {self.n_samples} samples, {joints})"

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return len(self.time)

    def rows(self, which: Flags | NDArray[np.intp]) -> Trial:
        """The trial with some of its rows, by mask or in the order of their indices."""

        def take_rows(values: Array | None) -> Array | None:
            return None if values is None else values[which]

        return replace(
            self,
            time=self.time[which],
            q=self.q[which],
            tau=take_rows(self.tau),
            current=take_rows(self.current),
            q_cmd=take_rows(self.q_cmd),
            tau_cmd=take_rows(self.tau_cmd),
            v=take_rows(self.v),
            a=take_rows(self.a),
            base=take_rows(self.base),
            imu=take_rows(self.imu),
            wrenches={name: values[which] for name, values in self.wrenches.items()},
            contacts={name: flags[which] for name, flags in self.contacts.items()},
            beyond=None if self.beyond is None else self.beyond[which],
        )


@dataclass(frozen=True, eq=False)
class Log:
    """A log folder in memory.

    Attributes:
        header: contents of ``log.yaml``.
        trials: one per entry of ``header.trials``, in order.
        folder: where it was read from, None for a log made in memory.
        robot_text: contents of the file ``header.robot`` (URDF or ``robot.yaml``); a log made in memory
            needs it to be saved.
    """

    header: LogHeader
    trials: tuple[Trial, ...]
    folder: Path | None = None
    robot_text: str | None = None

    def __post_init__(self) -> None:
        # What a log in memory says in its header alone would else be known only once it has been saved and read.
        entries = {Path(entry.file).stem: entry for entry in self.header.trials}
        trials = tuple(_as_stated(trial, entries.get(trial.name)) for trial in self.trials)
        object.__setattr__(self, "trials", trials)

    def __repr__(self) -> str:
        seconds = sum(float(trial.time[-1] - trial.time[0]) for trial in self.trials if trial.n_samples)
        joints, trials = count(len(self.header.joints), "joint"), count(len(self.trials), "trial")
        return f"Log({self.header.robot!r}, {self.header.base} base, {joints}, {trials}, {seconds:.0f} s)"

    def role(self, role: str) -> tuple[Trial, ...]:
        """The trials of one role."""
        return tuple(trial for trial in self.trials if trial.role == role)


def _as_stated(trial: Trial, entry: TrialHeader | None) -> Trial:
    """A trial with what its entry in the header says of its session and of what it repeats."""
    if entry is None:
        return trial
    start = entry.start_s if trial.start_s is None else trial.start_s
    repeats = trial.repeats or (None if entry.repeats is None else Path(entry.repeats).stem)
    return replace(trial, session=trial.session or entry.session, start_s=start, repeats=repeats)
