"""The Bayesian linear problem that every hypothesis is judged by."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.spectrum import (
    BAND_HZ,
    Repeatability,
    Whitening,
    in_band,
    make_whitening,
    scaled_to_repeats,
)
from excite.diagnosis.floating.state import State, TorqueState, check_legs, cross_rows, inertial_scales
from excite.regressor.kernels import base_link_regressor
from excite.robot.robot import WrenchSensor

# Power over the expected noise that repeated trials, which set it, leave open.
NOISE_SLACK = 1.5

# What sensors say while their foot is in the air: nothing but their own errors and the foot's weight.
#
# The base's equation holds the sum of all sensors, in which a constant bias of one looks like that of
# another, like a constant force and, in part, like wrong inertials or a tilted base. A foot in the air tells.

_LIFT_M = 0.012
_LARGEST_SHARE, _SHORTEST_S = 0.15, 0.6
# Beyond the sensor's own noise: kinematics, and a foot that is not modelled to the gram.
_FORCE_FLOOR, _MOMENT_FLOOR = 0.15, 0.03


@dataclass(frozen=True, eq=False)
class UnloadedRows:
    """Mean reading of each sensor over the time in each trial in which its foot is in the air.

    Attributes:
        sensors: name of the sensor of each row block.
        masks: ``(n,)`` samples of each block.
        trial: index of the trial of each block.
        std: ``(6,)`` standard deviation of the mean of each block [N, N·m].
        foot: ``(n_blocks, 6, 10·n_segments)`` change of the expected reading per unit of the foot's inertials.
        scales: ``(10·n_segments,)`` what those are expected to be off by; zero for measured segments.
    """

    sensors: tuple[str, ...]
    masks: tuple[NDArray[np.bool_], ...]
    trial: tuple[int, ...]
    std: tuple[Array, ...]
    foot: Array
    scales: Array

    def mean_readings(self, readings: dict[str, Array]) -> Array:
        """``(n_blocks, 6)`` mean readings; the expected ones are subtracted by the caller."""
        pairs = zip(self.sensors, self.masks, strict=True)
        return np.array([readings[name][mask].mean(axis=0) for name, mask in pairs]).reshape(-1, 6)

    def scaled_residual(self, state: State) -> Array:
        """``(6·n_blocks,)`` mean reading less expected, over its standard deviation."""
        off = self.mean_readings(state.readings) - self.foot @ state.phi
        return (off / np.array(self.std).reshape(-1, 6)).ravel()

    def foot_columns(self) -> Array:
        """``(6·n_blocks, k)`` columns of the feet's inertials in units of their scales."""
        used = np.flatnonzero(self.scales)
        columns = self.foot[:, :, used] * self.scales[used]
        return (columns / np.array(self.std).reshape(-1, 6)[:, :, None]).reshape(-1, len(used))


def find_unloaded(record: FloatingRecord, state: State) -> UnloadedRows:
    """Look for feet in the air: the foot has risen, and the sensor carries next to nothing."""
    weight = float(record.tree.phi[::10].sum() * np.linalg.norm(record.tree.gravity))
    up = -record.tree.gravity / np.linalg.norm(record.tree.gravity)
    names, masks, trials, stds, feet = [], [], [], [], []
    scales = np.zeros(len(record.tree.phi))
    for sensor in record.robot.sensors:
        foot = record.robot.foot(sensor.foot).joint
        height = state.poses.translation[:, foot] @ up
        force = np.linalg.norm(record.readings[sensor.name][:, :3], axis=1)
        ground = np.median(height[force > 0.3 * weight]) if (force > 0.3 * weight).any() else height.min()
        for index, span in enumerate(record.spans):
            mask = np.zeros(record.n_samples, dtype=bool)
            mask[span] = (height[span] > ground + _LIFT_M) & (force[span] < _LARGEST_SHARE * weight)
            if mask.sum() < _SHORTEST_S * record.rate_hz:
                continue
            names.append(sensor.name)
            masks.append(mask)
            trials.append(index)
            stds.append(_mean_deviation(record.readings[sensor.name][mask], int(mask.sum()), record.rate_hz))
            feet.append(_foot_reading(record, state, sensor, mask))
        for segment in sensor.excludes:
            part = slice(10 * segment, 10 * segment + 10)
            scales[part] = inertial_scales(record.tree.phi)[part] * (1.0 if record.inertials_free else 0.1)
    shape = (0, 6, len(record.tree.phi))
    return UnloadedRows(
        tuple(names),
        tuple(masks),
        tuple(trials),
        tuple(stds),
        np.array(feet) if feet else np.zeros(shape),
        scales,
    )


