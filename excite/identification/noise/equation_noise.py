"""What the noise of all sensors leaves in the rows of a regression, before anything was measured.

With ``e`` the rows' error and ``n`` the noise of positions, ``e = n_f − Σ_k C_k dᵏn/dtᵏ``: forces come with their own
noise, and the inverse dynamics of noisy positions is off by its derivatives with respect to position, velocity
and acceleration. Differentiated twice, the noise of a floating base's pose outweighs that of its force sensors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import rfft

from excite.arrays import Array
from excite.errors import InputError
from excite.identification.noise.correlated import fft_length
from excite.identification.noise.sensor_sources import NoiseSource, noise_sources
from excite.identification.noise.trial_grid import TrialGrid
from excite.identification.problem import IdentificationProblem
from excite.motion.motion import Motion, interpolate_motion
from excite.robot.robot import Robot
from excite.rows.settings import Filters

_FREQUENCIES = 4096
# Parts of a spectrum with less than this share of its greatest amplitude are left out.
_AUDIBLE = 3e-3


@dataclass(frozen=True, eq=False)
class EquationNoise:
    """Noise of a problem's rows.

    Attributes:
        problem: the problem; its ``y`` is not used.
        grids: its trials' grids.
        sources: of each trial, sampled on its grid.
        log_hz: rate at which the sensors are read.
    """

    problem: IdentificationProblem
    grids: tuple[TrialGrid, ...]
    sources: tuple[tuple[NoiseSource, ...], ...]
    log_hz: float

    def channel_std(self) -> Array:
        """Standard deviation of each channel's rows over all trials, ``(n_channels,)``."""
        filters, sampling = _filters_of(self.problem)
        frequency = np.linspace(0.0, 0.5 * sampling, _FREQUENCIES)
        step = 2.0 * (frequency[1] - frequency[0]) / self.log_hz
        total, count = np.zeros(len(self.problem.channel_names)), 0
        for sources, grid in zip(self.sources, self.grids, strict=True):
            count += grid.n_samples
            for source in sources:
                ways = _noise_gains(frequency, len(source.gains), filters, sampling, source.positions)
                power = step * (ways.conj() @ ways.T).real
                for k, left in enumerate(source.gains):
                    for j, right in enumerate(source.gains):
                        if power[k, j] != 0.0:
                            total += power[k, j] * np.einsum("tcs,tcs,s->c", left, right, source.std**2)
        return np.sqrt(total / count)

    def with_misfit(self, misfit: Array) -> EquationNoise:
        """The same with an error of the model added, as white before the filter as identification takes it to be.

        Args:
            misfit: ``(n_channels,)`` standard deviation of what it leaves in the rows of each channel.
        """
        filters, sampling = _filters_of(self.problem)
        frequency = np.linspace(0.0, 0.5 * sampling, _FREQUENCIES)
        way = _noise_gains(frequency, 1, filters, sampling, False)[0].real
        passed = 2.0 * (frequency[1] - frequency[0]) / self.log_hz * float(way @ way)
        eye = np.eye(len(misfit))
        added = tuple(
            NoiseSource(misfit / np.sqrt(passed), (np.broadcast_to(eye, (g.n_samples, *eye.shape)),), False)
            for g in self.grids
        )
        sources = tuple((*old, new) for old, new in zip(self.sources, added, strict=True))
        return replace(self, sources=sources)

    def meat(self, columns: Array) -> Array:
        """``XᵀΣX`` of the rows' covariance ``Σ`` with ``columns`` ``(n_rows, k)``, ``(k, k)``.

        Trial by trial in the frequency domain with zero padding, which equals the sum over all pairs of
        instants; what decimation folds back is included, and gains are taken to change slowly against the
        filter's memory. Spectra are of single precision, which halves the time: predicted deviations of G1, Talos, Go2
        and iiwa14 differ by less than 2e-7 of them.
        """
        filters, sampling = _filters_of(self.problem)
        n_channels, width = len(self.problem.channel_names), columns.shape[1]
        meat = np.zeros((width, width))
        for sources, grid in zip(self.sources, self.grids, strict=True):
            x = grid.spread(columns[grid.rows], self.problem.channel, n_channels).astype(np.float32)
            rate, n_fft = 1.0 / grid.step_s, fft_length(2 * grid.n_samples)
            frequency = np.asarray(np.fft.rfftfreq(n_fft, grid.step_s), dtype=float)
            double = np.full(len(frequency), 2.0)
            double[0] = 1.0
            if n_fft % 2 == 0:
                double[-1] = 1.0
            scale = np.sqrt(double / n_fft * rate / self.log_hz)
            folds = [-rate * fold for fold in range(int(np.ceil(sampling / rate)))]
            for source in sources:
                seen = [
                    rfft(np.swapaxes(gain * source.std, 1, 2).astype(np.float32) @ x, n_fft, axis=0)
                    for gain in source.gains
                ]
                peak = np.abs(
                    _noise_gains(frequency, len(seen), filters, sampling, source.positions)[-1]
                ).max()
                for fold in folds:
                    ways = _noise_gains(frequency + fold, len(seen), filters, sampling, source.positions)
                    loud = np.abs(ways[-1])
                    kept = np.flatnonzero(loud > _AUDIBLE * peak)
                    if not len(kept):
                        continue
                    heard = (ways[:, kept].conj() * scale[kept]).astype(np.complex64)
                    z = sum(way[:, None, None] * part[kept] for way, part in zip(heard, seen, strict=True))
                    both = np.concatenate([z.real, z.imag]).reshape(-1, width)
                    # Of an array and itself, numpy computes one half.
                    meat += both.T @ both
        return meat


