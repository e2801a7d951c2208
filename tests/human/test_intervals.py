"""Intervals of a person's segment masses hold the truth, also where one segment seems to explain all."""

from __future__ import annotations

import numpy as np
import pytest

import excite
from benchmarks.people.identified import identify_person
from benchmarks.virtual_person import simulate_person
from excite.human.measure import measure_person, write_person
from excite.human.segments import Subject

SUBJECT = Subject(70.0, 1.82, "male")
AT_NIGHT = pytest.mark.battery


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """A minute of a person whose segments all differ from the table's: true masses, the person, the log's folder."""
    folder = tmp_path_factory.mktemp("person")
    session = simulate_person(folder / "files", SUBJECT, seconds=60.0, seed=5)
    person = measure_person(SUBJECT, session.moving, session.standing)
    write_person(person, folder / "log")
    return session.masses, person, folder / "log"


@pytest.mark.slow
@pytest.mark.parametrize("method", [pytest.param("hqp", marks=AT_NIGHT), "lmi"])
def test_intervals_hold_the_truth_of_a_person_whose_segments_all_differ(method, measured):
    # Torso and pelvis explain 0.94 of what this person's table leaves; the others are no nearer to it for that.
    masses, person, folder = measured
    rows = identify_person(person, folder, method).table.rows
    off = np.array([(row.identified - masses[row.segment]) / row.std for row in rows])
    assert np.mean(np.abs(off) < 2.0) > 0.9
    assert np.sqrt(np.mean(off**2)) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize(
    "method", ["adaptive", "hqp", *(pytest.param(m, marks=AT_NIGHT) for m in ("lmi", "wls"))]
)
def test_too_few_instants_leave_the_tables_and_name_no_segment(method, person, tmp_path):
    """Five seconds, of which three and a half are identified from."""
    write_person(person, tmp_path / "log")
    found = excite.identify(tmp_path / "log" / "robot.yaml", tmp_path / "log", method)
    assert "too_few_instants" in {finding.kind for finding in found.findings}
    assert not found.changes.segments and "not looked for" in found.summary()
    inertial = found.identified.inertial
    np.testing.assert_array_equal(inertial, found.identified.nominal[: len(inertial)])
    # Never worse than the tables.
    assert all(fit.rmse <= fit.reference_rmse for fit in found.validation.values())