def _mean_deviation(readings: Array, n: int, rate_hz: float) -> Array:
    """Of the mean over ``n`` samples: the readings' own spread, about three independent numbers a second."""
    spread = readings.std(axis=0)
    floor = np.array([_FORCE_FLOOR] * 3 + [_MOMENT_FLOOR] * 3)
    return np.hypot(spread / np.sqrt(max(1.0, 3.0 * n / rate_hz)), floor)


def _foot_reading(
    record: FloatingRecord, state: State, sensor: WrenchSensor, mask: NDArray[np.bool_]
) -> Array:
    """``(6, 10·n_segments)`` mean reading per unit of the inertials beyond the sensor, sensor frame.

    The foot pulls at the sensor with minus the wrench that its own motion needs.
    """
    total = np.zeros((6, len(record.tree.phi)))
    if not sensor.excludes:
        return total
    body = base_link_regressor(record.tree, state.q[mask], state.v[mask], state.a[mask])
    rotation = (
        np.einsum("nji,njk->nik", state.poses.rotation[mask, 1], state.poses.rotation[mask, sensor.joint])
        @ sensor.placement.rotation
    )
    point = (
        state.poses.point(sensor.joint, sensor.placement.translation)[mask] - state.poses.translation[mask, 1]
    )
    point = np.einsum("nji,nj->ni", state.poses.rotation[mask, 1], point)
    for segment in sensor.excludes:
        part = slice(10 * segment, 10 * segment + 10)
        force, moment = body[:, :3, part], body[:, 3:, part]
        moment = moment - cross_rows(point, force)
        total[:3, part] = -np.einsum("nji,njk->ik", rotation, force) / mask.sum()
        total[3:, part] = -np.einsum("nji,njk->ik", rotation, moment) / mask.sum()
    return total


@dataclass(frozen=True, eq=False)
class LinearFit:
    """A hypothesis' fit to whitened numbers.

    Attributes:
        theta: parameters, in units of their scales.
        covariance: of the same.
        gain: what it lowers half the sum of squares by, priors included [nats].
        evidence: the same less the price of its parameters: log of the Bayes factor against the baseline.
    """

    theta: Array
    covariance: Array
    gain: float
    evidence: float


