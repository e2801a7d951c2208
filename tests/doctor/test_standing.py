"""Simulated logs of a standing G1 made ill are named and mended; healthy ones raise no alarm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import excite
from excite.doctor.channel_mapping import Reading
from excite.doctor.doubt import Doubt
from excite.doctor.examine import Chart, examine
from excite.doctor.wrench_samples import wrench_samples
from excite.logs.log import Log, Trial
from excite.motion.collection import load_motions
from excite.robot.robot import Robot
from tests.doctor.standing_illnesses import STANDING_ILLNESSES

MOTIONS = Path(__file__).resolve().parents[2] / "motion_library" / "g1" / "motions"
# Turned wrenches of an exchanged foot are two mistakes, and both are said.
COMPANY = {"feet exchanged": {"wrench_order", "wrench_sign"}}


@pytest.fixture(scope="module")
def log(g1: Robot) -> Log:
    """True inertial parameters are off the model's; sensors have noise."""
    return excite.simulate(g1, load_motions(MOTIONS, g1)[::2], seed=5).log


@pytest.fixture(scope="module")
def examined(g1: Robot, log: Log) -> Callable[[str, int], Chart]:
    """What is found in the log made ill; several tests read of one illness."""
    return lru_cache(lambda name, strength: examine(g1, STANDING_ILLNESSES[name].change(log, strength)))


def spoiling(chart: Chart) -> set[str]:
    return {item.kind for item in chart.findings if item.severity in {"fatal", "spoils"}}


def test_a_healthy_log_raises_no_alarm(g1: Robot, log: Log) -> None:
    assert spoiling(examine(g1, log)) == set()


def test_wrenches_follow_a_joints_zero_and_gravity(g1: Robot, log: Log) -> None:
    """Of many readings made of a few motions, each is what it is by itself."""
    samples, reading = wrench_samples(g1, log), Reading.as_stated(log)
    assert samples is not None
    reading = reading.with_position(2, zero=0.2)
    angles = np.array([-2.9, -0.4, 0.0, 1.57])
    for joint in (0, 3, 20):
        alone = [samples.left(reading.with_position(joint, zero=float(angle))) for angle in angles]
        np.testing.assert_allclose(samples.by_zero(reading, joint)(angles), alone, atol=1e-9)
    pulls = 9.81 * np.array([[0.0, 0.0, -1.0], [0.6, 0.0, 0.8]])
    alone = [samples.left(replace(reading, gravity=pull)) for pull in pulls]
    np.testing.assert_allclose(samples.by_gravity(reading)(pulls), alone, atol=1e-9)


@pytest.mark.parametrize("strength", [0, pytest.param(1, marks=pytest.mark.battery)])
@pytest.mark.parametrize("name", STANDING_ILLNESSES)
def test_an_illness_is_named(examined: Callable[[str, int], Chart], name: str, strength: int) -> None:
    illness = STANDING_ILLNESSES[name]
    found = spoiling(examined(name, strength))
    assert illness.kind in found
    assert found <= COMPANY.get(name, {illness.kind})


@pytest.mark.parametrize("name", ["axes exchanged", "force unit", "base quaternion"])
def test_what_is_mended_is_the_healthy_log(
    examined: Callable[[str, int], Chart], log: Log, name: str
) -> None:
    mended = examined(name, 0).log
    for was, now in zip(log.trials, mended.trials, strict=True):
        assert was.base is not None and now.base is not None
        np.testing.assert_allclose(now.base, was.base, atol=1e-9)
        for sensor, wrench in was.wrenches.items():
            np.testing.assert_allclose(now.wrenches[sensor], wrench, atol=1e-6)


def test_a_weight_in_no_unit_is_said_and_left(g1: Robot, log: Log) -> None:
    heavy = replace(
        log,
        trials=tuple(
            replace(t, wrenches={name: 2.2 * w for name, w in t.wrenches.items()}) for t in log.trials
        ),
    )
    chart = examine(g1, heavy)
    (found,) = (item for item in chart.findings if item.kind == "wrench_unit")
    assert not found.repaired and found.figures["factor"] == pytest.approx(2.2, rel=0.2)
    assert chart.doubts == {Doubt.SIZE}
    sensor = next(iter(heavy.trials[0].wrenches))
    np.testing.assert_allclose(chart.log.trials[0].wrenches[sensor], heavy.trials[0].wrenches[sensor])


def test_noise_of_positions_is_no_unit_of_wrenches(g1: Robot, log: Log) -> None:
    """Accelerations that noise makes are larger than the weight, which is told by the mean."""
    rng, stated = np.random.default_rng(1), Reading.as_stated(log)

    def shaken(values: np.ndarray, by: float) -> np.ndarray:
        return values + by * rng.standard_normal(values.shape)

    def noisy(trial: Trial) -> Trial:
        assert trial.base is not None
        base = np.hstack([shaken(trial.base[:, :3], 0.03), trial.base[:, 3:]])
        return replace(trial, q=shaken(trial.q, 0.1), base=base)

    ratios = []
    for trials in (log.trials, tuple(map(noisy, log.trials))):
        samples = wrench_samples(g1, replace(log, trials=trials))
        assert samples is not None
        ratios.append(samples.weight_ratio(stated))
    assert ratios[1] == pytest.approx(ratios[0], rel=0.02)


def test_a_known_unit_leaves_no_doubt(examined: Callable[[str, int], Chart]) -> None:
    assert examined("force unit", 0).doubts == frozenset()


def test_no_mistake_of_a_logger_is_seen_in_postures_that_were_computed(g1: Robot, log: Log) -> None:
    """Joints that somebody fitted to named markers are not exchanged, whatever wrenches make of it."""
    turned = STANDING_ILLNESSES["position sign"].change(log, 1)
    assert "position_sign" in spoiling(examine(g1, turned))
    computed = replace(turned, header=turned.header.model_copy(update={"posture": "computed"}))
    assert not {"position_sign", "order", "zero_position", "degrees"} & spoiling(examine(g1, computed))
