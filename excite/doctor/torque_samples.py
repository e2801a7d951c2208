"""Torques of a log beside those of the nominal model, for any reading of its channels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, Moved
from excite.doctor.channel_mapping import Reading
from excite.doctor.inertial_prior import Judgement, half_log, judge_bodies, likely_spread
from excite.doctor.model_comparison import Drive, Predicted, remove_drives, shares_across, shares_left
from excite.doctor.samples import Samples
from excite.doctor.thresholds import THRESHOLD
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import inverse_dynamics, joint_torque_regressor
from excite.regressor.tree import KinematicTree, read_tree
from excite.robot.robot import Robot
from excite.rows.joint_rows import JointRows
from excite.rows.kinematics import TrialKinematics, forces_on_grid, trial_kinematics
from excite.rows.saturation import flags_at, reached_samples
from excite.rows.settings import ProblemSettings

# Motions whose torques are kept: corrections change one thing at a time and come back to the same few.
_REMEMBERED = 64


@dataclass(frozen=True, eq=False, kw_only=True)
class TorqueSamples(Samples):
    """Torques: ``logged (n_all, n_torques)`` [N·m or N].

    Attributes:
        measured: indices into ``joints`` of those that have a torque.
        q: ``(n, nq)`` filtered; ``v``, ``a`` ``(n, nv)``.
        stated_hz: the rate that the log's header says.
        speeds: whether every trial has logged velocities, with which the clock agrees by now.
        within: share of the rows in which each torque is not at an end of its range, ``(n_torques,)``.
        carried: ``(10·n_segments,)`` inertial parameters that are added to the model's; None for none.
    """

    what: ClassVar[str] = "torques"

    measured: NDArray[np.int64]
    q: Array
    v: Array
    a: Array
    stated_hz: float
    speeds: bool
    within: Array
    carried: Array | None = None

    @property
    def channels(self) -> tuple[str, ...]:
        """Joints that have a torque."""
        return tuple(self.joints[k] for k in self.measured)

    def motion(self, reading: Reading) -> Moved:
        """``q``, ``v``, ``a`` of the joints as the reading has them."""
        return self.read_motion(Moved(self.q, self.v, self.a), reading)

    def predicted(self, reading: Reading) -> Predicted:
        """What the nominal model says of measured joints."""
        key = reading.motion_key()
        if key not in self._models:
            q, v, a = self.motion(reading)
            columns = self.places[self.measured]
            if len(self._models) >= _REMEMBERED:
                del self._models[next(iter(self._models))]
            drive = Drive.of(v[:, columns], a[:, columns], reading.speed[self.measured])
            self._models[key] = Predicted(self._nominal(reading, q, v, a), drive)
        found: Predicted = self._models[key]
        return found

    def measured_torque(self, reading: Reading) -> Array:
        """Torques as the reading has them, ``(n, n_torques)``."""
        return self.logged_late(reading)[:, reading.torque_of] * reading.torque_factor

    def tells(self, reading: Reading) -> NDArray[np.bool_]:
        """Which torques the nominal bodies make a good share of, ``(n_torques,)``."""
        model, torque = self.predicted(reading).torque, self.measured_torque(reading)
        return np.asarray(model.var(axis=0) > THRESHOLD.telling_share * torque.var(axis=0))

    def left(self, reading: Reading) -> Array:
        """Half the logarithm of the share of each torque's power that nothing explains, ``(n_torques,)``."""
        return half_log(shares_left(self.measured_torque(reading), *self.predicted(reading)))

    def mixed(
        self, readings: Sequence[Reading], weights: Callable[[Array], Array]
    ) -> Callable[[Array], Array]:
        """See :meth:`Samples.mixed`."""
        torque, parts = self.measured_torque(readings[0]), [self.predicted(one) for one in readings]
        models = np.stack([part.torque for part in parts])
        return lambda values: half_log(shares_left(torque, models, parts[0].drive, weights(values)))

    def by_clock(self, reading: Reading) -> Callable[[float], Array]:
        """What is left, as a function of the factor by which a unit of the stamps grows: ``(n_torques,)``.

        Weights stay; all else of the torques goes with the square of the speeds.
        """
        model, drive = self.predicted(reading)
        q, v, _ = self.motion(reading)
        weight = self._nominal(reading, q, np.zeros_like(v), np.zeros_like(v))
        torque, parts = self.measured_torque(reading), np.stack([weight, model - weight])

        def left(factor: float) -> Array:
            moved = Drive(drive.v / factor, drive.sign, drive.a / factor**2)
            return half_log(shares_left(torque, parts, moved, np.array([[1.0, factor**-2]]))[0])

        return left

    def judged(self, reading: Reading, counts: Array | None = None, zeros: Array | None = None) -> Judgement:
        """As :meth:`left`, beside the likeliest bodies for this reading, by so many effective samples a torque.

        With ``zeros``, standard deviations of what the joints' zeros are off ``(n_joints,)`` [rad], these are free,
        too, to first order: the last of what has moved.
        """
        some = slice(None, None, max(1, int(len(self.q) / THRESHOLD.judged_samples)))
        tree, (model, drive) = self.under(reading.gravity), self.predicted(reading)
        torque = self.measured_torque(reading)[some]
        scale = np.maximum(torque.std(axis=0), 1e-12)
        q, v, a = (values[some] for values in self.motion(reading))
        body = joint_torque_regressor(tree, q, v, a)[:, self.places[self.measured]] / scale[:, None]
        own = np.stack([np.ones_like(torque), *(part[some] for part in drive)], axis=2)
        # Offset, friction and rotor in units of the torque's own deviation and the motion's are as good as free.
        own *= THRESHOLD.free_drive / np.maximum(np.sqrt((own**2).mean(axis=0)), 1e-12)
        target, spread = (torque - model[some]) / scale, likely_spread(tree)
        if zeros is not None:
            felt = [self._felt_zero(reading, j)[some] / scale for j in range(len(zeros))]
            body, spread = np.concatenate([body, np.stack(felt, axis=2)], axis=2), np.r_[spread, zeros]
        trial, precise = self.first[some], zeros is not None
        return judge_bodies(spread, body, own, target, trial, counts, of_drives=True, precise=precise)

    def _felt_zero(self, reading: Reading, joint: int) -> Array:
        """Nominal torques per radian of a joint's zero, ``(n, n_torques)``."""
        step = 0.01
        ahead, behind = (self.predicted(reading.with_position(joint, zero=x)).torque for x in (step, -step))
        return (ahead - behind) / (2.0 * step)

    def across(self, reading: Reading) -> Array:
        """The same of every torque column taken for every joint's, ``(n_joints, n_columns)``, the better sign."""
        return half_log(shares_across(self.measured_torque(reading), *self.predicted(reading)))

    def _beside_drives(self, reading: Reading) -> tuple[Array, Array]:
        model, drive = self.predicted(reading)
        torque, model = remove_drives(drive, self.measured_torque(reading), model)
        return torque, model

    def gains(self, reading: Reading) -> tuple[Array, Array]:
        """Measured torque per modelled one beside the drive, and its share of the torque, each ``(n_torques,)``."""
        y, x = self._beside_drives(reading)
        size = (x**2).sum(axis=0)
        gains = (x * y).sum(axis=0) / np.maximum(size, 1e-300)
        power = len(y) * self.measured_torque(reading).var(axis=0)
        return gains, gains**2 * size / np.maximum(power, 1e-300)

    def agreement(self, reading: Reading) -> Array:
        """Squared correlation of measured and modelled torques beside the drive, ``(n_torques,)``."""
        y, x = self._beside_drives(reading)
        power = np.maximum((x**2).sum(axis=0) * (y**2).sum(axis=0), 1e-300)
        return np.asarray((x * y).sum(axis=0) ** 2 / power)

    def fewer(self, readings: int) -> TorqueSamples:
        """The same with less samples where this many readings are to be compared; an arm's keep all."""
        most = max(1, int(len(self.q) / THRESHOLD.fewest_samples))
        some = slice(None, None, min(max(1, int(readings / THRESHOLD.compared_readings)), most))
        thinned = {name: getattr(self, name)[some] for name in ("q", "v", "a", "rows", "first", "last")}
        return replace(self, **thinned)

    @cached_property
    def _tree(self) -> KinematicTree:
        tree = read_tree(self.robot.model)
        return tree if self.carried is None else replace(tree, phi=tree.phi + self.carried)

    def under(self, gravity: Array) -> KinematicTree:
        """The robot's kinematics under another gravity."""
        return replace(self._tree, gravity=np.asarray(gravity, dtype=float))

    def felt(self, reading: Reading, *, still: bool = False) -> Array:
        """Measured torques, or their weight, per unit of each inertial parameter, ``(n, n_torques, 10·n_segments)``."""
        q, v, a = self.motion(reading)
        tree, rest = self.under(reading.gravity), np.zeros_like(v)
        return joint_torque_regressor(tree, q, *((rest, rest) if still else (v, a)))[
            :, self.places[self.measured]
        ]

    def _nominal(self, reading: Reading, q: Array, v: Array, a: Array) -> Array:
        """What measured torques hold of the nominal bodies' along a motion, ``(n, n_torques)``."""
        columns = self.places[self.measured]
        torque = inverse_dynamics(self.under(reading.gravity), q, v, a)[:, columns]
        return torque - reading.taken_weight(self._tree, q, columns)


