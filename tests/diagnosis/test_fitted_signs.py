"""Dry friction changes sign where a joint stops, which is before its filtered velocity does."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from tests.diagnosis.test_one_joint import URDF, axis_header

RATE_HZ, INNER = 200, 25
MASS, COULOMB, NOISE = 100.0, 200.0, 0.5
TURNS = ((0.12, 0.35), (0.05, 0.9), (0.015, 1.7))


def driven(name: str, role: str, phase: float, rng: np.random.Generator, *, sticks: bool) -> Trial:
    """A carriage on a servo; it sticks for a moment at every reversal, or its friction is smooth in the velocity."""
    dt, n = 1.0 / (RATE_HZ * INNER), 12 * RATE_HZ
    x = v = 0.0
    q, tau = np.empty(n), np.empty(n)
    for k in range(n * INNER):
        t = k * dt
        grow = min(t, 1.0)
        aim = grow * sum(a * math.sin(2.0 * math.pi * f * t + phase * i) for i, (a, f) in enumerate(TURNS))
        force = 4e4 * (aim - x) - 2.5e3 * v
        if k % INNER == 0:
            q[k // INNER], tau[k // INNER] = x, force
        if sticks:
            # Of the impulse that would stop it friction gives what it can (Karnopp 1985).
            free = v + dt * force / MASS
            v = math.copysign(max(abs(free) - dt * COULOMB / MASS, 0.0), free)
        else:
            v += dt * (force - COULOMB * math.tanh(v / 0.01)) / MASS
        x += dt * v
    time = np.arange(n) / RATE_HZ
    q += 1e-6 * rng.standard_normal(n)
    return Trial(name, role, time, q[:, None], tau=(tau + NOISE * rng.standard_normal(n))[:, None])


def on_servo(*, sticks: bool) -> tuple[Trial, ...]:
    rng = np.random.default_rng(3)
    return (
        driven("a", "identification", 0.7, rng, sticks=sticks),
        driven("b", "validation", 1.9, rng, sticks=sticks),
    )


def ahead(lead: float) -> tuple[Trial, ...]:
    """Friction that changes sign earlier than the velocity by a known time."""
    rng, time, trials = np.random.default_rng(4), np.arange(12 * RATE_HZ) / RATE_HZ, []
    for name, role, phase in (("a", "identification", 0.7), ("b", "validation", 1.9)):
        waves = [(a, 2.0 * np.pi * f, phase * (i + 1)) for i, (a, f) in enumerate(TURNS)]
        q = sum(a * np.sin(w * time + p) for a, w, p in waves)
        acceleration = sum(-a * w**2 * np.sin(w * time + p) for a, w, p in waves)
        sooner = sum(a * w * np.cos(w * (time + lead) + p) for a, w, p in waves)
        force = (
            MASS * acceleration + COULOMB * np.tanh(sooner / 0.004) + NOISE * rng.standard_normal(len(time))
        )
        trials.append(Trial(name, role, time, q[:, None], tau=force[:, None]))
    return tuple(trials)


def fitted(folder: Path, trials: tuple[Trial, ...]) -> Baseline:
    header = axis_header(RATE_HZ, ("rigid_body", "viscous_friction", "coulomb_friction"), ("a", "b"))
    log = load_log(save_log(Log(header, trials, robot_text=URDF), folder / "axis"))
    samples = arm_samples(nominal_robot(log), log, log.trials)
    return fit_baseline(samples, header.modelled, spectral_floor(samples))


def left(baseline: Baseline) -> float:
    """What is left of the force in the validation trial [N]."""
    rest = baseline.plain(baseline.fit.residual)[0, ~baseline.samples.identification]
    return float(np.sqrt((rest**2).mean()))


def test_friction_leads_the_velocity_of_a_joint_that_sticks(tmp_path: Path):
    baseline = fitted(tmp_path, on_servo(sticks=True))
    assert 3e-3 < baseline.samples.lead < 2e-2
    without = baseline.with_signs(baseline.signs, 0.0)
    assert left(baseline) < 0.88 * left(without.updated(without.solver.fit()))
    assert float(baseline.fit.own[0][1]) == pytest.approx(COULOMB, rel=0.03)


def test_friction_that_follows_the_velocity_does_not_lead_it(tmp_path: Path):
    baseline = fitted(tmp_path, on_servo(sticks=False))
    assert baseline.samples.lead == 0.0
    assert float(baseline.fit.own[0][1]) == pytest.approx(COULOMB, rel=0.02)


@pytest.mark.parametrize("lead", [0.0, 4e-3, 11e-3])
def test_a_lead_is_found(tmp_path: Path, lead: float):
    baseline = fitted(tmp_path, ahead(lead))
    assert baseline.samples.lead == pytest.approx(lead, abs=6e-4)
    assert left(baseline) < 1.2 * float(spectral_floor(baseline.samples)[0])
