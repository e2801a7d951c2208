"""Rows of the joint torque equation: bodies and drives against torques, less contact forces that nobody measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from excite.arrays import Array, Flags, widen_flags
from excite.errors import LogError
from excite.logs.log import LogHeader, Trial
from excite.logs.signals.coupling import coupling_matrix, joint_torques
from excite.logs.signals.resample import long_standstill
from excite.regressor.contact_forces import contact_elimination, motor_regressor, motor_torques
from excite.robot.joint_values import per_joint
from excite.robot.prismatic import is_prismatic
from excite.robot.robot import Robot
from excite.rows.drive_terms import DRIVE_TERMS, JointSamples
from excite.rows.kinematics import (
    RowSource,
    TrialKinematics,
    TrialRows,
    filtered_rows,
    forces_on_grid,
    trial_kinematics,
)
from excite.rows.saturation import beyond_on_grid
from excite.rows.settings import Filters, ProblemSettings

SHARED_GEAR_TERMS = ("joint_viscous", "joint_coulomb", "joint_armature")
"""Drive terms of a gear that two motors drive."""

STANDS_FOR_S = 0.25
"""Stretches of standstill that are at least this long are left out [s]."""

# What both sides of a row at rest are multiplied by. Friction holds a joint with anything up to its level, a tenth to a
# third of an arm's torques; fits leave 2 to 8 % of them (LWR, TX40, UR10e). With whole weight eight postures made a
# UR10's prediction of motions half as bad again, with this one they do not.
AT_REST = 0.1


# Step of finite differences of positions [rad or m].
_TURN = 1e-6


@dataclass(frozen=True, eq=False)
class JointRows:
    """Builds rows ``τ = Y φ + drives`` of the joints in a log.

    Attributes:
        robot: the robot in the log.
        header: the log's header.
        settings: drive terms and gains, standstill, gaps.
        filters: filters.
        terms: names of the drive terms.
    """

    robot: Robot
    header: LogHeader
    settings: ProblemSettings
    filters: Filters
    terms: tuple[str, ...]

    @property
    def channel_names(self) -> tuple[str, ...]:
        """The log's joints that have a torque."""
        return self.header.torque_joints

    @property
    def channel_units(self) -> tuple[str, ...]:
        """``N`` for joints that slide, ``N·m`` for those that turn."""
        model = self.robot.model
        columns = (model.idx_vs[model.getJointId(name)] for name in self.channel_names)
        return tuple("N" if is_prismatic(model, column) else "N·m" for column in columns)

    @property
    def drive_names(self) -> tuple[str, ...]:
        """Names of the drive parameters, term by term."""
        return tuple(
            name for term in self.terms for name in DRIVE_TERMS[term].parameter_names(self.channel_names)
        )

    @property
    def drive_prior(self) -> Array:
        """What the robot's description says of its drives, zero where it is silent, ``(n_drive,)``."""
        drives, names = self.robot.description.drives, self.channel_names
        stated = {"viscous": drives.viscous, "coulomb": drives.coulomb, "armature": drives.armature}
        parts = [np.zeros(0)]
        for term in self.terms:
            nothing = np.zeros(len(DRIVE_TERMS[term].parameter_names(names)))
            parts.append(per_joint(stated[term], names, nothing) if term in stated else nothing)
        return np.concatenate(parts)

    @property
    def drive_spread(self) -> Array:
        """Standard deviation expected of each drive parameter, NaN where anything goes, ``(n_drive,)``."""
        parts = [np.zeros(0)]
        for term in self.terms:
            spread = DRIVE_TERMS[term].spread
            count = len(DRIVE_TERMS[term].parameter_names(self.channel_names))
            parts.append(np.full(count, np.nan if spread is None else spread))
        return np.concatenate(parts)

    @property
    def noise(self) -> Array:
        """Standard deviation of each joint's torque noise at full rate, 1 if not stated, ``(n_joints,)`` [N·m]."""
        return per_joint(
            self.robot.description.sensors.noise_torque, self.channel_names, np.ones(len(self.channel_names))
        )

    def rows(self, trial: Trial) -> TrialRows:
        """Rows of one trial.

        Raises:
            LogError: the trial has no torques or is too short.
        """
        k = trial_kinematics(self.robot, self.header, trial, self.settings, self.filters)
        k = k.at_rest() if k.standing else k
        torque = forces_on_grid(trial.time, self.torque(trial), k.time)
        rate = np.gradient(torque, k.time, axis=0)
        joints = self._joints_of()

        closed = closed_on_grid(self.robot, trial, k.time) if self.robot.floating else None

        def rows_of(part: slice) -> Array:
            body = motor_regressor(self.robot, k.q[part], k.v[part], k.a[part])
            samples = JointSamples(
                self.robot,
                k.q[part],
                k.v[part],
                k.a[part],
                joints,
                self.settings.coulomb_width,
                self.motors,
                rate=rate[part],
            )
            out = None
            here = closed[part] if closed is not None and self.robot.feet else None
            if here is not None:
                out = self._contact_elimination_of(k.q[part], here)
                body = out @ body
                # Of the log's own torques the noise would stand on both sides and feign that some are lost.
                excess = partial(self._excess_torques, samples, torque[part], out)
                samples = replace(samples, load=lambda: torque[part] + excess())
            drives = []
            for term in self.terms:
                if here is not None and term == "encoder":
                    drives.append(self._of_offsets(samples, torque[part], here))
                else:
                    columns = DRIVE_TERMS[term].columns(samples)
                    drives.append(columns if out is None else out[:, :, joints] @ columns)
            measured = torque[part, :, None]
            if out is None:
                return np.concatenate([body[:, joints], *drives, measured], axis=2)
            return np.concatenate([body, *drives, out[:, :, joints] @ measured], axis=2)

        return self._filter_rows(rows_of, trial, k, closed, freedom=True)

    def _filter_rows(
        self,
        source: RowSource,
        trial: Trial,
        k: TrialKinematics,
        closed: Flags | None,
        *,
        freedom: bool = False,
    ) -> TrialRows:
        """Rows of usable samples, away from changes of contacts, with the freedom that these leave them if asked."""
        rows = filtered_rows(source, k, self.filters, self._usable_samples(trial, k, self._joints_of()))
        if freedom and closed is not None and self.robot.feet:
            rows = replace(rows, freedom=self._row_freedom(rows, k, closed))
        return self._weigh_standing(away_from_changes(rows, k, closed), k)

    def _of_offsets(self, samples: JointSamples, torque: Array, closed: Flags) -> Array:
        """Change of rows per unit of encoder offset, ``(m, n_channels, n_joints)``: contacts move with their legs.

        What takes contact forces out of the rows changes with the posture as well as the bodies' torques do, and it
        acts on forces as large as the robot's weight.
        """

        at_hand = self._excess_torques(samples, torque, self._contact_elimination_of(samples.q, closed))
        columns = []
        for joint in samples.joints:
            q = samples.q.copy()
            q[:, joint + samples.q.shape[1] - samples.v.shape[1]] += _TURN
            out = self._contact_elimination_of(q, closed)
            columns.append((self._excess_torques(replace(samples, q=q), torque, out) - at_hand) / _TURN)
        return np.stack(columns, axis=2)

    def _excess_torques(self, samples: JointSamples, torque: Array, out: Array) -> Array:
        """Nominal bodies' torques over the logged ones, contact forces taken out by ``out``, ``(m, n_channels)``."""
        forces = motor_torques(self.robot, samples.q, samples.v, samples.a)
        forces[:, samples.joints] -= torque
        return np.asarray(np.einsum("mcv,mv->mc", out, forces))

    def _row_freedom(self, rows: TrialRows, k: TrialKinematics, closed: Flags) -> Array:
        """Share of each row that contacts leave it: the diagonal of what projects their forces out."""
        at = np.searchsorted(k.time, rows.time)
        out = self._contact_elimination_of(k.q[at], closed[at])[:, :, self._joints_of()]
        return np.asarray(np.einsum("ncc->nc", out))

    def measurement(self, trial: Trial, k: TrialKinematics) -> TrialRows:
        """Only the measured side of :meth:`rows`, ``values`` ``(m, n_joints, 1)``, for kinematics ``k``."""
        torque, joints = forces_on_grid(trial.time, self.torque(trial), k.time), self._joints_of()
        closed = closed_on_grid(self.robot, trial, k.time) if self.robot.floating else None

        def rows_of(part: slice) -> Array:
            if closed is None or not self.robot.feet:
                return torque[part, :, None]
            return self._contact_elimination_of(k.q[part], closed[part])[:, :, joints] @ torque[part, :, None]

        return self._filter_rows(rows_of, trial, k, closed)

    def nominal(self, trial: Trial, k: TrialKinematics) -> TrialRows:
        """Torques of the nominal bodies, then the measured ones, as :meth:`rows` has them, ``(m, n_joints, 2)``."""
        torque, joints = forces_on_grid(trial.time, self.torque(trial), k.time), self._joints_of()
        closed = closed_on_grid(self.robot, trial, k.time)

        def rows_of(part: slice) -> Array:
            forces = np.zeros((len(k.q[part]), self.robot.model.nv, 2))
            forces[:, :, 0] = motor_torques(self.robot, k.q[part], k.v[part], k.a[part])
            forces[:, joints, 1] = torque[part]
            return np.asarray(self._contact_elimination_of(k.q[part], closed[part]) @ forces)

        return self._filter_rows(rows_of, trial, k, closed)

    def change(self, trial: Trial, k: TrialKinematics, others: Sequence[TrialKinematics]) -> TrialRows:
        """Change of :meth:`rows`' nominal torques where other kinematics are true, ``(m, n_joints, n_others)``.

        Others differ from ``k`` in velocities and accelerations alone, as those of another reading of the IMU do.
        """
        closed = closed_on_grid(self.robot, trial, k.time)

        def rows_of(part: slice) -> Array:
            nominal = motor_torques(self.robot, k.q[part], k.v[part], k.a[part])
            changes = [motor_torques(self.robot, k.q[part], o.v[part], o.a[part]) - nominal for o in others]
            return np.asarray(
                self._contact_elimination_of(k.q[part], closed[part]) @ np.stack(changes, axis=2)
            )

        return self._filter_rows(rows_of, trial, k, closed)

    def _contact_elimination_of(self, q: Array, closed: Flags) -> Array:
        """What takes unmeasured contact forces out, ``(n, n_channels, nv)``; raises LogError if a torque is missing."""
        silent = [joint for joint in self.robot.driven_names if joint not in self.channel_names]
        if silent:
            raise LogError(
                f"says nothing of joint {silent[0]!r}",
                field="no_torque",
                remedy="contact forces that nobody measures are found from the torques of all joints: log them",
            )
        order = [self.robot.joint_index(name) for name in self.channel_names]
        return contact_elimination(self.robot, q, closed)[:, order]

    @cached_property
    def motors(self) -> Array | None:
        """Matrix from joint to motor velocities, ``(n_motors, n_joints)``, None where each joint has its own motor."""
        coupling = self.header.coupling
        return coupling_matrix(self.channel_names, coupling) if coupling else None

    def _joints_of(self) -> list[int]:
        return [self.robot.n_base_v + self.robot.joint_index(name) for name in self.channel_names]

    def _usable_samples(self, trial: Trial, k: TrialKinematics, joints: list[int]) -> Flags:
        """Samples inside the motion with known torques at which the joint moves: where it stands, stiction rules."""
        # What takes contact forces out of the rows mixes all joints.
        mixing = np.ones((len(joints),) * 2) if self.robot.floating and self.robot.feet else self.motors
        known = ~beyond_on_grid(trial, self._measured, k.time, mixing)
        use = (k.valid if k.standing else k.in_motion)[:, None] & known
        if "coulomb" in self.terms and not k.standing:
            shortest = max(2, round(STANDS_FOR_S * k.rate_hz))
            use &= ~long_standstill(k.v[:, joints], self.settings.standstill_velocity, shortest)
        return use

    def _weigh_standing(self, rows: TrialRows, k: TrialKinematics) -> TrialRows:
        """Rows of a trial that stands are one, their mean, where dry friction holds the joints.

        It holds them with one torque for as long as they stand: more rows of that posture say no more of its weight,
        and that one as much less as friction is larger than what a fit leaves of motion (:data:`AT_REST`).
        """
        inside = rows.use.all(axis=1)
        if not k.standing or "coulomb" not in self.terms or not inside.any():
            return rows
        values = AT_REST * rows.values[inside].mean(axis=0, keepdims=True)
        return TrialRows(values, rows.time[inside].mean(keepdims=True), rows.use[inside][:1])

    def torque(self, trial: Trial) -> Array:
        """Torques of the joints that have one ``(n, n_channels)`` [N·m]; raises LogError where there are none."""
        motor = self._motor_torque(trial)
        return motor if self.motors is None else joint_torques(motor, self.motors)

    @property
    def _measured(self) -> list[int]:
        """Columns of the joints that have a torque."""
        return [self.header.joints.index(joint) for joint in self.channel_names]

    def _motor_torque(self, trial: Trial) -> Array:
        if self.header.torque in {"motor_side", "link_side"} and trial.tau is not None:
            return trial.tau[:, self._measured]
        if self.header.torque != "current" or trial.current is None:
            raise LogError(
                "has no torques",
                source=trial.name,
                field="torque",
                remedy="log tau.* or i.* for identification",
            )
        gains = {**self.header.torque_constants, **self.settings.drive_gains}
        missing = [joint for joint in self.channel_names if joint not in gains]
        if missing:
            raise LogError(
                f"no torque per ampere is known for joint {missing[0]!r}",
                source=trial.name,
                field="torque",
                remedy="state torque_constants in log.yaml, or drive_gains in the settings [N·m/A]",
            )
        return np.asarray(
            trial.current[:, self._measured] * np.array([gains[joint] for joint in self.channel_names])
        )


