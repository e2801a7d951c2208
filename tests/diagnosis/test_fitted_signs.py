"""Dry friction of a joint that sticks, or that follows its velocity: one model finds both."""

from __future__ import annotations

import math
from dataclasses import replace
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
from excite.rows.sticking import time_at_rest
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


def fitted(folder: Path, trials: tuple[Trial, ...]) -> Baseline:
    header = axis_header(RATE_HZ, ("rigid_body", "viscous_friction", "coulomb_friction"), ("a", "b"))
    log = load_log(save_log(Log(header, trials, robot_text=URDF), folder / "axis"))
    samples = arm_samples(nominal_robot(log), log, log.trials)
    return fit_baseline(samples, header.modelled, spectral_floor(samples))


def left(baseline: Baseline) -> float:
    """What is left of the force in the validation trial [N]."""
    rest = baseline.plain(baseline.fit.residual)[0, ~baseline.samples.identification]
    return float(np.sqrt((rest**2).mean()))


@pytest.mark.parametrize("sticks", [True, False])
def test_friction_is_found(tmp_path: Path, sticks: bool):
    baseline = fitted(tmp_path, on_servo(sticks=sticks))
    assert float(baseline.fit.own[0][1]) == pytest.approx(COULOMB, rel=0.01)
    assert not baseline.signs[0].bent
    # The noise in the rows is .17 N.
    assert left(baseline) < 2.5e-3 * COULOMB


def test_torques_of_a_joint_that_sticks_say_next_to_nothing(tmp_path: Path):
    first, judging = on_servo(sticks=True)
    still = np.abs(np.gradient(first.q[:, 0], first.time)) < 1e-4
    assert 0.03 < still.mean() < 0.5
    # Whatever holds it, with what it was or twice that: nothing else becomes another.
    held = replace(first, tau=np.where(still[:, None], 2.0 * first.tau, first.tau))
    known, other = (fitted(tmp_path / name, (t, judging)) for name, t in (("a", first), ("b", held)))
    np.testing.assert_allclose(other.fit.own[0], known.fit.own[0], rtol=0.01, atol=0.5)
    np.testing.assert_allclose(other.phi[0], known.phi[0], rtol=0.01)


def test_both_sides_of_an_equation_are_left_out_where_its_joint_may_stick(tmp_path: Path):
    samples = fitted(tmp_path, on_servo(sticks=True)).samples
    counts, v = samples.slipping[:, 0], samples.stacked("v")[:, 0]
    assert float((counts**2).mean()) == pytest.approx(1.0)
    stands, turns = np.abs(v) < 0.5 * samples.standstill[0], np.diff(np.sign(v), prepend=np.sign(v[0])) != 0.0
    assert stands.any() and (counts[stands | turns] < 0.02).all()
    fast = np.convolve(np.abs(v) > 5.0 * samples.standstill[0], np.ones(11), "same") > 10.5
    assert fast.any() and (counts[fast] >= 1.0).all()
    signals = np.random.default_rng(0).standard_normal((len(v), 2))
    np.testing.assert_allclose(samples.rows(signals, [0, 0]), samples.rows(signals * counts[:, None]))


def test_a_joint_that_hardly_trembles_keeps_its_equation(tmp_path: Path):
    first, judging = (replace(t, q=1e-3 * t.q) for t in on_servo(sticks=False))
    samples = fitted(tmp_path, (first, judging)).samples
    assert (samples.slipping == 1.0).all()


@pytest.mark.parametrize(("stop", "share"), [(0, 0.25), (20, 0.4), (200, 0.8)])
def test_a_motor_that_stops_is_longer_at_rest_than_one_that_turns_through(stop: int, share: float):
    turning = np.linspace(-1.0, 1.0, 401)
    speed = np.abs(np.concatenate([turning[:200], np.zeros(stop), turning[200:]]))
    still = np.zeros(300)
    assert time_at_rest([np.concatenate([still, speed, still])] * 2, 0.2) == pytest.approx(share, abs=0.05)


def test_a_joint_that_turns_through_keeps_its_equation(tmp_path: Path):
    time = np.arange(12 * RATE_HZ) / RATE_HZ
    q = 0.3 * np.sin(2.0 * np.pi * 0.4 * time)[:, None]
    trials = tuple(replace(t, q=q, tau=1e3 * q) for t in on_servo(sticks=False))
    assert (fitted(tmp_path, trials).samples.slipping == 1.0).all()
