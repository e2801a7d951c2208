"""How often intervals hold the truth: simulated logs with known noise, many draws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from excite.arrays import Array
from excite.identification.noise import trial_grids
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, condense_problem, iterate_weights
from excite.identification.statistics import BaseStatistics, base_statistics
from excite.logs.signals.butterworth import central_differences, lowpass, settling_samples
from excite.regressor.kernels import base_link_regressor, joint_torque_regressor
from excite.robot.loading import load_robot
from excite.rows.settings import Filters
from tests.identification.synthetic import NAMES, smooth

Peer = Callable[["Experiment", int, np.ndarray], np.ndarray]
"""Which intervals hold the truth, ``(n_base,)``: experiment, seed, independent columns."""
AXES = ("fx", "fy", "fz", "tx", "ty", "tz")


@dataclass(frozen=True)
class Case:
    """One way to treat a log.

    Attributes:
        cutoff_hz: cut-off of the zero-phase filter on both sides, None for none.
        sampling_hz: rate of the log.
        every: decimation.
    """

    cutoff_hz: float | None
    sampling_hz: float = 200.0
    every: int = 1

    def __str__(self) -> str:
        how = "unfiltered" if self.cutoff_hz is None else f"{self.cutoff_hz:g} Hz"
        thinned = f", every {self.every}th row" if self.every > 1 else ""
        return f"{self.sampling_hz:g} Hz log, {how}{thinned}"


CASES = (
    Case(None),
    Case(20.0),
    Case(10.0),
    Case(5.0),
    Case(20.0, every=10),
    Case(10.0, every=10),
    Case(5.0, every=10),
    Case(10.0, 1000.0, 10),
    Case(5.0, 1000.0, 10),
)


class Experiment:
    """A robot that moves smoothly, its forces with white noise, both sides filtered alike and thinned out.

    Args:
        robot: bundled name; a floating one gives base rows with noise of a force plate.
        case: filter and rates.
        duration: of the motion [s].
        trials: number of motions.
        encoder: standard deviation of white noise on the positions of an arm, filtered and differentiated
            as a log's before they reach the regressor [rad].
    """

    def __init__(self, robot: str, case: Case, duration: float = 12.0, trials: int = 1, encoder: float = 0.0):
        self.robot, self.case, self.encoder = load_robot(robot), case, encoder
        rng = np.random.default_rng(7)
        self.time = np.arange(0.0, duration, 1.0 / case.sampling_hz)
        motions = [self._motion(rng) for _ in range(trials)]
        self.positions = [q for q, _, _ in motions]
        rows = [self._rows(*motion) for motion in motions]
        self.n_channels = rows[0].shape[1]
        signal = np.concatenate(rows) @ self.robot.nominal_parameters
        arm_sigma = 0.02 * np.sqrt(np.mean(signal**2, axis=0)) + 0.05
        self.sigma = np.array([1.0] * 3 + [0.1] * 3) if self.robot.floating else arm_sigma
        filtered = [self._filter(part) for part in rows]
        self.kept = len(filtered[0])
        self.values = np.concatenate(filtered)
        self.trials = trials
        self._last: tuple[int, IdentificationProblem] | None = None
        self._bases: dict[tuple[int, ...], tuple[np.ndarray, np.ndarray]] = {}

    def _motion(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        robot = self.robot
        middle = 0.5 * (robot.limits.position_lower + robot.limits.position_upper)
        size = 0.45 * (robot.limits.position_upper - robot.limits.position_lower)
        x, v, a = smooth(rng, self.time, size)
        if not robot.floating:
            return middle + x, v, a
        lean, _, _ = smooth(rng, self.time, np.full(3, 0.15))
        _, twist, change = smooth(rng, self.time, np.array([0.05, 0.05, 0.05, 0.15, 0.15, 0.15]))
        quaternion = np.column_stack([lean / 2, np.ones(len(self.time))])
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        q = np.column_stack([np.zeros((len(self.time), 3)), quaternion, middle + x])
        return q, np.column_stack([twist, v]), np.column_stack([change, a])

    def _rows(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        make = base_link_regressor if self.robot.floating else joint_torque_regressor
        return make(self.robot.model, q, v, a)

    def _measured_rows(self, rng: np.random.Generator) -> np.ndarray:
        """Filtered rows as a log with noisy encoders gives them."""
        rate, cutoff = self.case.sampling_hz, 2.0 * (self.case.cutoff_hz or 0.25 * self.case.sampling_hz)
        parts = []
        for q in self.positions:
            noisy = q + self.encoder * rng.standard_normal(q.shape)
            smoothed = central_differences(lowpass(noisy, rate, cutoff), rate)
            parts.append(self._filter(self._rows(smoothed.value, smoothed.first, smoothed.second)))
        return np.concatenate(parts)

    def _filter(self, values: np.ndarray) -> np.ndarray:
        case = self.case
        if case.cutoff_hz is None:
            return values[:: case.every]
        edge = settling_samples(case.sampling_hz, case.cutoff_hz)
        filtered = lowpass(values, case.sampling_hz, case.cutoff_hz)
        return filtered[edge : len(values) - edge : case.every]

    @cached_property
    def blank(self) -> IdentificationProblem:
        """The problem without a measurement."""
        case, robot, n, c = self.case, self.robot, self.kept, self.n_channels
        rate = case.sampling_hz / case.every
        cutoff = case.cutoff_hz or 0.5 * case.sampling_hz
        bandwidth = min(1.0, 2.0 * cutoff / rate)
        inertial = robot.nominal_parameters
        return IdentificationProblem(
            robot=robot,
            Y=self.values.reshape(-1, self.values.shape[2]),
            y=np.zeros(n * c * self.trials),
            weights=1.0 / np.tile(self.sigma, n * self.trials),
            channel=np.tile(np.arange(c), n * self.trials),
            channel_names=AXES if robot.floating else robot.joint_names,
            channel_units=("N·m",) * c,
            time=np.tile(np.repeat(np.arange(n) / rate, c), self.trials),
            trial=np.repeat(np.arange(self.trials), n * c),
            trial_names=tuple(f"trial_{k}" for k in range(self.trials)),
            parameter_names=tuple(f"{s.link}.{name}" for s in robot.segments for name in NAMES),
            prior=inertial,
            n_inertial=len(inertial),
            noise_bandwidth=bandwidth,
            filters=Filters(cutoff, cutoff, 4, rate),
            sampling_hz=case.sampling_hz,
        )

    @cached_property
    def _signal(self) -> np.ndarray:
        """What the true parameters cause, ``(n, n_channels)``."""
        return self.values @ self.robot.nominal_parameters

    @cached_property
    def _condensed(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Orthonormal basis and triangle of each channel's rows."""
        problem = self.blank
        return [np.linalg.qr(problem.Y[problem.channel == c]) for c in range(self.n_channels)]

    @cached_property
    def _grids(self):
        return trial_grids(self.blank)

    def noise(self, rng: np.random.Generator) -> np.ndarray:
        """White noise at the log's rate, ``(n, n_channels)``."""
        return rng.standard_normal((len(self.time), self.n_channels)) * self.sigma

    def problem(self, seed: int) -> IdentificationProblem:
        """The problem with a measurement; the last one is kept, as peers look at it too."""
        if self._last is None or self._last[0] != seed:
            self._last = seed, self._measured(seed)
        return self._last[1]

    def _measured(self, seed: int) -> IdentificationProblem:
        rng = np.random.default_rng(seed)
        noise = np.concatenate([self._filter(self.noise(rng)) for _ in range(self.trials)])
        y = (self._signal + noise).ravel()
        if self.encoder == 0.0:
            return replace(self.blank, y=y)
        measured = self._measured_rows(rng)
        return replace(self.blank, y=y, Y=measured.reshape(-1, measured.shape[2]))

    def draw(self, seed: int) -> Regression:
        """A problem condensed; the same as doing it anew, only faster."""
        problem = self.problem(seed)
        if self.encoder > 0.0:
            return condense_problem(problem)
        y = problem.y
        width = problem.n_params + 1
        factors = np.zeros((self.n_channels, width, width))
        for c, (basis, triangle) in enumerate(self._condensed):
            own = y[problem.channel == c]
            projected = basis.T @ own
            k = len(triangle)
            factors[c, :k, :-1], factors[c, :k, -1] = triangle, projected
            factors[c, min(k, width - 1), -1] = np.linalg.norm(own - basis @ projected)
        return Regression(problem, self._grids, factors, np.ones(self.n_channels))

    def statistics(self, seed: int) -> BaseStatistics:
        """Base parameters of one draw."""
        return base_statistics(iterate_weights(self.draw(seed)))

    def true_base(self, columns: np.ndarray) -> np.ndarray:
        """True base parameters for given independent columns."""
        q, r = self.orthonormal(columns, weighted=False)
        return np.linalg.solve(r, q.T @ self._signal.ravel())

    def orthonormal(self, columns: np.ndarray, *, weighted: bool) -> tuple[np.ndarray, np.ndarray]:
        """``Q`` and ``R`` of some columns without encoder noise, as they are or over each channel's own noise."""
        key = (weighted, *columns.tolist())
        if key not in self._bases:
            x = self.blank.Y[:, columns]
            self._bases[key] = np.linalg.qr(x * self.blank.weights[:, None] if weighted else x)
        return self._bases[key]

    def coverage(self, draws: range, peers: dict[str, Peer] | None = None) -> dict[str, Array]:
        """How often intervals of 95 % hold the truth, ours and those of ``peers``: share for each parameter."""
        inside: dict[str, list[Array]] = {"ours": [], **{name: [] for name in peers or {}}}
        for seed in draws:
            found = self.statistics(seed)
            error = np.abs(found.estimate - found.base.values(self.robot.nominal_parameters))
            inside["ours"].append(error < found.half_width())
            for name, peer in (peers or {}).items():
                inside[name].append(peer(self, seed, found.base.independent))
        return {name: np.mean(values, axis=0) for name, values in inside.items()}
