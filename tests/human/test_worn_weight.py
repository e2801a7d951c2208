"""A weight that is worn: found without being told where or how heavy, and seen in the segments' masses."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.virtual_person import (
    Belt,
    draw_subject,
    perform_exercise,
    record_performance,
    record_standing,
    repeat_exercise,
    simulate_person,
)
from excite.cli.main import app
from excite.errors import InputError
from excite.human.identified import split_trials
from excite.human.segments import Subject
from excite.human.weights import AddedMass, Candidate
from tests.human.recordings import write_c3d


def candidate(segment: str, evidence: float) -> Candidate:
    return Candidate(segment, 2.0, 0.1, (0.0, 0.0, 0.0), 100.0, evidence)


def test_segments_that_look_alike_are_said_to():
    candidates = (candidate("pelvis", -1.0), candidate("torso", -3.5), candidate("head", -9.0))
    found = AddedMass(candidates, 500.0)
    assert found.tied_segments == ("pelvis", "torso") and "or torso, which look alike" in found.summary()
    clear = AddedMass((candidates[0], candidates[2]), 500.0)
    assert clear.tied_segments == ("pelvis",) and "next: head" in clear.summary()


def test_trials_with_and_without_a_weight_are_kept_apart(person):
    without, wearing = split_trials(person.log, 1)
    assert [trial.role for trial in without.trials] == ["identification"]
    assert wearing.trials[0].name == person.log.trials[-1].name and wearing.trials[0].role == "identification"
    with pytest.raises(InputError, match="give a trial without it"):
        split_trials(person.log, 2)


@pytest.mark.slow
def test_a_belt_is_found_from_files(tmp_path):
    rng = np.random.default_rng(12)
    who = draw_subject(rng)
    show = perform_exercise(who.body, 20.0, seed=4)
    belt = Belt("left_foot", 2.0, (0.05, 0.0, -0.03))
    base = record_performance(who, show, rng)
    loaded = record_performance(who, repeat_exercise(who.body, show, rng), rng, belt)
    static = replace(record_standing(who, rng), plates=base.plates)
    recordings = {"base": base, "belt": loaded, "standing": static}
    files = [write_c3d(recording, tmp_path / f"{name}.c3d") for name, recording in recordings.items()]
    out = tmp_path / "out"
    words = ["human", *map(str, files[:2]), "--static", str(files[2]), "--loaded", "1", "--identify", "qp"]
    words += ["--mass", "70", "--height", "1.82", "--sex", "male", "--out", str(out), "--json"]
    run = CliRunner().invoke(app, words)
    assert run.exit_code == 0, run.output
    document = json.loads(run.stdout)
    assert document["added_mass"]["segment"] == "left_foot"
    assert document["added_mass"]["mass_kg"] == pytest.approx(2.0, abs=0.5)
    assert document["worn_weight"]["mass_by_segments_kg"] == pytest.approx(2.0, abs=1.0)
    # The trial with the weight says nothing of the body without it.
    assert document["identification"]["total_mass"]["identified"] == pytest.approx(70.0, abs=1.2)
    header = (out / "with_weight" / "segments.csv").read_text().splitlines()[0]
    assert header == "segment,de_leva_kg,dumas_kg,stated_kg,identified_kg,std_kg"
    assert (out / "segment_masses.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_log_with_a_weight_is_not_sent_to_be_identified_as_if_there_were_none(tmp_path):
    subject = Subject(70.0, 1.82, "male")
    session = simulate_person(tmp_path, subject, seconds=10.0, seed=4, weight=("torso", 3.0))
    words = ["human", *map(str, (*session.moving, *session.wearing)), "--static", str(session.standing[0])]
    words += ["--mass", "70", "--height", "1.82", "--sex", "male", "--out", str(tmp_path / "out")]
    run = CliRunner().invoke(app, [*words, "--loaded", "1"])
    assert run.exit_code == 0 and "weight worn" in run.output and "then:" not in run.output
    plain = CliRunner().invoke(app, words)
    assert "then: excite identify" in plain.output