@dataclass(frozen=True, eq=False)
class Problem:
    """Whitened residuals of a record with the baseline's freedom taken out.

    Rows: the base's equation in the frequency domain, then mean readings of unloaded sensors. The baseline's
    parameters (inertials where they are identified, those of feet beyond their sensors) have a loose Gaussian
    prior and are integrated out; so the evidence of a hypothesis is that of a linear Gaussian model
    (MacKay 1992, eq. 2.5).

    Attributes:
        record: the record.
        nominal: the logged state.
        whitening: of the base's rows.
        repeatability: what repeated trials say.
        unloaded: unloaded sensors.
        basis: ``(m, r)`` orthonormal basis of what the baseline takes out, scaled by the prior.
        columns: ``(m, p)`` the baseline's columns in units of its scales.
        scales: ``(p,)`` its scales.
        index: ``(p,)`` which inertial parameters they are.
    """

    record: FloatingRecord
    nominal: State
    whitening: Whitening
    repeatability: Repeatability
    unloaded: UnloadedRows
    basis: Array
    columns: Array
    scales: Array
    index: NDArray[np.int64]

    def residual_rows(self, state: State) -> Array:
        """``(m,)`` whitened residual in a state."""
        return np.concatenate([self.whitening(state.residual), self.unloaded.scaled_residual(state)])

    def state_with_errors(self, delta: Array) -> State:
        """The logged state with errors ``delta (10·n_segments,)`` of the inertial parameters.

        What the nominal state has computed and does not depend on them is handed on: the regressor in any case.
        """
        if not delta.any():
            return self.nominal
        _ = self.nominal.regressor
        return self.nominal.with_errors(delta)

    @cached_property
    def error_columns(self) -> Array:
        """``(n, c, p)`` what the baseline's parameters, in units of their scales, make of the samples."""
        free = self.nominal.free_errors()
        columns = np.zeros((*free.columns.shape[:2], len(self.scales)))
        columns[:, :, : len(free.scales)] = free.columns * free.scales
        return columns

    @property
    def n_errors(self) -> int:
        """Number of errors that a state takes: of inertial parameters, of a torque log of drives too."""
        return len(self.record.tree.phi) + self.nominal.n_drive_terms

    @cached_property
    def nominal_rows(self) -> Array:
        """Those of the nominal state."""
        return self.residual_rows(self.nominal)

    @cached_property
    def validation_rows(self) -> NDArray[np.bool_]:
        """``(m,)`` which rows are of validation trials."""
        held_out = np.array(self.record.validation)
        unloaded = np.repeat(held_out[list(self.unloaded.trial)] if self.unloaded.trial else [], 6)
        return np.concatenate([self.whitening.validation_rows(), unloaded.astype(bool)])

    @cached_property
    def identification_only(self) -> Problem:
        """The problem with the validation trials' rows at zero weight; itself where there are no such trials."""
        if not any(self.record.validation) or all(self.record.validation):
            return self
        keep = ~np.array(self.record.validation)
        whitening = replace(
            self.whitening,
            factors=tuple(f * float(k) for f, k in zip(self.whitening.factors, keep, strict=True)),
        )
        unloaded = replace(
            self.unloaded,
            # An infinite standard deviation takes a row out.
            std=tuple(
                std if keep[trial] else np.full(6, np.inf)
                for std, trial in zip(self.unloaded.std, self.unloaded.trial, strict=True)
            ),
        )
        columns = np.where(self.validation_rows[:, None], 0.0, self.columns)
        return replace(
            self, whitening=whitening, unloaded=unloaded, columns=columns, basis=damped_basis(columns)
        )

    def project_rows(self, rows: Array) -> Array:
        """``(r, …)`` components that the baseline takes out."""
        return self.basis.T @ rows

    def baseline_parameters(self, rows: Array) -> Array:
        """Most probable errors of all inertial parameters, ``(10·n_segments,)``, given residual rows."""
        delta = np.zeros(self.n_errors)
        if len(self.index):
            delta[self.index] = self.scales * scipy.linalg.cho_solve(
                self._baseline_factor, self.columns.T @ rows
            )
        return delta

    def baseline_rows(self, delta: Array) -> Array:
        """``(m,)`` what errors ``delta (10·n_segments,)`` of the inertial parameters make of the rows."""
        if not len(self.index):
            return np.zeros(len(self.columns))
        return np.asarray(self.columns @ (delta[self.index] / self.scales))

    @cached_property
    def _baseline_factor(self) -> tuple[Array, bool]:
        """Factor of the baseline's normal equations, prior included."""
        return scipy.linalg.cho_factor(self.columns.T @ self.columns + np.eye(len(self.index)))

    def residual_power(self, rows: Array) -> float:
        """Sum of squares left by the baseline, its prior included."""
        return float(rows @ rows - (self.project_rows(rows) ** 2).sum())

    def fit_columns(self, rows: Array, columns: Array) -> LinearFit:
        """Fit ``columns (m, k)``, in units of their scales, to ``rows (m,)``."""
        part = self.project_rows(columns)
        gram, right = columns.T @ columns - part.T @ part, columns.T @ rows - part.T @ self.project_rows(rows)
        factor = scipy.linalg.cho_factor(np.eye(len(gram)) + gram)
        theta = scipy.linalg.cho_solve(factor, right)
        gain, price = 0.5 * float(right @ theta), float(np.log(np.diag(factor[0])).sum())
        return LinearFit(theta, scipy.linalg.cho_solve(factor, np.eye(len(gram))), gain, gain - price)


