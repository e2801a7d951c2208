"""Recordings of a virtual person as files: what `excite human` makes of them is what was put in."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.virtual_person import simulate_person
from excite.errors import InputError, UnknownNameError
from excite.human.measure import measure_person
from excite.human.segments import Subject

SUBJECT = Subject(58.0, 1.65, "female")


@pytest.mark.slow
def test_files_say_who_was_simulated_and_what_was_worn(tmp_path):
    session = simulate_person(tmp_path, SUBJECT, seconds=10.0, seed=3, weight=("torso", 4.0))
    assert sum(session.masses.values()) == pytest.approx(58.0)
    names = [path.name for path in (*session.standing, *session.moving, *session.wearing)]
    assert names == ["standing.trc", "moving.trc", "moving.mot", "wearing.trc", "wearing.mot"]
    person = measure_person(SUBJECT, [*session.moving, *session.wearing], session.standing)
    weights = [trial.plates_kg for trial in person.trials]
    assert weights == pytest.approx([58.0, 62.0], abs=0.5)
    # Cameras, skin and lengths are those of a person: not exact, and not wild.
    assert 1e-3 < person.calibration.rms < 6e-3
    # What is worn is noticed, and nothing else was odd.
    assert [found.kind for found in person.findings] == ["mass"]


def test_the_same_seed_gives_the_same_bytes_and_another_one_another_person(tmp_path):
    first, again, other = (
        simulate_person(tmp_path / name, SUBJECT, seconds=10.0, seed=seed)
        for name, seed in (("first", 1), ("again", 1), ("other", 2))
    )
    assert [path.read_bytes() for path in (*first.standing, *first.moving)] == [
        path.read_bytes() for path in (*again.standing, *again.moving)
    ]
    assert first.wearing == ()
    assert not np.allclose(list(first.masses.values()), list(other.masses.values()), rtol=0.02)


def test_what_nobody_can_do_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(InputError, match="seconds"):
        simulate_person(tmp_path / "out", SUBJECT, seconds=1.0)
    with pytest.raises(UnknownNameError, match="left_shank"):
        simulate_person(tmp_path / "out", SUBJECT, weight=("left_shin", 2.0))
    with pytest.raises(InputError, match="weight"):
        simulate_person(tmp_path / "out", SUBJECT, weight=("torso", -2.0))
    assert not (tmp_path / "out").exists()