def drive_terms(header: LogHeader, settings: ProblemSettings) -> tuple[str, ...]:
    """Drive terms of a log: the settings', else those that ``modelled`` names, else the usual ones."""
    if settings.drive_terms is not None:
        return settings.drive_terms
    named = tuple(
        name
        for name, term in DRIVE_TERMS.items()
        if any(effect in header.modelled for effect in term.effects)
    )
    return named or usual_terms(header)


def usual_terms(header: LogHeader) -> tuple[str, ...]:
    """Terms that joints have as a rule; a sensor behind the gear reads nothing of the rotor."""
    usual: tuple[str, ...] = ("viscous", "coulomb", "offset")
    if header.torque != "link_side":
        usual = (*usual, "armature")
    return (*usual, *SHARED_GEAR_TERMS) if header.coupling else usual


# Contact flags of a trial on the grid of its kinematics.

CHANGE_S = 0.01
"""Rows this long before and after a change of contacts are left out: a strike is over, and flags are right [s]."""


def closed_on_grid(robot: Robot, trial: Trial, grid: Array) -> Flags:
    """Which feet carry, ``(n, n_feet)``: each flag as at the last sample before.

    Args:
        robot: the robot in the log; one without feet, which hangs, has no flags.
        trial: the trial.
        grid: ``(n,)`` [s].

    Raises:
        LogError: a foot has no flag.
    """
    for foot in robot.feet:
        if foot.name not in trial.contacts:
            raise LogError(
                "is missing",
                source=trial.name,
                field=f"contact.{foot.name}",
                remedy="log whether the foot carries (1) or not (0), or add sensors of its contact wrench",
            )
    last = np.clip(np.searchsorted(trial.time, grid + 1e-9, side="right") - 1, 0, len(trial.time) - 1)
    flags = [np.asarray(trial.contacts[foot.name], dtype=bool)[last] for foot in robot.feet]
    return np.column_stack(flags) if flags else np.zeros((len(grid), 0), dtype=bool)


def away_from_changes(rows: TrialRows, k: TrialKinematics, closed: Flags | None) -> TrialRows:
    """Rows less those about a change of contacts, where feet strike and flags come late.

    Args:
        rows: of one trial.
        k: the trial's kinematics.
        closed: which feet carry, ``(n, n_feet)``; None where contacts play no part.
    """
    if closed is None or not closed.shape[1]:
        return rows
    near = _near_change(closed, round(CHANGE_S * k.rate_hz))[np.searchsorted(k.time, rows.time)]
    return replace(rows, use=rows.use & ~near[:, None])


def _near_change(closed: Flags, samples: int) -> Flags:
    """Samples within ``samples`` of a change of any flag, ``(n,)``."""
    change = np.zeros(len(closed), dtype=bool)
    differ = (closed[1:] != closed[:-1]).any(axis=1)
    change[1:] |= differ
    change[:-1] |= differ
    return widen_flags(change, samples)