def damped_basis(columns: Array) -> Array:
    """Orthonormal basis of ``columns (m, p)`` scaled by what a unit prior on their parameters leaves of each.

    Of the stacked [columns; 1] the upper part of Q, which carries the prior's damping.
    """
    if not columns.size:
        return columns
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u * (s / np.sqrt(1.0 + s**2)))


def record_state(record: FloatingRecord) -> State:
    """The logged state of a record, by what is measured."""
    if record.robot.sensors:
        return State.from_log(record)
    state = TorqueState.from_log(record)
    check_legs(state)
    return state


def build_problem(record: FloatingRecord) -> Problem:
    """Whiten the record's nominal residual and prepare the baseline."""
    nominal = record_state(record)
    whitening, repeatability = scaled_to_repeats(make_whitening(record, nominal), nominal.residual)
    unloaded = find_unloaded(record, nominal)
    n_base, n_unloaded, free = whitening.n_rows, 6 * len(unloaded.sensors), nominal.free_errors()
    made = whitening(free.columns) * free.scales
    blocks, scales, index = (
        [np.vstack([made, np.zeros((n_unloaded, len(free.scales)))])],
        [free.scales],
        [free.at],
    )
    feet = np.flatnonzero(unloaded.scales)
    if len(feet) and n_unloaded:
        blocks.append(np.vstack([np.zeros((n_base, len(feet))), unloaded.foot_columns()]))
        scales.append(unloaded.scales[feet])
        index.append(feet)
    columns = np.hstack(blocks)
    return Problem(
        record,
        nominal,
        whitening,
        repeatability,
        unloaded,
        damped_basis(columns),
        columns,
        np.concatenate(scales),
        np.concatenate(index),
    )


# How loud the noise is in the trials that a gap is judged on.

# Noise has few independent numbers in a band of a few hertz, and trials as short as these.
_LEAST_SPREAD, _LARGEST_SPREAD = 0.12, 0.3
_UPPER_END_HZ = 2.4
_LOUDER_STD, _LOUDER_RANGE = 0.06, (0.7, 1.5)


@dataclass(frozen=True, eq=False)
class NoiseLevel:
    """Noise of the wrench's components below a frequency, in the trials that a gap is judged on.

    Attributes:
        likely: ``(6,)`` standard deviation [N, N·m].
        least: ``(6,)`` the least that it may be.
        spread: how far its power may be from either, relative.
    """

    likely: Array
    least: Array
    spread: float


def noise_level(
    problem: Problem, residual: Array, scale: Array, judged: NDArray[np.bool_], below_hz: float = BAND_HZ
) -> NoiseLevel:
    """Noise as far as the model of it, what a fit leaves of the other trials and repeated trials tell.

    Args:
        residual: ``(n, 6)`` what the fit leaves, in band [N, N·m].
        scale: ``(6,)`` of the channels.
        judged: ``(n,)`` which samples the gap is judged on.
        below_hz: where the noise is asked for.
    """
    record = problem.record
    louder = _validation_noise_ratio(record, residual / scale)
    slow, learnt = in_band(record, residual, below_hz), noise_floor(problem, below_hz)
    fitted = ~judged if (~judged).any() else judged
    # What is left in the trials that were fitted says how loud the noise is, as far as noise can be that loud.
    seen = np.sqrt((slow[fitted] ** 2).mean(axis=0))
    likely = louder * np.minimum(seen, np.sqrt(NOISE_SLACK) * learnt)
    least = np.minimum(likely, louder * np.minimum(learnt, _repeat_noise(record, slow)))
    powers = [float(((slow[span] / scale) ** 2).mean()) for span in record.spans]
    # Independent numbers that the level is learnt from: a noise of that band in as many channels as carry it.
    share = (likely / scale) ** 2
    channels = float(share.sum() ** 2 / (share**2).sum())
    numbers = 2.0 * below_hz * channels * int(fitted.sum()) / record.rate_hz
    return NoiseLevel(likely, least, float(np.hypot(_power_spread(problem, powers), np.sqrt(2.0 / numbers))))


