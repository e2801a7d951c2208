"""Contact wrenches of a log beside what the nominal model needs of them, for any reading of its channels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, Moved
from excite.doctor.channel_mapping import BasePose, Reading
from excite.doctor.inertial_prior import FLOOR, Judgement, LikelyBodies, half_log
from excite.doctor.perturbed_residuals import TURNS, affine, mixed_power, turned
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import base_link_regressor, forward_kinematics, inverse_dynamics
from excite.regressor.tree import KinematicTree, read_tree
from excite.robot.prismatic import is_prismatic
from excite.robot.robot import Robot
from excite.rows.kinematics import TrialKinematics, forces_on_grid, trial_kinematics
from excite.rows.settings import ProblemSettings

# Samples that readings are judged on.
_SAMPLES = 150
# Less than this share of the weight, and of its moment over half a metre, is no better explained: sensors are off by
# as much.
_TOLD, _LEVER_M = 0.01, 0.5
# Biases of contact sensors as share of the weight, and of its moment over a decimetre; tilt of the base [rad].
_BIAS, _ARM_M, _TILT = 0.05, 0.1, 0.05
_AXES = ("fx", "fy", "fz", "tx", "ty", "tz")


@dataclass(frozen=True, eq=False)
class WrenchSamples:
    """Samples of a log's trials, channels as they stand in it.

    Attributes:
        robot: the robot in the log, with its sensors.
        joints: the log's joints; ``places`` their indices into ``v``.
        motions: by the way in which the base pose is read, ``q (n, nq)``, ``v``, ``a (n, nv)``, filtered.
        wrenches: ``(n_all, n_sensors, 6)`` filtered as the positions, every sample of the trials [N, N·m].
        rows: ``(n,)`` where in ``wrenches`` the samples are; ``first``, ``last`` the ends of their trials there.
        rate_hz: of ``wrenches``.
        scale: ``(6,)`` what a channel's residual is measured by [N, N·m].
    """

    robot: Robot
    joints: tuple[str, ...]
    places: NDArray[np.int64]
    motions: dict[BasePose, tuple[Array, Array, Array]]
    wrenches: Array
    rows: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    rate_hz: float
    scale: Array
    _models: dict[bytes, Array] = field(default_factory=dict, repr=False)

    @property
    def measured_name(self) -> str:
        """Wrenches."""
        return "wrenches"

    @property
    def channels(self) -> tuple[str, ...]:
        """Components of the wrench on the base."""
        return _AXES

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the contact sensors."""
        return tuple(sensor.name for sensor in self.robot.sensors)

    def slides(self, joint: int) -> bool:
        """Whether a joint slides."""
        return is_prismatic(self.robot.model, int(self.places[joint]))

    def tells(self, reading: Reading) -> NDArray[np.bool_]:
        """All channels are made by bodies, ``(6,)``."""
        return np.ones(6, dtype=np.bool_)

    def motion(self, reading: Reading) -> Moved:
        """``q``, ``v``, ``a`` as the reading has them."""
        q, v, a = (values.copy() for values in self.motions[reading.pose])
        shift = q.shape[1] - v.shape[1]
        factor = reading.position_sign * reading.unit
        for values, offset in ((q, shift), (v, 0), (a, 0)):
            values[:, self.places + offset] = values[:, self.places[reading.position_of] + offset] * factor
        q[:, self.places + shift] += reading.zero
        return Moved(q, v / reading.tick, a / reading.tick**2)

    def measured(self, reading: Reading, q: Array) -> Array:
        """Wrench on the base that the sensors say, ``(n, 6)`` in the base frame, at configurations ``(n, nq)``."""
        at = np.clip(self.rows + reading.late_s / reading.tick * self.rate_hz, self.first, self.last - 1e-9)
        below = at.astype(np.int64)
        share = (at - below)[:, None, None]
        logged = (1.0 - share) * self.wrenches[below] + share * self.wrenches[below + 1]
        made = (
            np.einsum("sij,nsj->nsi", reading.wrench_map, logged[:, reading.sensor_of]) + reading.wrench_added
        )
        return np.einsum("nsij,nsj->ni", self._levers.at(reading, q), made)

    def left(self, reading: Reading) -> Array:
        """Half the logarithm of what the nominal bodies leave of each channel's power, ``(6,)``."""
        return half_log((self._rest(reading) ** 2).mean(axis=0))

    def by_zero(self, reading: Reading, joint: int) -> Callable[[Array], Array]:
        """What is left, as a function of angles added to a joint's zero ``(k,)`` [rad]: ``(k, 6)``."""
        rests = [self._rest(reading.with_position(joint, zero=angle)) for angle in TURNS]
        return mixed_power(rests, turned)

    def by_gravity(self, reading: Reading) -> Callable[[Array], Array]:
        """What is left, as a function of gravities ``(k, 3)`` [m/s²]: ``(k, 6)``."""
        pulls = np.vstack([np.zeros(3), np.eye(3)])
        still, *pulled = (self._rest(replace(reading, gravity=pull)) for pull in pulls)
        return mixed_power([still, *(rest - still for rest in pulled)], affine)

    def _rest(self, reading: Reading) -> Array:
        """What sensors say less what the nominal bodies need, in units of the scale, ``(n, 6)``."""
        key = reading.motion_key()
        q, v, a = self.motion(reading)
        if key not in self._models:
            self._models[key] = inverse_dynamics(self._tree(reading), q, v, a)[:, :6]
        return np.asarray((self.measured(reading, q) - self._models[key]) / self.scale)

    def judged(self, reading: Reading, counts: Array | None = None) -> Judgement:
        """The same beside the likeliest bodies, biases of sensors and tilt, by so many effective samples."""
        tree = self._tree(reading)
        q, v, a = self.motion(reading)
        body = base_link_regressor(tree, q, v, a) / self.scale[:, None]
        body[:, :, [10 * segment + i for segment in self._unmeasured for i in range(10)]] = 0.0
        target = self.measured(reading, q) / self.scale - body @ tree.phi
        others = np.concatenate([self._biases(reading, q), self._tilts(tree, q)], axis=2)
        return LikelyBodies.of(tree).left_of_wrench(
            body, others / self.scale[:, None], target, self.first, counts
        )

    def weight_ratio(self, reading: Reading) -> float:
        """Measured force along the nominal weight per that weight, over all samples.

        Accelerations average out over a motion, and their noise would make the ratio smaller.
        """
        q, v, _ = self.motion(reading)
        still = np.zeros_like(v)
        weight = inverse_dynamics(self._tree(reading), q, still, still)[:, :3]
        force = self.measured(reading, q)[:, :3]
        return float((force * weight).sum() / max(float((weight**2).sum()), 1e-300))

    def best_constants(self, reading: Reading) -> Array:
        """What is to be added to each sensor for the nominal bodies to be carried, the smallest, ``(n_sensors, 6)``."""
        lifts = self._biases(reading, self.motion(reading).q) / self.scale[:, None]
        missing = -self._rest(reading)
        found = np.linalg.lstsq(lifts.reshape(-1, lifts.shape[2]), missing.ravel(), rcond=1e-6)[0]
        return np.asarray(found.reshape(-1, 6) * self._bias)

    @property
    def _bias(self) -> Array:
        """Standard deviations of a sensor's bias, ``(6,)`` [N, N·m]."""
        return _BIAS * self.weight * np.array([1.0] * 3 + [_ARM_M] * 3)

    @property
    def weight(self) -> float:
        """Of what the sensors carry, by the nominal model [N]."""
        return float(self._nominal.phi[::10].sum() * np.linalg.norm(self.robot.model.gravity.linear))

    @cached_property
    def _levers(self) -> Levers:
        return Levers(self.robot, self.places, self._nominal)

    @cached_property
    def _nominal(self) -> KinematicTree:
        """The robot without bodies beyond the sensors."""
        tree = read_tree(self.robot.model)
        phi = tree.phi.reshape(-1, 10).copy()
        phi[list(self._unmeasured)] = 0.0
        return replace(tree, phi=phi.ravel())

    @property
    def _unmeasured(self) -> tuple[int, ...]:
        return tuple(sorted({segment for sensor in self.robot.sensors for segment in sensor.excludes}))

    def _tree(self, reading: Reading) -> KinematicTree:
        """What the sensors carry, under the reading's gravity."""
        return replace(self._nominal, gravity=np.asarray(reading.gravity, dtype=float))

    def _biases(self, reading: Reading, q: Array) -> Array:
        """Wrenches on the base per standard deviation of each sensor's bias, ``(n, 6, 6·n_sensors)``."""
        lifts = self._levers.at(reading, q) * self._bias
        return np.concatenate(list(lifts.transpose(1, 0, 2, 3)), axis=2)

    def _tilts(self, tree: KinematicTree, q: Array) -> Array:
        """Likewise of a tilt about each axis of the world, ``(n, 6, 3)``."""
        still = np.zeros((len(q), tree.nv))
        leaning = [np.cross(_TILT * axis, tree.gravity) for axis in np.eye(3)]
        made = [inverse_dynamics(replace(tree, gravity=g), q, still, still)[:, :6] for g in leaning]
        return np.stack(made, axis=2)


