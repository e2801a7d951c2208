"""Uniform scaling of the time law: the closed form that keeps every limit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from excite.arrays import Array
from excite.motion.motion import jerk_peaks
from excite.safety.repairs.draft import Draft, Rejection, Repair
from excite.safety.repairs.path import MotionPath, PathSample, TimeLaw, run_path
from excite.safety.repairs.rows import PathLimits

# Speed factors that are worth it: below the first the motion would hardly excite anything.
_SLOWEST, _FASTEST = 0.3, 1.6
_PHASE_SLACK = 1.25
SPEED_SHARE = "of its speed"
# How rates grow with the speed.
_POWERS = {"velocity": 1, "acceleration": 2, "jerk": 3}
# Samples per sample of the robot at which the limits are evaluated.
_FINER, _HIGHEST_RATE_HZ = 2, 400.0
# Samples whose rows are looked at together: a megabyte of them stays in the processor's cache.
_BLOCK = 256
# Times at most that a motion is slowed down until the jerk between its samples fits.
_ROUNDS = 8
# Shares of a limit that rounding leaves where motion uses none of it.
_STILL = 1e-12


@dataclass(frozen=True)
class Scaling:
    """The largest uniform speed factor, and what stops it from being larger.

    Attributes:
        factor: ``k``; 0 where even standing still on the path breaks a limit.
        reason: what limits it.
        where: joint or feet.
        time: time in the unscaled law at which it does [s].
    """

    factor: float
    reason: str
    where: str
    time: float


class _Excess(NamedTuple):
    """What is exceeded: value, limit, and their unit where that is not the limit's own."""

    value: float
    limit: float
    unit: str | None


class TimeScaling(Repair):
    """Runs the whole motion slower (or faster) by one factor, so that ZMP, friction and all limits hold.

    With ``k`` times the speed dynamic terms grow with ``k²`` and static ones stay, so each row at each sample
    gives one bound ``k² ≤ −static/dynamic``; velocities give ``k``, jerks ``k³``.
    """

    name: ClassVar[str] = "time_scaling"

    def repair(self, draft: Draft) -> Draft | Rejection:
        """A draft whose law keeps the limits and takes a whole number of samples; or the limiting reason."""
        if draft.limits is None or draft.law is None:
            return draft.rejected("no_time_law", "path")
        rate = self.robot.description.sensors.rate_hz
        scaling = largest_factor(draft.limits, draft.law, min(_FINER * rate, _HIGHEST_RATE_HZ))
        if scaling.factor < _SLOWEST:
            return draft.rejected(scaling.reason, scaling.where, scaling.time, *self._excess(scaling))
        fastest = 1.0 if draft.candidate.speed is not None else _FASTEST
        samples = int(np.ceil(draft.law.duration / min(scaling.factor, fastest) * rate))
        for _ in range(_ROUNDS):
            law = draft.law.faster(draft.law.duration * rate / samples)
            share = self._jerk_share(draft.limits.path, law, rate)
            if share <= 1.0:
                break
            samples = max(samples + 1, int(np.ceil(samples * share ** (1.0 / 3.0))))
        return replace(draft, law=law)

    def _jerk_share(self, path: MotionPath, law: TimeLaw, rate: float) -> float:
        """Largest jerk between the samples that will be written, of what may be used: kinks of the path or the law
        fall between them as it happens, whatever the law's own jerk is.
        """
        moved, n = run_path(path, law, rate), self.robot.n_base_v
        peaks = jerk_peaks(moved.time, moved.q[:, self.robot.n_base_q :], moved.v[:, n:], moved.a[:, n:])
        return float((peaks / (self.shares.jerk * self.robot.limits.jerk)).max())

    def _excess(self, scaling: Scaling) -> _Excess:
        """What is exceeded at the slowest speed that is worth it.

        Limits that hold of rates alone are compared with those; for all others the value is the speed at which they
        hold, as a share of the speed asked for.
        """
        kind = scaling.reason.removeprefix("joint_")
        if kind not in _POWERS or scaling.factor <= 0.0:
            return _Excess(scaling.factor, _SLOWEST, SPEED_SHARE)
        joint = self.robot.joint_names.index(scaling.where)
        limit = float(getattr(self.shares, kind) * getattr(self.robot.limits, kind)[joint])
        return _Excess(limit * (_SLOWEST / scaling.factor) ** _POWERS[kind], limit, None)


