"""A size that is another in every trial is said to be, with how far it goes; one that lasts is not."""

from __future__ import annotations

import numpy as np
import pytest

from excite.diagnosis.budget.made import sizes_by_trial
from excite.diagnosis.budget.record import fit_initial_baseline
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.selection.found import build_gap_model
from excite.finding import Finding
from excite.logs.files import load_log, save_log
from excite.logs.log import Trial
from excite.logs.robot import nominal_robot
from tests.diagnosis.two_joints import moved, two_joint_log

ROLES = ("identification", "identification", "identification", "validation")


def _found(folder, factors: tuple[float, ...], shape: str) -> tuple[Finding, ...]:
    rng = np.random.default_rng(5)
    trials = []
    for k, (role, factor) in enumerate(zip(ROLES, factors, strict=True)):
        made = moved(f"trial_{k}", role, 15.0, rng, np.eye(2))
        assert made.tau is not None
        v = np.gradient(made.q[:, 1], made.time)
        more = np.zeros_like(made.tau)
        more[:, 1] = factor * {"constant": np.ones_like(v), "dry": np.sign(v)}[shape]
        trials.append(Trial(name=made.name, role=role, time=made.time, q=made.q, tau=made.tau + more))
    log = load_log(save_log(two_joint_log(tuple(trials)), folder))
    samples = arm_samples(nominal_robot(log), log, log.trials)
    floor = spectral_floor(samples)
    full = fit_initial_baseline(samples, log.header.modelled, floor)
    found = build_gap_model(
        full, log.header.modelled, tuple(EFFECTS.values()), floor, None, np.random.default_rng(0)
    )
    return sizes_by_trial(found.model, found.prediction.context, found.baseline.strict, floor)


@pytest.mark.parametrize(
    ("factors", "shape", "said"),
    [
        ((0.3, -0.3, 0.3, -0.3), "constant", "constant torque at second differs between trials"),
        ((0.3, -0.3, 0.3, -0.3), "dry", "dry friction at second differs between trials"),
        ((0.3, 0.3, 0.3, 0.3), "constant", ""),
    ],
)
def test_what_differs_from_trial_to_trial_is_said_with_its_size(
    tmp_path, factors: tuple[float, ...], shape: str, said: str
) -> None:
    findings = _found(tmp_path / "log", factors, shape)
    if not said:
        assert findings == ()
        return
    (finding,) = findings
    assert said in finding.text
    sizes = [finding.figures[f"trial_{k}.more"] for k in range(4)]
    assert np.ptp(sizes) == pytest.approx(0.6, rel=0.1)
    assert np.sign(np.diff(sizes)).tolist() == [-1.0, 1.0, -1.0]