def torque_samples(robot: Robot, log: Log) -> TorqueSamples | None:
    """Samples at which some joint moves, thinned out; None where no trial can be used, and of mechanisms."""
    robot, settings = robot_in_log(robot, log.header, log.folder), ProblemSettings()
    filters = settings.filters(floating=False)
    filters = replace(filters, kinematics_cutoff_hz=filters.cutoff_hz)
    source = JointRows(robot, log.header, settings, filters, ())
    trials = log.role("identification") if robot.mechanism is None else ()
    share = _share_within(trials)
    parts, torques, rate, end = [], [], 0.0, 0
    for trial in trials:
        try:
            k = trial_kinematics(robot, log.header, trial, settings, filters)
            torque = forces_on_grid(trial.time, source.torque(trial), k.time)
        except LogError:
            continue
        looked_at = _rows_within(trial, k, filters.cutoff_hz) if share else np.ones(len(k.time), dtype=bool)
        rows = np.flatnonzero(k.in_motion & looked_at)
        ends = np.tile([end, end + len(torque) - 1], (len(rows), 1))
        parts.append((k.q[rows], k.v[rows], k.a[rows], rows + end, *ends.T))
        torques.append(lowpass(torque, k.rate_hz, filters.cutoff_hz, filters.order))
        rate, end = k.rate_hz, end + len(torque)
    if not parts or not sum(len(part[0]) for part in parts):
        return None
    joined = [np.concatenate(part) for part in zip(*parts, strict=True)]
    some = slice(None, None, max(1, int(len(joined[0]) / THRESHOLD.torque_samples)))
    q, v, a, rows, first, last = (part[some] for part in joined)
    joints, kind = log.header.joints, "i" if log.header.torque == "current" else "tau"
    names = [f"{kind}.{joint}" for joint in log.header.torque_joints]
    n = max(1, sum(len(trial.time) for trial in trials))
    cut = np.array([sum(trial.cleaning.clipped.get(name, 0) for trial in trials) for name in names])
    return TorqueSamples(
        robot=robot,
        joints=joints,
        places=np.array([robot.n_base_v + robot.joint_index(name) for name in joints]),
        measured=np.array([joints.index(name) for name in log.header.torque_joints]),
        q=q,
        v=v,
        a=a,
        logged=np.concatenate(torques),
        rows=rows,
        first=first,
        last=last,
        rate_hz=rate,
        stated_hz=log.header.rate_hz,
        speeds=all(trial.v is not None for trial in log.trials),
        within=np.ones(len(names)) if share else 1.0 - np.minimum(cut, n - 1) / n,
    )


def _share_within(trials: Sequence[Trial]) -> bool:
    """Whether some torques are beyond their range, and enough rows are left in which none is."""
    lost = sum(int(trial.beyond.any(axis=1).sum()) for trial in trials if trial.beyond is not None)
    rows = sum(len(trial.time) for trial in trials)
    return any(trial.beyond is not None for trial in trials) and rows - lost >= THRESHOLD.rows_within * rows


def _rows_within(trial: Trial, k: TrialKinematics, cutoff_hz: float) -> NDArray[np.bool_]:
    """Rows of a trial in which all torques are within their ranges and so is what its filter sees, ``(n,)``."""
    if trial.beyond is None:
        return np.ones(len(k.time), dtype=np.bool_)
    lost = np.asarray(flags_at(trial.time, trial.beyond, k.time).any(axis=1))
    return ~reached_samples(lost, k.rate_hz, cutoff_hz)
