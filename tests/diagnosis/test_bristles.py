"""Dry friction with bristles (LuGre): damped ones are no gap, and static friction above Coulomb's is told from them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from tests.diagnosis.test_one_joint import URDF, axis_header

RATE_HZ, INNER = 200, 25
MASS, VISCOUS, COULOMB, NOISE = 100.0, 150.0, 60.0, 0.5
TURNS = ((0.12, 0.35), (0.05, 0.9), (0.015, 1.7))


def driven(
    name: str,
    role: str,
    phase: float,
    rng: np.random.Generator,
    *,
    breakaway: float,
    damping: float,
    excess: float,
    dies_at: float = math.inf,
) -> Trial:
    """A carriage on a servo whose friction is the LuGre model's, stepped finely.

    Args:
        name: of the trial.
        role: of the trial.
        phase: of the motion.
        rng: of the noise.
        breakaway: deflection at which bristles slip, over Coulomb's level [m].
        damping: of the bristles, over the critical one of the carriage on them.
        excess: of static friction over Coulomb's [N], Stribeck velocity 0.06 m/s.
        dies_at: speed at which the damping dies out [m/s].
    """
    dt, n = 1.0 / (RATE_HZ * INNER), 12 * RATE_HZ
    stiffness = COULOMB / breakaway
    sigma = damping * 2.0 * math.sqrt(stiffness * MASS)
    x = v = z = 0.0
    q, tau = np.empty(n), np.empty(n)
    for k in range(n * INNER):
        t = k * dt
        aim = min(t, 1.0) * sum(
            a * math.sin(2.0 * math.pi * f * t + phase * i) for i, (a, f) in enumerate(TURNS)
        )
        force = 4e4 * (aim - x) - 2.5e3 * v
        if k % INNER == 0:
            q[k // INNER], tau[k // INNER] = x, force
        slips_at = (COULOMB + excess * math.exp(-((v / 0.06) ** 2))) / stiffness
        rate = v - abs(v) * z / slips_at
        z += dt * rate
        friction = stiffness * z + sigma * math.exp(-((v / dies_at) ** 2)) * rate + VISCOUS * v
        v += dt * (force - friction) / MASS
        x += dt * v
    q += 2e-6 * rng.standard_normal(n)
    time = np.arange(n) / RATE_HZ
    return Trial(name, role, time, q[:, None], tau=(tau + NOISE * rng.standard_normal(n))[:, None])


def recorded(folder: Path, **bristles: float) -> Path:
    """A log of two trials of one carriage."""
    rng = np.random.default_rng(5)
    trials = tuple(
        driven(name, role, phase, rng, **bristles)
        for name, role, phase in (("a", "identification", 0.7), ("b", "validation", 1.9))
    )
    modelled = ("rigid_body", "viscous_friction", "coulomb_friction")
    return save_log(Log(axis_header(RATE_HZ, modelled, ("a", "b")), trials, robot_text=URDF), folder / "axis")


def fitted(folder: Path) -> Baseline:
    log = load_log(folder)
    samples = arm_samples(nominal_robot(log), log, log.trials)
    return fit_baseline(samples, log.header.modelled, spectral_floor(samples))


def left(baseline: Baseline) -> float:
    """What is left of the force in the validation trial [N]."""
    rest = baseline.plain_residual(baseline.fit.residual)[0, ~baseline.samples.identification_rows]
    return float(np.sqrt((rest**2).mean()))


@pytest.mark.parametrize("dies_at", [math.inf, 0.03])
def test_damping_of_bristles_is_fitted(tmp_path: Path, dies_at: float):
    baseline = fitted(recorded(tmp_path, breakaway=2e-3, damping=0.5, excess=0.0, dies_at=dies_at))
    (sign,) = baseline.signs
    assert sign.has_damping and math.isinf(sign.damped_below) is math.isinf(dies_at)
    assert sign.breakaway == pytest.approx(2e-3, rel=0.15)
    assert float(baseline.fit.own_coefs[0][1]) == pytest.approx(COULOMB, rel=0.02)
    plain = baseline.with_signs([sign._replace(damped_below=0.0)])
    assert left(baseline) < 0.7 * left(plain.with_fit(plain.solver.fit_columns()))
    assert left(baseline) < 1.5 * float(spectral_floor(baseline.samples)[0])


def test_bristles_without_damping_get_none(tmp_path: Path):
    (sign,) = fitted(recorded(tmp_path, breakaway=2e-3, damping=0.0, excess=0.0)).signs
    assert sign.has_bristles and not sign.has_damping


def test_damped_bristles_are_no_gap(tmp_path: Path):
    assert diagnose(recorded(tmp_path, breakaway=2e-3, damping=0.5, excess=0.0)).verdict == "none"


@pytest.mark.parametrize("breakaway", [pytest.param(6e-4, marks=pytest.mark.battery), 2e-3])
def test_static_friction_is_told_from_bristles_that_bend(tmp_path: Path, breakaway: float):
    result = diagnose(recorded(tmp_path, breakaway=breakaway, damping=0.5, excess=45.0))
    assert (result.verdict, result.effect) == ("effect", "stribeck")
    values = result.effects[0].parameters
    assert values["excess"].value == pytest.approx(45.0, rel=0.05)
    assert values["velocity"].value == pytest.approx(0.06, rel=0.05)
    assert result.gap.share_closed > 0.95
