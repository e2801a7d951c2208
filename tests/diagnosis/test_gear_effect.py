"""What soft and loose gears have in common: second order, and where a search has to end."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.arrays import Moved
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.gears.backlash import Backlash, SoftBacklash
from excite.diagnosis.effects.gears.gear_effect import JointElasticity
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.logs.files import load_log, save_log
from excite.logs.header_blocks import TrialHeader
from excite.logs.robot import nominal_robot
from tests.diagnosis.two_joints import moved, two_joint_log

FIRST = np.array([1.0, 0.0])


def rigid(folder: Path) -> Baseline:
    """The baseline of an arm that lacks nothing; one trial is repeated."""
    seeds = {"t0": 0, "t1": 1, "t2": 2, "again": 0}
    trials = []
    for name, seed in seeds.items():
        trials.append(moved(name, "identification", 10.0, np.random.default_rng(seed), np.eye(2)))
    log = two_joint_log(tuple(trials))
    again = TrialHeader(file="again.parquet", role="identification", repeats="t0.parquet")
    log = replace(log, header=log.header.model_copy(update={"trials": (*log.header.trials[:3], again)}))
    log = load_log(save_log(log, folder / "two"))
    samples = arm_samples(nominal_robot(log), log, log.trials)
    return fit_baseline(samples, log.header.modelled, spectral_floor(samples))


@pytest.fixture(scope="module")
def baseline(tmp_path_factory: pytest.TempPathFactory) -> Baseline:
    return rigid(tmp_path_factory.mktemp("quiet"))


def test_second_derivatives_of_the_torques(baseline: Baseline) -> None:
    """Torques of a joint that is a tenth of a radian off: the third order is left."""
    context, j = Context(baseline), 0
    rng, samples = np.random.default_rng(2), baseline.samples
    q, v, a = (samples.stack_trials(name) for name in ("q", "v", "a"))
    x, s, acc = (size * rng.uniform(-1.0, 1.0, (len(q), 1)) for size in (0.1, 2.0, 30.0))
    first = (
        context.torque_gradient(j, "q") * x
        + context.torque_gradient(j, "v") * s
        + context.torque_gradient(j, "a") * acc
    )
    second = 0.5 * context.torque_curvature(j, "qq") * x**2 + context.torque_curvature(j, "qv") * x * s
    second += 0.5 * context.torque_curvature(j, "vv") * s**2 + context.torque_curvature(j, "qa") * x * acc
    there = samples.rigid_torques(baseline.phi, Moved(q + x * FIRST, v + s * FIRST, a + acc * FIRST))
    there -= samples.rigid_torques(baseline.phi)
    assert np.abs(there - first - second).max() < 0.05 * np.abs(there - first).max()
    # The inertia behind a joint does not change with its own angle.
    np.testing.assert_allclose(context.torque_curvature(j, "qa")[:, j], 0.0, atol=1e-6)
    np.testing.assert_allclose(context.torque_curvature(j, "vv")[:, j], 0.0, atol=1e-6)


def test_a_lighter_link_has_a_softer_gear_for_the_same_swing(baseline: Baseline) -> None:
    less = np.linalg.lstsq(baseline.basis, -0.5 * baseline.phi, rcond=None)[0]
    light = baseline.with_fit(replace(baseline.fit, shared=baseline.fit.shared + less))
    old, new = Context(baseline), Context(light)
    before, after = (
        (c.perturbed_torques(0, more=1.0) - c.perturbed_torques(0))[:, 0].mean() for c in (old, new)
    )
    assert after < 0.7 * before
    over = JointElasticity().transfer_shape(old, new, "first", (80.0, 0.1))
    assert over == pytest.approx((80.0 * after / before, 0.1), rel=1e-6)


def test_play_as_wide_as_any_that_is_searched_is_a_gear_that_passes_for_it(baseline: Baseline) -> None:
    context, widest = Context(baseline), Backlash.searched[0].high
    widths = {
        width: SoftBacklash().is_within_scope(context, "first", (width, 6.0, 0.01), baseline.fit)
        for width in (0.05, widest)
    }
    assert widths == {0.05: True, widest: False}
