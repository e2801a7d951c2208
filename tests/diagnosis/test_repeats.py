"""A floor of repeated trials is that of their noise, whenever the loggers were started."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import repeat_floor, spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.errors import LogError
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from excite.robot.loading import load_robot
from tests.diagnosis.two_joints import NOISE, moved, two_joint_log
from tests.made_log import made_log

RATE, REST, MOTION = 200.0, 1.5, 8.0
NOISE_Q, NOISE_TAU = 5e-5, 0.02
# Torque that no model here has [N·m], of which a floor of repeats must not know.
STRANGE = 2.0


def trial(name: str, waits: float, phase: float, rng: np.random.Generator) -> Trial:
    """A motion from rest to rest after a wait, with a torque at the fourth joint that repeats with the motion."""
    robot = load_robot("iiwa14")
    time = np.arange(round((waits + MOTION + REST) * RATE)) / RATE
    s = np.clip((time - waits) / MOTION, 0.0, 1.0)
    window = 16.0 * (s * (1.0 - s)) ** 2
    turns = np.array([1, 2, 3, 2, 4, 3, 5])
    q = 0.5 * window[:, None] * np.sin(2.0 * np.pi * turns * s[:, None] + phase * turns)
    v = np.gradient(q, 1.0 / RATE, axis=0)
    a = np.gradient(v, 1.0 / RATE, axis=0)
    data = robot.model.createData()
    tau = np.array([pin.rnea(robot.model, data, *row) for row in zip(q, v, a, strict=True)])
    tau[:, 3] += STRANGE * np.sin(40.0 * q[:, 3])
    return Trial(
        name=name,
        role="identification",
        time=time,
        q=q + NOISE_Q * rng.standard_normal(q.shape),
        tau=tau + NOISE_TAU * rng.standard_normal(q.shape),
    )


def record(later: float) -> Log:
    """Three trials, the last the first again with its logger started ``later`` [s] before the motion."""
    rng = np.random.default_rng(3)
    robot = load_robot("iiwa14")
    trials = (
        trial("a", REST, 0.0, rng),
        replace(trial("b", REST, 0.7, rng), role="validation"),
        trial("again", REST + later, 0.0, rng),
    )
    return made_log(
        trials,
        robot.joint_names,
        RATE,
        robot.urdf,
        modelled=["rigid_body_fixed"],
        trials=[
            {"file": "a.parquet", "role": "identification"},
            {"file": "b.parquet", "role": "validation"},
            {"file": "again.parquet", "role": "identification", "repeats": "a.parquet"},
        ],
    )


@pytest.mark.parametrize("later", [0.0, 0.0125, 0.73])
def test_the_floor_of_repeats_does_not_know_what_repeats(later: float) -> None:
    log = record(later)
    samples = arm_samples(load_robot("iiwa14"), log, log.trials)
    spectral = spectral_floor(samples)
    baseline = fit_baseline(samples, ("rigid_body_fixed",), spectral)
    residual = baseline.plain_residual(baseline.fit.residual)
    assert samples.repeat_pairs[0].lag_s == pytest.approx(later, abs=2e-4)
    assert np.sqrt((residual[3] ** 2).mean()) > 0.3 * STRANGE
    floor = repeat_floor(samples, residual)
    assert floor is not None
    assert floor[3] < 0.03 * STRANGE


def test_a_log_in_memory_is_the_log_that_is_saved(tmp_path) -> None:
    rng = np.random.default_rng(3)
    first, other = (
        replace(made, tau=made.tau + np.array([0.0, 0.3]) * np.abs(made.q[:, :1]))
        for made in (
            moved(name, role, 12.0, rng, np.eye(2))
            for name, role in (("a", "identification"), ("b", "validation"))
        )
    )
    again = replace(first, name="again", tau=first.tau + NOISE * rng.normal(size=first.tau.shape))
    trials = (first, other, again)
    alone = two_joint_log(trials)
    *others, entry = alone.header.trials
    entries = (*others, entry.model_copy(update={"repeats": "a.parquet"}))
    log = replace(alone, header=alone.header.model_copy(update={"trials": entries}))
    save_log(log, tmp_path / "log")
    read = load_log(tmp_path / "log")
    assert [t.repeats for t in log.trials] == [t.repeats for t in read.trials] == [None, None, "a"]
    here, there = (diagnose(x, nominal_robot(read)) for x in (log, read))
    assert here.gap.per_channel == there.gap.per_channel
    # A floor of repeats is another one than that of the spectrum.
    assert diagnose(alone, nominal_robot(read)).gap.per_channel != here.gap.per_channel


def test_a_trial_that_was_broken_off_is_named() -> None:
    log = record(0.0)
    short = log.trials[1].rows(np.arange(round(0.4 * RATE)))
    with pytest.raises(LogError, match=r"b: .* too short; leave the trial out"):
        diagnose(replace(log, trials=(log.trials[0], short, log.trials[2])), load_robot("iiwa14"))
