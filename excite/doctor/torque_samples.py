"""Torques of a log beside those of the nominal model, for any reading of its channels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, Moved
from excite.doctor import perturbed_residuals as families
from excite.doctor.channel_mapping import Reading
from excite.doctor.inertial_prior import Judgement, LikelyBodies, half_log
from excite.doctor.model_comparison import WIDTH, Drive, Predicted, beside_drives, shares_across, shares_left
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import inverse_dynamics
from excite.regressor.tree import KinematicTree, read_tree
from excite.robot.prismatic import is_prismatic
from excite.robot.robot import Robot
from excite.rows.joint_rows import JointRows
from excite.rows.kinematics import TrialKinematics, forces_on_grid, trial_kinematics
from excite.rows.saturation import flags_at, reached_samples
from excite.rows.settings import ProblemSettings

# Samples that every reading is judged on: some hundred of a motion tell its joints' torques as well as all.
_SAMPLES = 600
_JUDGED = 250
# Readings of an arm of eight joints that are compared on all samples; those of a humanoid, on this many at least.
_COMPARED, _LEAST_SAMPLES = 28, 120
# Motions whose torques are kept: corrections change one thing at a time and come back to the same few.
_REMEMBERED = 64
# Share of a torque's power that bodies make where they tell something of it.
_TELLS = 0.05


@dataclass(frozen=True, eq=False)
class TorqueSamples:
    """Samples of a log's trials, channels as they stand in it.

    Attributes:
        robot: the robot in the log.
        joints: the log's joints; ``places`` their indices into ``v``.
        measured: indices into ``joints`` of those that have a torque.
        q: ``(n, nq)`` filtered; ``v``, ``a`` ``(n, nv)``.
        torque: ``(n_all, n_torques)`` filtered as the positions, every sample of the trials [N·m].
        rows: ``(n,)`` where in ``torque`` the samples are; ``first``, ``last`` the ends of their trials there.
        rate_hz: of ``torque``, and of the stamps; ``stated_hz`` what the log's header says.
        speeds: whether every trial has logged velocities, with which the clock agrees by now.
        within: share of the rows in which each torque is not at an end of its range, ``(n_torques,)``.
        carried: ``(10·n_segments,)`` inertial parameters that are added to the model's; None for none.
    """

    robot: Robot
    joints: tuple[str, ...]
    places: NDArray[np.int64]
    measured: NDArray[np.int64]
    q: Array
    v: Array
    a: Array
    torque: Array
    rows: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    rate_hz: float
    stated_hz: float
    speeds: bool
    within: Array
    carried: Array | None = None
    _models: dict[bytes, Predicted] = field(default_factory=dict, init=False, repr=False)

    @property
    def measured_name(self) -> str:
        """Torques."""
        return "torques"

    @property
    def channels(self) -> tuple[str, ...]:
        """Joints that have a torque."""
        return tuple(self.joints[k] for k in self.measured)

    def slides(self, joint: int) -> bool:
        """Whether a joint slides; it has no quarter turns."""
        return is_prismatic(self.robot.model, int(self.places[joint]))

    def motion(self, reading: Reading) -> Moved:
        """``q``, ``v``, ``a`` of the joints as the reading has them."""
        shift = self.q.shape[1] - self.v.shape[1]
        factor = reading.position_sign * reading.unit
        found = []
        for values, offset, scale in (
            (self.q, shift, 1.0),
            (self.v, 0, reading.tick),
            (self.a, 0, reading.tick**2),
        ):
            made = values.copy()
            made[:, self.places + offset] = (
                values[:, self.places[reading.position_of] + offset] * factor / scale
            )
            found.append(made)
        found[0][:, self.places + shift] += reading.zero
        return Moved(*found)

    def predicted(self, reading: Reading) -> Predicted:
        """What the nominal model says of measured joints."""
        key = reading.motion_key()
        if key not in self._models:
            q, v, a = self.motion(reading)
            columns = self.places[self.measured]
            torque = self._nominal(reading, q, v, a)
            if len(self._models) >= _REMEMBERED:
                del self._models[next(iter(self._models))]
            self._models[key] = Predicted(
                torque, Drive.of(v[:, columns], a[:, columns], reading.speed[self.measured])
            )
        return self._models[key]

    def measured_torque(self, reading: Reading) -> Array:
        """Torques as the reading has them, ``(n, n_torques)``."""
        values = self.torque[self.rows] if reading.late_s == 0.0 else self._between(reading)
        return values[:, reading.torque_of] * reading.torque_factor

    def tells(self, reading: Reading) -> NDArray[np.bool_]:
        """Which torques the nominal bodies make a good share of, ``(n_torques,)``."""
        model, torque = self.predicted(reading).torque, self.measured_torque(reading)
        return np.asarray(model.var(axis=0) > _TELLS * torque.var(axis=0))

    def left(self, reading: Reading) -> Array:
        """Half the logarithm of the share of each torque's power that nothing explains, ``(n_torques,)``."""
        model, drive = self.predicted(reading)
        return half_log(shares_left(self.measured_torque(reading), model, drive))

    def by_zero(self, reading: Reading, joint: int) -> Callable[[Array], Array]:
        """What is left, as a function of angles added to a joint's zero ``(k,)`` [rad]: ``(k, n_torques)``."""
        moved = [self.predicted(reading.with_position(joint, zero=angle)).torque for angle in families.TURNS]
        return families.by_zero(self.measured_torque(reading), moved, self.predicted(reading).drive)

    def by_gravity(self, reading: Reading) -> Callable[[Array], Array]:
        """What is left, as a function of gravities ``(k, 3)`` [m/s²]: ``(k, n_torques)``."""
        pulls = np.vstack([np.zeros(3), np.eye(3)])
        still, *pulled = (self.predicted(replace(reading, gravity=pull)).torque for pull in pulls)
        drive = self.predicted(reading).drive
        return families.by_gravity(self.measured_torque(reading), still, pulled, drive)

    def by_clock(self, reading: Reading) -> Callable[[float], Array]:
        """What is left, as a function of the factor by which a unit of the stamps grows: ``(n_torques,)``."""
        model, drive = self.predicted(reading)
        q, v, _ = self.motion(reading)
        still = np.zeros_like(v)
        weight = self._nominal(reading, q, still, still)
        return families.by_clock(self.measured_torque(reading), model, weight, drive)

    def judged(self, reading: Reading, counts: Array | None = None) -> Judgement:
        """As :meth:`left`, beside the likeliest bodies for this reading, by so many effective samples a torque."""
        tree = self.under(reading.gravity)
        motion = self.motion(reading)
        some = slice(None, None, max(1, len(self.q) // _JUDGED))
        torque = self.measured_torque(reading)[some]
        q, v, a = (values[some] for values in motion)
        return LikelyBodies.of(tree).left(
            tree,
            (q, v, a),
            self.places[self.measured],
            torque,
            self.predicted(reading).torque[some],
            WIDTH * reading.speed[self.measured],
            self.first[some],
            counts,
        )

    def across(self, reading: Reading) -> Array:
        """The same of every torque column taken for every joint's, ``(n_joints, n_columns)``, the better sign."""
        return half_log(shares_across(self.measured_torque(reading), *self.predicted(reading)))

    def gains(self, reading: Reading) -> tuple[Array, Array]:
        """Measured torque per modelled one beside the drive, and its share of the torque, each ``(n_torques,)``."""
        torque = self.measured_torque(reading)
        pairs = beside_drives(torque, *self.predicted(reading))
        power = ((torque - torque.mean(axis=0)) ** 2).sum(axis=0)
        gains = np.array([float(x @ y) / max(float(x @ x), 1e-300) for y, x in pairs])
        return gains, gains**2 * np.array([float(x @ x) for _, x in pairs]) / np.maximum(power, 1e-300)

    def agreement(self, reading: Reading) -> Array:
        """Squared correlation of measured and modelled torques beside the drive, ``(n_torques,)``."""
        pairs = beside_drives(self.measured_torque(reading), *self.predicted(reading))
        return np.array([float(x @ y) ** 2 / max(float(x @ x) * float(y @ y), 1e-300) for y, x in pairs])

    def fewer(self, readings: int) -> TorqueSamples:
        """The same with less samples where this many readings are to be compared; an arm's keep all."""
        share = min(max(1, readings // _COMPARED), max(1, len(self.q) // _LEAST_SAMPLES))
        some = slice(None, None, share)
        thinned = {name: getattr(self, name)[some] for name in ("q", "v", "a", "rows", "first", "last")}
        return replace(self, **thinned)

    @cached_property
    def _tree(self) -> KinematicTree:
        tree = read_tree(self.robot.model)
        return tree if self.carried is None else replace(tree, phi=tree.phi + self.carried)

    def under(self, gravity: Array) -> KinematicTree:
        """The robot's kinematics under another gravity."""
        return replace(self._tree, gravity=np.asarray(gravity, dtype=float))

    def _nominal(self, reading: Reading, q: Array, v: Array, a: Array) -> Array:
        """What measured torques hold of the nominal bodies' along a motion, ``(n, n_torques)``."""
        gravity = np.zeros(3) if reading.weightless else reading.gravity
        return inverse_dynamics(self.under(gravity), q, v, a)[:, self.places[self.measured]]

    def _between(self, reading: Reading) -> Array:
        """Torques that were logged ``late_s`` after the samples."""
        at = np.clip(self.rows + reading.late_s / reading.tick * self.rate_hz, self.first, self.last - 1e-9)
        below = at.astype(np.int64)
        share = (at - below)[:, None]
        return (1.0 - share) * self.torque[below] + share * self.torque[below + 1]


def torque_samples(robot: Robot, log: Log) -> TorqueSamples | None:
    """Samples at which some joint moves, thinned out; None where no trial can be used, and of mechanisms."""
    robot, settings = robot_in_log(robot, log.header, log.folder), ProblemSettings()
    filters = settings.filters(floating=False)
    filters = replace(filters, kinematics_cutoff_hz=filters.cutoff_hz)
    source = JointRows(robot, log.header, settings, filters, ())
    parts, torques, starts, rate, end = [], [], [], 0.0, 0
    for trial in log.role("identification") if robot.mechanism is None else ():
        try:
            k = trial_kinematics(robot, log.header, trial, settings, filters)
            torque = forces_on_grid(trial.time, source.torque(trial), k.time)
        except LogError:
            continue
        rows = np.flatnonzero(k.in_motion & looked_at(log, trial, k, filters.cutoff_hz))
        parts.append((k.q[rows], k.v[rows], k.a[rows], rows + end))
        starts.append(np.tile([end, end + len(torque) - 1], (len(rows), 1)))
        torques.append(lowpass(torque, k.rate_hz, filters.cutoff_hz, filters.order))
        rate, end = k.rate_hz, end + len(torque)
    if not parts or not sum(len(part[0]) for part in parts):
        return None
    q, v, a, rows = (np.concatenate([part[i] for part in parts]) for i in range(4))
    ends = np.concatenate(starts)
    some = slice(None, None, max(1, len(q) // _SAMPLES))
    joints = log.header.joints
    return TorqueSamples(
        robot,
        joints,
        np.array([robot.n_base_v + robot.joint_index(name) for name in joints]),
        np.array([joints.index(name) for name in log.header.torque_joints]),
        q[some],
        v[some],
        a[some],
        np.concatenate(torques),
        rows[some],
        ends[some, 0],
        ends[some, 1],
        rate,
        log.header.rate_hz,
        all(trial.v is not None for trial in log.trials),
        rows_within(log),
    )


# How much of a log's torques lies within the ranges of what measured them, and which rows do.

# Share of a log's rows in which all torques are within their ranges, from which the others need not be looked at.
_ENOUGH = 0.25


def rows_within(log: Log) -> Array:
    """Share of the rows that are looked at in which each torque is not clipped, ``(n_torques,)``, above zero."""
    trials = log.role("identification")
    if _enough(log):
        return np.ones(len(log.header.torque_joints))
    rows = max(1, sum(len(trial.time) for trial in trials))
    kind = "i" if log.header.torque == "current" else "tau"
    cut = [
        sum(trial.cleaning.clipped.get(f"{kind}.{joint}", 0) for trial in trials)
        for joint in log.header.torque_joints
    ]
    return 1.0 - np.minimum(np.array(cut, dtype=float), rows - 1) / rows


def looked_at(log: Log, trial: Trial, k: TrialKinematics, cutoff_hz: float) -> NDArray[np.bool_]:
    """Rows of a trial in which all torques are within their ranges, ``(n,)``; all where too few of the log are.

    Args:
        log: the log.
        trial: one of its trials.
        k: its kinematics, whose samples the rows are.
        cutoff_hz: of the filter that torques go through [Hz].
    """
    if trial.beyond is None or not _enough(log):
        return np.ones(len(k.time), dtype=np.bool_)
    lost = np.asarray(flags_at(trial.time, trial.beyond, k.time).any(axis=1))
    return ~reached_samples(lost, k.rate_hz, cutoff_hz)


def _enough(log: Log) -> bool:
    """Whether some torques of a log are beyond their range, and in enough of its rows none is."""
    trials = log.role("identification")
    if all(trial.beyond is None for trial in trials):
        return False
    lost = sum(0 if trial.beyond is None else int(trial.beyond.any(axis=1).sum()) for trial in trials)
    rows = sum(len(trial.time) for trial in trials)
    return rows - lost >= _ENOUGH * rows
