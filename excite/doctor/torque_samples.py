"""Torques of a log beside those of the nominal model, for any reading of its channels."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.special import chdtri

from excite.arrays import Array, Flags, Indices, Moved
from excite.doctor.channel_mapping import Reading
from excite.doctor.inertial_prior import STRONG_ODDS, Judgement, half_log, judge_bodies, likely_spread
from excite.doctor.model_comparison import (
    Columns,
    Predicted,
    drive_columns,
    fit_parts,
    remove_drives,
    shares_left,
)
from excite.doctor.samples import Samples, TrialValues, gather_samples
from excite.doctor.thresholds import THRESHOLD
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import inverse_dynamics, joint_torque_regressor
from excite.regressor.tree import KinematicTree, read_tree
from excite.robot.robot import Robot
from excite.rows.joint_rows import JointRows
from excite.rows.kinematics import forces_on_grid, trial_kinematics
from excite.rows.saturation import flags_at, reached_samples
from excite.rows.settings import ProblemSettings


class Gains(NamedTuple):
    """How measured torques compare with modelled ones beside the drives, each ``(n_torques,)``.

    Attributes:
        gain: measured torque per modelled one.
        share: share of the torque's power that the model explains so; ``agreement``: of what drives leave of it.
        left: half the logarithm of the share that nothing explains.
    """

    gain: Array
    share: Array
    agreement: Array
    left: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class TorqueSamples(Samples):
    """Torques: ``logged (n_all, n_torques)`` [N·m or N].

    Attributes:
        measured: indices into ``joints`` of those that have a torque.
        q: ``(n, nq)`` filtered; ``v``, ``a`` ``(n, nv)``.
        stated_hz: the rate that the log's header says.
        speeds: whether every trial has logged velocities, with which the clock agrees by now.
        ends: share of the rows in which each torque is at the lower and at the upper end of its range,
            ``(2, n_torques)``; nought where these rows are not among the samples.
        carried: ``(10·n_segments,)`` inertial parameters that are added to the model's; None for none.
    """

    what: ClassVar[str] = "torques"

    measured: Indices
    q: Array
    v: Array
    a: Array
    stated_hz: float
    speeds: bool
    ends: Array
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

        def make() -> Predicted:
            q, v, a = self.motion(reading)
            columns = self.places[self.measured]
            drive = drive_columns(v[:, columns], a[:, columns], (reading.unit / reading.tick)[self.measured])
            torque = self._nominal(reading, q, v, a)
            return Predicted(torque, drive, Columns.of(drive, torque))

        return self.keep_made("torques", reading.motion_key(), make)

    def body_columns(self, reading: Reading, *, still: bool = False) -> Columns:
        """Columns of the drive and of ten inertial parameters of each body, ``values (n_segments, n_torques, 13, n)``.

        What a driver has taken off torques does not change them; ``still``: of their weight alone.
        """
        whole = reading.with_weight()

        def make() -> Columns:
            felt = self.felt(reading, still=still)
            each = felt.reshape(*felt.shape[:2], -1, 10).transpose(3, 2, 0, 1)
            return Columns.of(self.predicted(whole).drive, *each)

        # They take much room.
        return self.keep_made("bodies", (whole.motion_key(), still), make, most=2)

    def measured_torque(self, reading: Reading) -> Array:
        """Torques as the reading has them, ``(n, n_torques)``."""
        torque = self.logged_late(reading)[:, reading.torque_of] @ reading.joined_torques(self.measured).T
        return torque * reading.torque_factor

    def product_sums(self, reading: Reading) -> Array:
        """Sums of products of drive, model and measured torque, ``(n_torques, 5, 5)``."""
        return self.predicted(reading).columns.sums_with(self.measured_torque(reading))

    def power(self, reading: Reading) -> Array:
        """Each torque's share of the power of all, ``(n_torques,)``."""
        power = self.product_sums(reading)[:, 4, 4]
        return np.asarray(power / max(power.sum(), 1e-300))

    def tells(self, reading: Reading) -> Flags:
        """Which torques the nominal bodies make a good share of, ``(n_torques,)``."""
        sums = self.product_sums(reading)
        return np.asarray(sums[:, 3, 3] > THRESHOLD.telling_share * sums[:, 4, 4])

    def left(self, reading: Reading) -> Array:
        """Half the logarithm of the share of each torque's power that nothing explains, ``(n_torques,)``."""
        return half_log(shares_left(self.product_sums(reading)))

    def mixed(
        self, readings: Sequence[Reading], weights: Callable[[Array], Array]
    ) -> Callable[[Array], Array]:
        """See :meth:`Samples.mixed`."""
        return self._mix_models(readings[0], [self.predicted(one).torque for one in readings], weights)

    def by_clock(self, reading: Reading) -> Callable[[Array], Array]:
        """What is left, as a function of factors by which a unit of the stamps grows ``(k,)``: ``(k, n_torques)``.

        Weights stay; all else of the torques goes with the square of the speeds, and sizes of the drive are free.
        """
        q, v, _ = self.motion(reading)
        weight = self._nominal(reading, q, np.zeros_like(v), np.zeros_like(v))
        parts = [weight, self.predicted(reading).torque - weight]
        return self._mix_models(reading, parts, lambda f: np.power.outer(f, [0.0, -2.0]))

    def _mix_models(
        self, reading: Reading, models: list[Array], weights: Callable[[Array], Array]
    ) -> Callable[[Array], Array]:
        columns = Columns.of(self.predicted(reading).drive, *models)
        sums = columns.sums_with(self.measured_torque(reading))

        def left(values: Array) -> Array:
            mix = np.zeros((len(values), 1, 5, sums.shape[-1]))
            mix[:, 0, 3, 3:-1] = weights(values)
            mix[:, 0, [0, 1, 2, 4], [0, 1, 2, -1]] = 1.0
            return half_log(shares_left(mix @ sums @ mix.swapaxes(2, 3)))

        return left

    def judged(self, reading: Reading, counts: Array | None = None, zeros: Array | None = None) -> Judgement:
        """As :meth:`left`, beside the likeliest bodies for this reading, by so many effective samples a torque.

        With ``zeros``, standard deviations of what the joints' zeros are off ``(n_joints,)`` [rad], these are free,
        too, to first order: the last of what has moved.
        """
        told = pickle.dumps((reading, counts, zeros))
        return self.keep_made("judgements", told, lambda: self._judge(reading, counts, zeros))

    def _judge(self, reading: Reading, counts: Array | None, zeros: Array | None) -> Judgement:
        some = slice(None, None, max(1, int(len(self.q) / THRESHOLD.judged_samples)))
        tree, (model, drive, _) = self.under(reading.gravity), self.predicted(reading)
        torque = self.measured_torque(reading)[some]
        scale = np.maximum(torque.std(axis=0), 1e-12)
        q, v, a = (values[some] for values in self.motion(reading))
        body = joint_torque_regressor(tree, q, v, a)[:, self.places[self.measured]]
        body /= scale[:, None]
        own = np.stack([np.ones_like(torque), *drive[:, some]], axis=2)
        # Offset, friction and rotor in units of the torque's own deviation and the motion's are as good as free.
        unit = THRESHOLD.free_drive / np.maximum(np.sqrt((own**2).mean(axis=0)), 1e-12)
        own *= unit
        target, spread = (torque - model[some]) / scale, likely_spread(tree)
        if zeros is not None:
            # Nominal torques per radian of each joint's zero.
            moved = (
                [self.predicted(reading.with_position(j, zero=step)).torque for j in range(len(zeros))]
                for step in (0.01, -0.01)
            )
            ahead, behind = (np.stack(torques, axis=2)[some] for torques in moved)
            felt = (ahead - behind) / (0.02 * scale[:, None])
            body, spread = np.concatenate([body, felt], axis=2), np.r_[spread, zeros]
        trial, precise = self.first[some], zeros is not None
        judged = judge_bodies(spread, body, own, target, trial, counts, of_drives=True, precise=precise)
        return replace(judged, drives=judged.drives * unit * scale[:, None])

    def across(self, reading: Reading) -> Array:
        """The same of every torque column taken for every joint's, ``(n_joints, n_columns)``, the better sign."""
        torque, columns = self.measured_torque(reading), self.predicted(reading).columns
        every = np.broadcast_to(torque.T[:, :, None], (torque.shape[1], *torque.shape))
        return half_log(np.minimum(*(shares_left(columns.sums_with(one)) for one in (every, -every)))).T

    def gains(self, reading: Reading) -> Gains:
        """Measured torques beside the modelled ones, both without what each joint's own drive explains."""
        sums = self.product_sums(reading)
        fit, power = fit_parts(sums), np.maximum(sums[:, 4, 4], 1e-300)
        explained, own = fit.bare[:, 1] - fit.left, np.maximum(fit.bare[:, 1], 1e-300)
        return Gains(fit.parts[:, 0], explained / power, explained / own, half_log(fit.left / power))

    def unexplained(self, reading: Reading, carried: Array | float = 0.0) -> float:
        """Share of torques' power beside drives that nominal bodies and a load, ``(n, n_torques)``, leave or add."""
        torque, (model, drive, _) = self.measured_torque(reading), self.predicted(reading)
        rest, _ = remove_drives(Columns.of(drive, torque).sums_with(torque - model - carried))
        return float(rest[:, 1, 1].sum() / max(rest[:, 0, 0].sum(), 1e-300))

    def unexplained_beside(self, reading: Reading, left: Array) -> float:
        """The same where other bodies leave so much of each torque, half its logarithm ``(n_torques,)``."""
        sums = self.product_sums(reading)
        return float(np.exp(2.0 * left) @ sums[:, 4, 4] / max(fit_parts(sums).bare[:, 1].sum(), 1e-300))

    def thin_out(self, readings: int) -> TorqueSamples:
        """The same with less samples where this many readings are to be compared; an arm's keep all."""
        most = int(len(self.q) / THRESHOLD.fewest_samples)
        step = max(1, min(int(readings / THRESHOLD.compared_readings), most))
        return self if step == 1 else self.choose(slice(None, None, step))

    def needs_unlikely_bodies(self, reading: Reading) -> bool:
        """Whether what explains the torques are bodies as far from the model's as chance seldom makes them.

        Twice the cost of likely bodies is distributed as chi square, of as many degrees as the torques determine.
        """
        held = np.full(len(self.joints), 1e-9)
        judged, spread = self.judged(reading, zeros=held), likely_spread(self.under(reading.gravity))
        told = len(spread) + len(held) - float(((judged.std / np.r_[spread, held]) ** 2).sum())
        explained = self.unexplained_beside(reading, judged.left) < THRESHOLD.in_place
        return bool(explained and 2.0 * judged.cost > chdtri(max(told, 1.0), 1.0 / THRESHOLD.strong_odds))

    def zeros_are_usual(self, reading: Reading) -> bool:
        """Whether zeros that may be off by what calibrations leave explain torques no better than none are off."""
        usual = np.where(self.sliding, 1e-9, 0.5 * THRESHOLD.least_zero_rad)
        judged, held = self.judged(reading), self.judged(reading, zeros=usual)
        off = np.abs(held.moved[-len(usual) :]) > THRESHOLD.least_zero_rad
        return not off.any() or judged.odds(held) <= STRONG_ODDS + float(np.log(len(usual)))

    def choose(self, some: slice | Flags) -> TorqueSamples:
        """Some of the samples."""
        fields = ("q", "v", "a", "rows", "first", "last")
        return replace(self, **{name: getattr(self, name)[some] for name in fields})

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
    lost = [trial.beyond.any(axis=1).sum() for trial in trials if trial.beyond is not None]
    n = sum(len(trial.time) for trial in trials)
    # Some torques are beyond their range, and enough rows are left in which none is.
    share = bool(lost) and n - sum(lost) >= THRESHOLD.rows_within * n

    def read(trial: Trial) -> TrialValues:
        k = trial_kinematics(robot, log.header, trial, settings, filters)
        torque = forces_on_grid(trial.time, source.torque(trial), k.time)
        looked_at = k.in_motion
        if share and trial.beyond is not None:
            # All torques are within their ranges and so is what their filter sees.
            beyond = np.asarray(flags_at(trial.time, trial.beyond, k.time).any(axis=1))
            looked_at = looked_at & ~reached_samples(beyond, k.rate_hz, filters.cutoff_hz)
        return TrialValues([k], lowpass(torque, k.rate_hz, filters.cutoff_hz, filters.order), looked_at)

    found = gather_samples(robot, log, trials, read, THRESHOLD.torque_samples)
    if found is None:
        return None
    (motion,), fields = found
    joints = log.header.joints
    measured = np.array([joints.index(name) for name in log.header.torque_joints])
    ends = np.zeros((2, len(measured)))
    for trial in () if share else trials:
        values = trial.tau if trial.tau is not None else trial.current
        if values is not None and trial.beyond is not None:
            at, upper = (
                trial.beyond[:, measured],
                (2.0 * values > values.max(axis=0) + values.min(axis=0))[:, measured],
            )
            ends += [(at & ~upper).sum(axis=0), (at & upper).sum(axis=0)]
    return TorqueSamples(
        **fields,
        **motion._asdict(),
        measured=measured,
        stated_hz=log.header.rate_hz,
        speeds=all(trial.v is not None for trial in log.trials),
        ends=ends / max(n, 1),
    )
