"""Rows of the base-link equation: ``Y1 φ = Σ J1ᵀ f`` of a robot that stands on sensors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.columns import WRENCH_AXES
from excite.logs.log import LogHeader, Trial
from excite.regressor.columns import base_wrench
from excite.regressor.kernels import base_link_regressor, forward_kinematics
from excite.robot.robot import Robot
from excite.rows.kinematics import TrialKinematics, TrialRows, filtered_rows, forces_on_grid, trial_kinematics
from excite.rows.settings import Filters, ProblemSettings


@dataclass(frozen=True, eq=False)
class BaseRows:
    """Builds the six rows a sample of the base link's equation (Jovic et al. 2015, eq. 2).

    Both sides are expressed in the frame of the base, force then moment about its origin.

    Attributes:
        robot: the robot in the log, with the log's sensors.
        header: the log's header.
        settings: how gaps are treated.
        filters: filters.
    """

    robot: Robot
    header: LogHeader
    settings: ProblemSettings
    filters: Filters

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Components of the wrench."""
        return WRENCH_AXES

    @property
    def channel_units(self) -> tuple[str, ...]:
        """Newtons, then newton metres."""
        return ("N",) * 3 + ("N·m",) * 3

    @property
    def drive_names(self) -> tuple[str, ...]:
        """Forces inside the robot do not show at its base."""
        return ()

    @property
    def drive_prior(self) -> Array:
        """Empty, ``(0,)``."""
        return np.zeros(0)

    @property
    def drive_spread(self) -> Array:
        """Empty, ``(0,)``."""
        return np.zeros(0)

    @cached_property
    def unmeasured(self) -> tuple[int, ...]:
        """Segments beyond the ankle sensors, and axes of compound joints, which have no body.

        Raises:
            LogError: a foot stands on a plate and has an ankle sensor: its load would count twice.
        """
        kinds: dict[str, str] = {}
        for sensor in self.robot.sensors:
            if kinds.setdefault(sensor.foot, sensor.kind) != sensor.kind:
                raise LogError(
                    f"foot {sensor.foot!r} has both an ankle sensor and a force plate",
                    field="sensors",
                    remedy="keep one kind in log.yaml",
                )
        beyond = {segment for sensor in self.robot.sensors for segment in sensor.excludes}
        bodiless = np.flatnonzero(~self.robot.nominal_parameters.reshape(-1, 10).any(axis=1))
        return tuple(sorted(beyond | set(bodiless.tolist())))

    @property
    def noise(self) -> Array:
        """Standard deviation of each component at full rate, ``(6,)`` [N, N·m]; 1 where it is not stated.

        Moments about the base carry the sensors' force noise over the lever in the rest posture.
        """
        variance = np.zeros(6)
        poses = forward_kinematics(self.robot.model, self.robot.rest[None])
        for sensor in self.robot.sensors:
            if not (sensor.noise_force > 0.0 and sensor.noise_moment > 0.0):
                return np.ones(6)
            if sensor.kind == "force_plate":
                lever = np.full(3, self.robot.rest[2])
            else:
                lever = poses.point(sensor.joint, sensor.placement.translation)[0] - self.robot.rest[:3]
            variance[:3] += sensor.noise_force**2
            across = lever @ lever - lever**2
            variance[3:] += sensor.noise_moment**2 + sensor.noise_force**2 * across
        return np.sqrt(variance)

    def rows(self, trial: Trial) -> TrialRows:
        """Rows of one trial.

        Raises:
            LogError: the trial lacks a wrench or the base pose, or is too short.
        """
        missing = [sensor.name for sensor in self.robot.sensors if sensor.name not in trial.wrenches]
        if missing or trial.base is None:
            raise LogError(
                "is missing",
                source=trial.name,
                field=f"wrench.{missing[0]}" if missing else "base",
                remedy="log it",
            )
        k = trial_kinematics(self.robot, self.header, trial, self.settings, self.filters)
        measured = self._measured(trial, k)
        unseen = [10 * segment + i for segment in self.unmeasured for i in range(10)]

        def rows_of(part: slice) -> Array:
            body = base_link_regressor(self.robot.model, k.q[part], k.v[part], k.a[part])
            body[:, :, unseen] = 0.0
            return np.concatenate([body, measured[part, :, None]], axis=2)

        return filtered_rows(rows_of, k, self.filters, np.repeat(k.valid[:, None], 6, axis=1))

    def measurement(self, trial: Trial, k: TrialKinematics) -> TrialRows:
        """Only the measured side of :meth:`rows`, ``values`` ``(m, 6, 1)``, for kinematics ``k``."""
        measured = self._measured(trial, k)
        use = np.repeat(k.valid[:, None], 6, axis=1)
        return filtered_rows(lambda part: measured[part, :, None], k, self.filters, use)

    def _measured(self, trial: Trial, k: TrialKinematics) -> Array:
        readings = {
            name: forces_on_grid(trial.time, values, k.time) for name, values in trial.wrenches.items()
        }
        return base_wrench(self.robot, k.q, readings)