def noise_floor(problem: Problem, below_hz: float = BAND_HZ) -> Array:
    """``(6,)`` standard deviation of the noise in band, below a frequency, from the noise model [N, N·m]."""
    total = np.zeros(len(problem.nominal.white_noise))
    for factor, span in zip(problem.whitening.factors, problem.record.spans, strict=True):
        covariance = np.linalg.inv(np.einsum("kji,kjl->kil", factor, factor))
        power = np.diagonal(covariance, axis1=1, axis2=2).copy()
        # All bins but the first stand for a real and an imaginary part, and for their mirror images.
        power[1:] *= 4.0
        low = np.fft.rfftfreq(span.stop - span.start, 1.0 / problem.record.rate_hz)[: len(power)] <= below_hz
        total += power[low].sum(axis=0) / (span.stop - span.start)
    return np.sqrt(total / len(problem.record.spans))


def _power_spread(problem: Problem, powers: list[float]) -> float:
    """How far the noise's power in the validation trials may be from what was learnt, relative.

    Args:
        powers: what a fit leaves of each trial.
    """
    held_out = np.array(problem.record.validation)
    fitted = np.array(powers)[~held_out]
    if len(fitted) < 3:
        return _LARGEST_SPREAD
    share = float(fitted.std(ddof=1) / fitted.mean()) / np.sqrt(max(1, held_out.sum()))
    return float(np.clip(share, _LEAST_SPREAD, _LARGEST_SPREAD))


def _validation_noise_ratio(record: FloatingRecord, residual: Array) -> float:
    """Amplitude of the noise in the validation trials over that in the others, from the band's upper end.

    Motion is slower than that, so that what a fit leaves there is noise; other motions carry more or less of the
    kinematics' noise into the equations. 1 where there are no validation trials, or no others.

    Args:
        residual: ``(n, 6)`` in band, channels of like size.
    """
    powers: tuple[list[float], list[float]] = ([], [])
    for span, held_out in zip(record.spans, record.validation, strict=True):
        n = span.stop - span.start
        upper = np.fft.rfftfreq(n, 1.0 / record.rate_hz) >= _UPPER_END_HZ
        powers[held_out].append(float((np.abs(np.fft.rfft(residual[span], axis=0)[upper]) ** 2).sum() / n**2))
    others, validation = powers
    if not others or not validation or min(others) <= 0.0:
        return 1.0
    more = float(np.sqrt(np.mean(validation) / np.mean(others))) - 1.0
    # What so few numbers say by chance is taken back (James and Stein 1961).
    more *= max(0.0, 1.0 - (_LOUDER_STD / max(abs(more), 1e-9)) ** 2)
    return float(np.clip(1.0 + more, *_LOUDER_RANGE))


def _repeat_noise(record: FloatingRecord, residual: Array) -> Array:
    """``(6,)`` standard deviation of the noise from pairs of repeated trials; infinity where there are none.

    What a wrong form leaves is the same in both: of all levels this is the one that holds nothing of it.
    """
    powers = []
    for first, second in record.repeats:
        one, two = record.spans[first], record.spans[second]
        n = min(one.stop - one.start, two.stop - two.start)
        change = residual[one.start : one.start + n] - residual[two.start : two.start + n]
        powers.append(0.5 * (change**2).mean(axis=0))
    return np.sqrt(np.mean(powers, axis=0)) if powers else np.full(residual.shape[1], np.inf)
