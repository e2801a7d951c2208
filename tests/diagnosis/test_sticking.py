"""Dry friction of a joint that sticks, or that follows its motion: which of them it is, and how much."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.equations.standstill import fit_where_slipping
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from tests.diagnosis.test_one_joint import URDF, axis_header

RATE_HZ, INNER = 200, 25
MASS, COULOMB, BREAKAWAY, NOISE = 100.0, 200.0, 3e-4, 0.5
TURNS = ((0.12, 0.35), (0.05, 0.9), (0.015, 1.7))


class Dry:
    """Dry friction of a carriage, a step after the other."""

    def __init__(self, law: str) -> None:
        self.law, self.bent = law, 0.0

    def __call__(self, v: float, force: float, dt: float) -> float:
        """What acts against the motion [N], at a velocity [m/s] and a force of the servo [N]."""
        if self.law == "sticks":
            # Of the impulse that would stop it friction gives what it can (Karnopp 1985).
            return float(np.clip(force + MASS * v / dt, -COULOMB, COULOMB))
        if self.law == "creeps":
            # It gives in a little, as what a simulator softens does.
            return float(np.clip(0.9 * (force + 100.0 * MASS * v), -COULOMB, COULOMB))
        if self.law == "bristles":
            self.bent = (self.bent + dt * v / BREAKAWAY) / (1.0 + dt * abs(v) / BREAKAWAY)
            return COULOMB * self.bent
        more = 0.3 * math.exp(-((v / 0.03) ** 2)) if self.law == "stribeck" else 0.0
        return COULOMB * (1.0 + more) * math.tanh(v / 0.01)


def driven(name: str, role: str, phase: float, rng: np.random.Generator, law: str) -> Trial:
    """A carriage on a servo."""
    dt, n, dry = 1.0 / (RATE_HZ * INNER), 12 * RATE_HZ, Dry(law)
    x = v = 0.0
    q, tau = np.empty(n), np.empty(n)
    for k in range(n * INNER):
        t = k * dt
        grow = min(t, 1.0)
        aim = grow * sum(a * math.sin(2.0 * math.pi * f * t + phase * i) for i, (a, f) in enumerate(TURNS))
        force = 4e4 * (aim - x) - 2.5e3 * v
        if k % INNER == 0:
            q[k // INNER], tau[k // INNER] = x, force
        v += dt * (force - dry(v, force, dt)) / MASS
        x += dt * v
    time = np.arange(n) / RATE_HZ
    q += 1e-6 * rng.standard_normal(n)
    return Trial(name, role, time, q[:, None], tau=(tau + NOISE * rng.standard_normal(n))[:, None])


def on_servo(law: str) -> tuple[Trial, ...]:
    rng = np.random.default_rng(3)
    return driven("a", "identification", 0.7, rng, law), driven("b", "validation", 1.9, rng, law)


def fitted(folder: Path, trials: tuple[Trial, ...]) -> Baseline:
    header = axis_header(RATE_HZ, ("rigid_body", "viscous_friction", "coulomb_friction"), ("a", "b"))
    log = load_log(save_log(Log(header, trials, robot_text=URDF), folder / "axis"))
    samples = arm_samples(nominal_robot(log), log, log.trials)
    return fit_where_slipping(samples, header.modelled, spectral_floor(samples))


def left(baseline: Baseline) -> float:
    """What is left of the force in the validation trial [N]."""
    rest = baseline.plain_residual(baseline.fit.residual)[0, ~baseline.samples.identification_rows]
    return float(np.sqrt((rest**2).mean()))


@pytest.mark.parametrize(("law", "most"), [("sticks", 2.5e-3), ("smooth", 3.5e-3)])
def test_friction_is_found(tmp_path: Path, law: str, most: float):
    baseline = fitted(tmp_path, on_servo(law))
    assert float(baseline.fit.own_coefs[0][1]) == pytest.approx(COULOMB, rel=0.01)
    assert not baseline.signs[0].has_bristles
    # The noise in the rows is .17 N; the filter of the kinematics bends what is smooth in the velocity.
    assert left(baseline) < most * COULOMB


@pytest.mark.parametrize("law", ["sticks", "creeps"])
def test_a_joint_sticks_of_which_the_motion_explains_nothing_where_it_is_slow(tmp_path: Path, law: str):
    assert fitted(tmp_path, on_servo(law)).samples.sticking == {0}


@pytest.mark.parametrize("law", ["smooth", "stribeck", "bristles"])
def test_friction_that_follows_from_the_motion_sticks_nowhere(tmp_path: Path, law: str):
    samples = fitted(tmp_path, on_servo(law)).samples
    assert not samples.sticking
    assert (samples.slip_weights == 1.0).all()


def test_torques_of_a_joint_that_sticks_say_next_to_nothing(tmp_path: Path):
    first, judging = on_servo("sticks")
    still = np.abs(np.gradient(first.q[:, 0], first.time)) < 1e-4
    assert 0.03 < still.mean() < 0.5
    # Whatever holds it, with what it was or twice that: nothing else becomes another.
    held = replace(first, tau=np.where(still[:, None], 2.0 * first.tau, first.tau))
    known, other = (fitted(tmp_path / name, (t, judging)) for name, t in (("a", first), ("b", held)))
    np.testing.assert_allclose(other.fit.own_coefs[0], known.fit.own_coefs[0], rtol=0.01, atol=0.5)
    np.testing.assert_allclose(other.phi[0], known.phi[0], rtol=0.01)


def test_both_sides_of_an_equation_are_left_out_where_its_joint_may_stick(tmp_path: Path):
    samples = fitted(tmp_path, on_servo("sticks")).samples
    counts, v = samples.slip_weights[:, 0], samples.stack_trials("v")[:, 0]
    assert float((counts**2).mean()) == pytest.approx(1.0)
    stands, turns = np.abs(v) < 0.5 * samples.standstill[0], np.diff(np.sign(v), prepend=np.sign(v[0])) != 0.0
    assert stands.any() and (counts[stands | turns] < 0.02).all()
    fast = np.convolve(np.abs(v) > 5.0 * samples.standstill[0], np.ones(11), "same") > 10.5
    assert fast.any() and (counts[fast] >= 1.0).all()
    signals = np.random.default_rng(0).standard_normal((len(v), 2))
    np.testing.assert_allclose(samples.to_rows(signals, [0, 0]), samples.to_rows(signals * counts[:, None]))


def test_a_joint_that_hardly_trembles_keeps_its_equation(tmp_path: Path):
    first, judging = (replace(t, q=1e-3 * t.q) for t in on_servo("smooth"))
    samples = fitted(tmp_path, (first, judging)).samples
    assert (samples.slip_weights == 1.0).all()