def equation_noise(
    robot: Robot,
    problem: IdentificationProblem,
    grids: Sequence[TrialGrid],
    motions: Mapping[str, Motion],
    log_hz: float,
) -> EquationNoise:
    """The noise that the sensors of ``robot.yaml`` leave in a problem's rows.

    Left out, being far smaller: the noise of joint positions in the place of an ankle sensor, and that of
    velocities in the sign of Coulomb friction.

    Args:
        robot: the robot.
        problem: rows of noise-free trials.
        grids: its trials' grids.
        motions: by name of the trial.
        log_hz: rate at which the sensors are read [Hz].

    Raises:
        InputError: joint torques whose description does not state the noise of its torques.
    """
    sources = []
    for grid in grids:
        start = float(problem.time[grid.rows].min())
        motion = motions[problem.trial_names[int(problem.trial[grid.rows[0]])]]
        time = np.clip(start + grid.step_s * np.arange(grid.n_samples), motion.time[0], motion.time[-1])
        sampled = interpolate_motion(motion, robot, time)
        sources.append(noise_sources(robot, problem, sampled))
    return EquationNoise(problem, tuple(grids), tuple(sources), log_hz)


def _filters_of(problem: IdentificationProblem) -> tuple[Filters, float]:
    if problem.filters is None or problem.sampling_hz is None:
        raise InputError("nothing is known of the rows' filters", remedy="build the problem from a log")
    return problem.filters, problem.sampling_hz


def _noise_gains(
    frequency: Array, orders: int, filters: Filters, sampling_hz: float, positions: bool
) -> Array:
    """Amplitude from noise to rows by order of derivative, ``(orders, n)``; zero above half the rate."""
    way = _filter_amplitude(frequency, filters.cutoff_hz, filters.order, sampling_hz)
    if positions:
        way = way * _filter_amplitude(frequency, filters.kinematics_cutoff_hz, filters.order, sampling_hz)
    way = np.where(np.abs(frequency) <= 0.5 * sampling_hz, way, 0.0)
    return np.array([way * (2j * np.pi * frequency) ** order for order in range(orders)])


def _filter_amplitude(frequency: Array, cutoff_hz: float, order: int, sampling_hz: float) -> Array:
    """Of a Butterworth filter run forwards and backwards."""
    if cutoff_hz >= 0.5 * sampling_hz:
        return np.ones_like(frequency)
    corner = np.tan(np.pi * cutoff_hz / sampling_hz)
    ratio = np.minimum(np.abs(np.tan(np.pi * frequency / sampling_hz)) / corner, 1e6)
    return np.asarray(1.0 / (1.0 + ratio ** (2 * order)))