def wrench_samples(robot: Robot, log: Log) -> WrenchSamples | None:
    """Samples of the trials to learn from, thinned out; None where no trial can be used."""
    robot = robot_in_log(robot, log.header, log.folder)
    parts = [
        part for trial in log.role("identification") if (part := _build_part(robot, log, trial)) is not None
    ]
    if not parts or not sum(len(part.rows) for part in parts):
        return None
    starts = np.cumsum([0, *(len(part.wrenches) for part in parts)])
    rows = np.concatenate([part.rows + start for part, start in zip(parts, starts[:-1], strict=True)])
    first = np.concatenate([np.full(len(p.rows), s) for p, s in zip(parts, starts[:-1], strict=True)])
    last = np.concatenate([np.full(len(p.rows), s - 1) for p, s in zip(parts, starts[1:], strict=True)])
    some = slice(None, None, max(1, len(rows) // _SAMPLES))
    motions = {}
    for pose in BasePose:
        stacked = [
            np.concatenate([getattr(p.motions[pose], n)[p.rows] for p in parts]) for n in ("q", "v", "a")
        ]
        motions[pose] = (stacked[0][some], stacked[1][some], stacked[2][some])
    found = WrenchSamples(
        robot,
        log.header.joints,
        np.array([robot.n_base_v + robot.joint_index(name) for name in log.header.joints]),
        motions,
        np.concatenate([part.wrenches for part in parts]),
        rows[some],
        first[some],
        last[some],
        parts[0].rate_hz,
        np.ones(6),
    )
    return replace(found, scale=_TOLD / np.sqrt(FLOOR) * found.weight * np.array([1.0] * 3 + [_LEVER_M] * 3))


@dataclass(frozen=True, eq=False)
class _Part:
    """One trial: motions by the way the base pose is read, wrenches at full rate, usable rows."""

    motions: dict[BasePose, TrialKinematics]
    wrenches: Array
    rows: NDArray[np.int64]
    rate_hz: float


def _build_part(robot: Robot, log: Log, trial: Trial) -> _Part | None:
    """A trial; None where it lacks something or is too short."""
    names = [sensor.name for sensor in robot.sensors]
    if trial.base is None or any(name not in trial.wrenches for name in names):
        return None
    settings = ProblemSettings()
    filters = settings.filters(floating=True, lowpass_hz=log.header.lowpass_hz)
    try:
        motions = {
            pose: trial_kinematics(
                robot, log.header, replace(trial, base=pose.read(trial.base)), settings, filters
            )
            for pose in BasePose
        }
        k = motions[BasePose.STATED]
        readings = [forces_on_grid(trial.time, trial.wrenches[name], k.time) for name in names]
        smooth = [lowpass(values, k.rate_hz, filters.kinematics_cutoff_hz) for values in readings]
    except LogError:
        return None
    return _Part(motions, np.stack(smooth, axis=1), np.flatnonzero(k.valid), k.rate_hz)


# Where contact sensors are beside the base: what makes wrenches on the base of theirs, for any reading of a
# log.

# Readings whose levers are kept.
_KEPT = 64


class Levers:
    """Levers of a robot's contact sensors along the motions that a log may be of."""

    def __init__(self, robot: Robot, places: NDArray[np.int64], tree: KinematicTree):
        """Of the log's joints, whose indices into ``v`` are ``places``."""
        self._robot, self._tree = robot, tree
        supports = {int(joint) for sensor in robot.sensors for joint in robot.model.supports[sensor.joint]}
        owners = np.searchsorted(robot.model.idx_vs, places, side="right") - 1
        self._carrying = np.flatnonzero([int(owner) in supports for owner in owners])
        self._known: dict[bytes, Array] = {}

    def at(self, reading: Reading, q: Array) -> Array:
        """What turns each sensor's wrench into that on the base, at configurations ``(n, nq)`` of the reading.

        Returns:
            ``(n, n_sensors, 6, 6)`` in the base frame.
        """
        key = self._key(reading)
        if key not in self._known:
            # One motion is asked for again and again while wrenches are read otherwise; others once or twice.
            if len(self._known) >= _KEPT:
                self._known.clear()
            self._known[key] = self._made(q)
        return self._known[key]

    def _key(self, reading: Reading) -> bytes:
        """Equal for readings that place the sensors alike: joints elsewhere, gravity and the clock do not."""
        carrying = self._carrying
        still = replace(
            reading,
            position_of=reading.position_of[carrying],
            position_sign=reading.position_sign[carrying],
            zero=reading.zero[carrying],
            tick=1.0,
            gravity=np.zeros(3),
        )
        return still.motion_key()

    def _made(self, q: Array) -> Array:
        sensors = self._robot.sensors
        poses = forward_kinematics(self._tree, q)
        back = poses.rotation[:, 1].transpose(0, 2, 1)
        found = np.zeros((len(q), len(sensors), 6, 6))
        for s, sensor in enumerate(sensors):
            turn = back @ poses.rotation[:, sensor.joint] @ sensor.placement.rotation
            away = poses.point(sensor.joint, sensor.placement.translation) - poses.translation[:, 1]
            lever = np.einsum("nij,nj->ni", back, away)
            found[:, s, :3, :3] = found[:, s, 3:, 3:] = turn
            # As np.cross, which takes as long as all the rest, some hundred times a log.
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                found[:, s, 3 + i, :3] = lever[:, j, None] * turn[:, k] - lever[:, k, None] * turn[:, j]
        return found
