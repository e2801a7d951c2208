"""Whether the stated interval of the share closed holds on motions that the diagnosis has not seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from excite.diagnosis.attribute import Attributor
from excite.diagnosis.baseline import fit_baseline
from excite.diagnosis.doctor import examine
from excite.diagnosis.gap import share_closed
from excite.diagnosis.kinematic_noise import kinematic_noise, position_noise
from excite.diagnosis.noise_floor import other_postures, repeat_floor, spectral_floor, unrepeated, white_floor
from excite.diagnosis.samples import arm_samples
from excite.diagnosis.shrink import gap_of
from excite.logs.log import Log
from excite.logs.signals.butterworth import noise_bandwidth
from excite.robot.loading import load_robot
from excite.robot.robot import Array, Robot
from excite.simulation.blind.arm import N_TRIALS, arm_of
from excite.simulation.blind.draw import ROBOTS, draft
from excite.simulation.blind.make import _NOISE_Q, _NOISE_TAU, _prepare, _session, recordings_of
from excite.simulation.sensing import log_header
from tests.benchmarks.table import Row

SEED, CASES, MORE = 90909, 12, 4


def coverage(seed: int = SEED, cases: int = CASES) -> tuple[float, float]:
    """Share of stated 90 % intervals that hold the share closed on other motions, and their median width.

    Each case has six validation trials; every two of them state an interval, the other four say what is true,
    with the noise that the simulation has put in as their floor.
    """
    held, widths = [], []
    for number, child in enumerate(np.random.SeedSequence(seed).spawn(cases)):
        rng = np.random.default_rng(child)
        plan = replace(draft(number, rng, ROBOTS), faults=())
        if plan.kind in {"none", "unknown"}:
            continue
        arm = arm_of(load_robot(plan.robot), plan.fixed, rng)
        further = arm_of(load_robot(plan.robot), plan.fixed, rng).motions[:MORE]
        named = tuple(replace(m, name=f"trial_{len(arm.motions) + k:02d}") for k, m in enumerate(further))
        arm = replace(arm, motions=arm.motions + named)
        virtual, _, modelled, _ = _prepare(arm, plan, rng)
        recordings = recordings_of(virtual, arm)
        spread = np.vstack([r.tau_motor for r in recordings]).std(axis=0)
        sigma = plan.noise * (_NOISE_TAU * spread + 2e-4 * spread.max())
        trials, headers = _session(recordings, arm, plan, sigma, rng)
        last = len(trials) - 1
        trials = tuple(
            replace(
                trial,
                role="validation" if N_TRIALS <= k < last else "identification",
                repeats=trials[0].name if k == last else None,
            )
            for k, trial in enumerate(trials)
        )
        header = log_header(virtual.robot, headers).model_copy(update={"modelled": modelled})
        log = Log(header=header, trials=trials, robot_text=virtual.robot.urdf)
        for stated, truth in _pairs(virtual.robot, log, sigma, plan.noise * _NOISE_Q):
            if stated is not None:
                held.append(stated[0] <= truth <= stated[1])
                widths.append(stated[1] - stated[0])
    return float(np.mean(held)), float(np.median(widths))


def _pairs(
    robot: Robot, log: Log, sigma: Array, sigma_q: float
) -> Iterator[tuple[tuple[float, float] | None, float]]:
    """Stated interval and true share of every two validation trials."""
    chart = examine(robot, log)
    samples = arm_samples(robot, log, chart.trials)
    spectral = spectral_floor(samples)
    baseline = fit_baseline(samples, log.header.modelled, np.minimum(white_floor(samples), spectral))
    columns = [log.header.joints.index(name) for name in samples.joints]
    noise = kinematic_noise(
        baseline, position_noise(samples, columns, chart.trials), np.random.default_rng(0)
    )
    judged = noise * baseline.strict
    spectral = np.hypot(spectral, np.sqrt((judged**2).mean(axis=1)))
    found = Attributor(baseline, spectral, unrepeated(samples, judged)).run()
    if not found.accepted:
        return
    before, after = (baseline.plain(fit.residual) for fit in (found.before, found.after))
    repeated = repeat_floor(samples, after)
    repeat = (found.floor if repeated is None else np.maximum(repeated, 0.5 * found.floor)) ** 2
    white = sigma**2 * noise_bandwidth(samples.rate_hz, samples.bands.rows_hz)
    true = kinematic_noise(baseline, np.full(len(columns), sigma_q), np.random.default_rng(1))
    outside = [k for k, trial in enumerate(samples.trials) if not trial.identification]
    for pair in combinations(outside, 2):
        rows = np.isin(samples.trial_of_row, pair)
        keep = samples.identification | rows
        part = replace(
            samples,
            trials=tuple(t for k, t in enumerate(samples.trials) if t.identification or k in pair),
        )
        floor = other_postures(np.sqrt(repeat), unrepeated(samples, noise, rows))
        gap = gap_of(part, before[:, keep], after[:, keep], floor, found.scale, np.random.default_rng(2))
        rest = np.isin(samples.trial_of_row, [k for k in outside if k not in pair])
        b, a, f = (
            float(np.sqrt(np.mean(power / found.scale**2)))
            for power in (
                (before[:, rest] ** 2).mean(axis=1),
                (after[:, rest] ** 2).mean(axis=1),
                white + (true[:, rest] ** 2).mean(axis=1),
            )
        )
        yield gap.interval, share_closed(b, a, f)


def rows() -> list[Row]:
    """Figures of the intervals."""
    covered, width = coverage()
    return [
        Row.holds(
            "stated 90 % interval of the share closed: holds on other motions",
            "85 … 95 %",
            f"{100.0 * covered:.0f} %",
            0.85 <= covered <= 0.95,
        ),
        Row("the same: median width", "", f"{width:.3f}", None),
    ]