def largest_factor(limits: PathLimits, law: TimeLaw, rate_hz: float) -> Scaling:
    """The largest factor by which a law may be sped up, from samples at ``rate_hz``."""
    n = int(np.ceil(law.duration * rate_hz)) + 1
    time = np.linspace(0.0, law.duration, n)
    s, speed, acceleration = (law.evaluate(time, order) for order in range(3))
    sample = limits.path.sample(s)
    found = []
    for start in range(0, n, _BLOCK):
        part = slice(start, start + _BLOCK)
        found.append(_row_bound(limits, sample.part(part), time[part], speed[part], acceleration[part]))
    found += _rate_bounds(limits, sample, time, speed, acceleration)
    return min(found, key=lambda scaling: scaling.factor)


def _row_bound(
    limits: PathLimits, sample: PathSample, time: Array, speed: Array, acceleration: Array
) -> Scaling:
    """The bound from the rows at some samples."""
    found = []
    kinds = [(limits.joint_shares(sample), True), (limits.contact_rows(sample), False)]
    of_set = limits.rows_of_set(sample)
    if of_set:
        forward, backward = of_set
        driven = np.where(acceleration[:, None] < 0.0, backward.driven, forward.driven)
        kinds.append((replace(forward, driven=driven), False))
    with np.errstate(divide="ignore", invalid="ignore"):
        for rows, either_way in kinds:
            dynamic = rows.curved * speed[:, None] ** 2 + rows.driven * acceleration[:, None]
            # What is left of the limit while the robot stands, in the direction in which motion uses it.
            left = 1.0 - rows.static * np.sign(dynamic) if either_way else -rows.static
            used = np.abs(dynamic) if either_way else dynamic
            square = np.where(used > _STILL, left / used, np.inf)
            square[np.abs(rows.static) > 1.0 if either_way else rows.static > 0.0] = 0.0
            if square.size:
                worst = np.unravel_index(int(np.argmin(square)), square.shape)
                reason, where = rows.labels[worst[1]]
                found.append(Scaling(float(np.sqrt(square[worst])), reason, where, float(time[worst[0]])))
    return min(found, key=lambda scaling: scaling.factor)


def _rate_bounds(
    limits: PathLimits, sample: PathSample, time: Array, speed: Array, acceleration: Array
) -> list[Scaling]:
    """Bounds from velocity and jerk of the joints."""
    robot, shares = limits.path.robot, limits.shares
    n_base = robot.n_base_v
    velocity = np.abs(sample.twist[:, n_base:] * speed[:, None])
    a = sample.curvature[:, n_base:] * speed[:, None] ** 2 + sample.twist[:, n_base:] * acceleration[:, None]
    jerk = np.abs(np.diff(a, axis=0)) / (time[1] - time[0])
    found = []
    for reason, values, limit, power in (
        ("joint_velocity", velocity, shares.velocity * limits.limits_at("velocity", sample), 1.0),
        ("joint_jerk", jerk, shares.jerk * robot.limits.jerk, 1.0 / 3.0),
    ):
        ratio = values / limit
        row, joint = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
        factor = float(max(ratio[row, joint], 1e-12) ** -power)
        found.append(Scaling(factor, reason, robot.joint_names[joint], float(time[row])))
    # Smoothing carries some of a fast phase's rate into a slow one; that much is meant to be allowed.
    ratio = speed / (_PHASE_SLACK * limits.phase_bound(sample.s))
    at = int(np.argmax(ratio))
    found.append(Scaling(float(1.0 / max(ratio[at], 1e-12)), "phase_rate", "path", float(time[at])))
    return found
