"""An arm that stands: encoders that tremble by a step are no motion, and no reading of channels ends in an error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.doctor.channel_mapping import Reading
from excite.doctor.examine import examine
from excite.doctor.torque_samples import torque_samples
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log, changed

STEP = 2.0 * np.pi / 2**13


def _trembling(q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.asarray(STEP * np.round(q[:1] / STEP + rng.integers(-2, 3, q.shape)))


def test_trembling_encoders_are_no_motion() -> None:
    robot, rng = load_robot("panda"), np.random.default_rng(1)
    standing = changed(arm_log(robot), lambda trial: replace(trial, q=_trembling(trial.q, rng)))
    chart = examine(robot, standing)
    assert [f.kind for f in chart.findings if f.severity == "fatal"] == ["nothing_moves"]


@pytest.mark.parametrize("tick", [1.0, 1e-9])
def test_what_likely_bodies_leave_of_accelerations_of_any_size(tick: float) -> None:
    """The reading of a standing arm with a clock in nanoseconds, as the error of a factorisation had it."""
    robot, rng = load_robot("panda"), np.random.default_rng(2)
    shaken = changed(
        arm_log(robot), lambda trial: replace(trial, tau=0.01 * rng.standard_normal(trial.q.shape))
    )
    samples, reading = torque_samples(robot, shaken), Reading.as_stated(shaken)
    assert samples is not None
    left = samples.judged(replace(reading, tick=tick))
    assert np.isfinite([*left.left, left.cost, *left.counts]).all() and (left.counts >= 1.0).all()
