"""Contact wrenches of a log beside what the nominal model needs of them, for any reading of its channels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, Flags, Moved
from excite.doctor.channel_mapping import BasePose, Reading
from excite.doctor.inertial_prior import Judgement, half_log, judge_bodies, likely_spread
from excite.doctor.samples import Samples, TrialValues, gather_samples
from excite.doctor.thresholds import THRESHOLD
from excite.errors import LogError
from excite.logs.columns import WRENCH_AXES
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import base_link_regressor, forward_kinematics, inverse_dynamics
from excite.regressor.tree import KinematicTree, read_tree
from excite.robot.robot import Robot
from excite.rows.kinematics import forces_on_grid, trial_kinematics
from excite.rows.settings import ProblemSettings


@dataclass(frozen=True, eq=False, kw_only=True)
class WrenchSamples(Samples):
    """Contact wrenches: ``logged (n_all, n_sensors, 6)`` [N, N·m].

    Attributes:
        motions: by the way in which the base pose is read, ``q (n, nq)``, ``v``, ``a (n, nv)``, filtered.
    """

    what: ClassVar[str] = "wrenches"

    motions: dict[BasePose, Moved]

    @property
    def channels(self) -> tuple[str, ...]:
        """Components of the wrench on the base."""
        return WRENCH_AXES

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the contact sensors."""
        return tuple(sensor.name for sensor in self.robot.sensors)

    def tells(self, reading: Reading) -> Flags:
        """All channels are made by bodies, ``(6,)``."""
        return np.ones(6, dtype=np.bool_)

    def motion(self, reading: Reading) -> Moved:
        """``q``, ``v``, ``a`` as the reading has them."""
        q, v, a = self.read_motion(self.motions[reading.pose], reading)
        others = np.ones(v.shape[1])
        others[self.places] = reading.tick
        # The base is as much slower as its joints.
        return Moved(q, v * others / reading.tick, a * (others / reading.tick) ** 2)

    def measured(self, reading: Reading) -> Array:
        """Wrench on the base that the sensors say, ``(n, 6)`` in the base frame."""
        logged = self.logged_late(reading)[:, reading.sensor_of]
        made = np.einsum("sij,nsj->nsi", reading.wrench_map, logged) + reading.wrench_added
        return np.einsum("nsij,nsj->ni", self._levers(reading), made)

    def left(self, reading: Reading) -> Array:
        """Half the logarithm of what the nominal bodies leave of each channel's power, ``(6,)``."""
        return half_log((self._rest(reading) ** 2).mean(axis=0))

    def mixed(
        self, readings: Sequence[Reading], weights: Callable[[Array], Array]
    ) -> Callable[[Array], Array]:
        """See :meth:`Samples.mixed`."""
        parts = np.stack([self._rest(reading) for reading in readings]).transpose(2, 0, 1)
        products = parts @ parts.transpose(0, 2, 1) / parts.shape[2]

        def left(values: Array) -> Array:
            mixture = weights(values)
            return half_log(((mixture @ products) * mixture).sum(axis=2).T)

        return left

    def _rest(self, reading: Reading) -> Array:
        """What sensors say less what the nominal bodies need, in units of the scale, ``(n, 6)``."""
        needed = self.keep_made(
            "wrenches",
            reading.motion_key(),
            lambda: inverse_dynamics(self._tree(reading), *self.motion(reading))[:, :6],
        )
        return np.asarray((self.measured(reading) - needed) / self._scale)

    def judged(self, reading: Reading, counts: Array | None = None) -> Judgement:
        """The same beside the likeliest bodies, biases of sensors and tilt, by so many effective samples."""
        tree = self._tree(reading)
        q, v, a = self.motion(reading)
        body = base_link_regressor(tree, q, v, a) / self._scale[:, None]
        body[:, :, [10 * segment + i for segment in self._unmeasured for i in range(10)]] = 0.0
        target = self.measured(reading) / self._scale - body @ tree.phi
        still, tilt = np.zeros_like(v), THRESHOLD.tilt_rad
        leaning = [replace(tree, gravity=np.cross(tilt * axis, tree.gravity)) for axis in np.eye(3)]
        tilts = np.stack([inverse_dynamics(one, q, still, still)[:, :6] for one in leaning], axis=2)
        others = np.concatenate([self._biases(reading), tilts / self._scale[:, None]], axis=2)
        return judge_bodies(likely_spread(tree), body, others, target, self.first, counts, of_drives=False)

    def weight_ratio(self, reading: Reading) -> float:
        """Measured force along the nominal weight per that weight, over all samples.

        Accelerations average out over a motion, and their noise would make the ratio smaller.
        """
        q, v, _ = self.motion(reading)
        still = np.zeros_like(v)
        weight = inverse_dynamics(self._tree(reading), q, still, still)[:, :3]
        force = self.measured(reading)[:, :3]
        return float((force * weight).sum() / max(float((weight**2).sum()), 1e-300))

    def best_constants(self, reading: Reading) -> Array:
        """What is to be added to each sensor for the nominal bodies to be carried, the smallest, ``(n_sensors, 6)``."""
        lifts = self._biases(reading)
        missing = -self._rest(reading)
        found = np.linalg.lstsq(lifts.reshape(-1, lifts.shape[2]), missing.ravel(), rcond=1e-6)[0]
        return np.asarray(found.reshape(-1, 6) * self._bias)

    @property
    def _weight(self) -> float:
        """Of what the sensors carry, by the nominal model [N]."""
        return float(self._nominal.phi[::10].sum() * np.linalg.norm(self.robot.model.gravity.linear))

    @cached_property
    def _scale(self) -> Array:
        """What a channel's residual is measured by, ``(6,)`` [N, N·m]: sensors are off by a part of the weight."""
        told = THRESHOLD.told_weight / np.sqrt(THRESHOLD.least_share) * self._weight
        return np.asarray(told * np.repeat([1.0, THRESHOLD.told_lever_m], 3))

    @property
    def _bias(self) -> Array:
        """Standard deviations of a sensor's bias, ``(6,)`` [N, N·m]."""
        return np.asarray(THRESHOLD.bias_weight * self._weight * np.repeat([1.0, THRESHOLD.bias_lever_m], 3))

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

    def _biases(self, reading: Reading) -> Array:
        """Wrenches on the base per standard deviation of each sensor's bias, scaled, ``(n, 6, 6·n_sensors)``."""
        lifts = self._levers(reading) * self._bias / self._scale[:, None]
        return np.concatenate(list(lifts.transpose(1, 0, 2, 3)), axis=2)

    @cached_property
    def _carrying(self) -> NDArray[np.intp]:
        """The log's joints that move a sensor."""
        model = self.robot.model
        supports = {int(joint) for sensor in self.robot.sensors for joint in model.supports[sensor.joint]}
        owners = np.searchsorted(model.idx_vs, self.places, side="right") - 1
        return np.flatnonzero(np.isin(owners, list(supports)))

    def _levers(self, reading: Reading) -> Array:
        """What turns each sensor's wrench into that on the base, ``(n, n_sensors, 6, 6)`` in the base frame.

        One motion is asked for again and again while wrenches are read otherwise: those of readings that place the
        sensors alike are kept, whatever gravity, the clock, and joints elsewhere are.
        """
        some = self._carrying
        alike = {name: getattr(reading, name)[some] for name in ("position_of", "position_sign", "zero")}
        key = replace(reading, **alike, tick=1.0, gravity=np.zeros(3)).motion_key()
        return self.keep_made("levers", key, lambda: self._place_sensors(self.motion(reading).q))

    def _place_sensors(self, q: Array) -> Array:
        poses = forward_kinematics(self._nominal, q)
        back = poses.rotation[:, 1].transpose(0, 2, 1)
        found = np.zeros((len(q), len(self.robot.sensors), 6, 6))
        for s, sensor in enumerate(self.robot.sensors):
            turn = back @ poses.rotation[:, sensor.joint] @ sensor.placement.rotation
            away = poses.point(sensor.joint, sensor.placement.translation) - poses.translation[:, 1]
            lever = np.einsum("nij,nj->ni", back, away)
            found[:, s, :3, :3] = found[:, s, 3:, 3:] = turn
            # As np.cross, which takes as long as all the rest, some hundred times a log.
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                found[:, s, 3 + i, :3] = lever[:, j, None] * turn[:, k] - lever[:, k, None] * turn[:, j]
        return found


def wrench_samples(robot: Robot, log: Log) -> WrenchSamples | None:
    """Samples of the trials to learn from, thinned out; None where no trial can be used."""
    robot = robot_in_log(robot, log.header, log.folder)
    settings = ProblemSettings()
    filters = settings.filters(floating=True, lowpass_hz=log.header.lowpass_hz)
    names = [sensor.name for sensor in robot.sensors]

    def read(trial: Trial) -> TrialValues:
        if trial.base is None or any(name not in trial.wrenches for name in names):
            raise LogError("lacks the base's pose or wrenches")
        ways = [replace(trial, base=pose.read(trial.base)) for pose in BasePose]
        k, *others = (trial_kinematics(robot, log.header, one, settings, filters) for one in ways)
        readings = (forces_on_grid(trial.time, trial.wrenches[name], k.time) for name in names)
        smooth = [lowpass(values, k.rate_hz, filters.kinematics_cutoff_hz) for values in readings]
        return TrialValues([k, *others], np.stack(smooth, axis=1), k.valid)

    found = gather_samples(robot, log, log.role("identification"), read, THRESHOLD.wrench_samples)
    if found is None:
        return None
    motions, fields = found
    return WrenchSamples(**fields, motions=dict(zip(BasePose, motions, strict=True)))
