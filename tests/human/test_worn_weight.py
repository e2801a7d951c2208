"""A weight that is worn: found without being told where or how heavy, and seen in the segments' masses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.people.identified import added_mass, identify_person, identify_wearing, split_trials
from benchmarks.people.worn_weight import AddedMass, Candidate
from benchmarks.virtual_person import (
    Belt,
    draw_subject,
    perform_exercise,
    record_performance,
    record_standing,
    repeat_exercise,
)
from excite.errors import InputError
from excite.human.measure import measure_person, write_person
from excite.human.segments import Subject
from tests.human.recordings import write_c3d

pytestmark = pytest.mark.usefixtures("readers_here")


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
    trial, wearing, static = (
        write_c3d(item, tmp_path / f"{name}.c3d")
        for name, item in {"base": base, "belt": loaded, "standing": static}.items()
    )
    out = tmp_path / "out"
    person = measure_person(Subject(70.0, 1.82, "male"), [trial, wearing], [static])
    write_person(person, out)
    located = added_mass(out, 1)
    assert located.best.segment == "left_foot"
    assert located.best.mass == pytest.approx(2.0, abs=0.5)
    without = identify_person(person, out, "qp", loaded=1)
    # The trial with the weight says nothing of the body without it.
    assert without.identification.total_mass.identified == pytest.approx(70.0, abs=1.2)
    worn = identify_wearing(person, out, located, without, 1, "qp")
    assert worn.mass_by_segments_kg == pytest.approx(2.0, abs=1.0)
    header = (out / "with_weight" / "segments.csv").read_text().splitlines()[0]
    assert header == "segment,de_leva_kg,dumas_kg,stated_kg,identified_kg,std_kg"
