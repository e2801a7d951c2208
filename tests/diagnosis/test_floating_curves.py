"""Curves of a standing robot's trial differ by what a known fault of a force plate does to the wrench."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.diagnosis.floating.answer import trial_curves
from excite.diagnosis.floating.hypotheses import Placed, nominal_fit
from excite.diagnosis.floating.problem import build_problem
from excite.diagnosis.floating.record import prepare_record
from excite.diagnosis.floating.registry import FLOATING_EFFECTS
from excite.logs.files import load_log


def test_the_model_with_a_gain_is_off_by_what_the_gain_does(gap_dir: Path) -> None:
    record = prepare_record(load_log(gap_dir / "floating" / "case_013")).halve_rate()
    clean = build_problem(record)
    louder = record.readings["left_plate"] * np.array([1.0, 1.0, 1.1, 1.0, 1.0, 1.0])
    problem = build_problem(replace(record, readings=record.readings | {"left_plate": louder}))
    plain = replace(nominal_fit(problem), delta=np.zeros_like(nominal_fit(problem).delta))
    gain = Placed(FLOATING_EFFECTS["sensor_gain"], "left_plate.fz")
    gained = replace(plain, placed=(gain,), theta=(np.array([0.1]),), std=(np.array([0.0]),))
    curves = trial_curves(problem, plain, gained)
    chosen = record.trials.index(curves.trial)
    assert curves.validation and record.validation[chosen]
    span = record.spans[chosen]
    expected = problem.nominal.measured_forces[span] - clean.nominal.measured_forces[span]
    assert np.abs(expected[:, 2]).max() > 10.0
    np.testing.assert_allclose(curves.after - curves.before, expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(curves.measured, problem.nominal.measured_forces[span])
    assert len(curves.time) == len(expected) and curves.channels[2] == "fz"
