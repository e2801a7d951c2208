"""What goes wrong in a motion laboratory: every fault named, and put right where it can be."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.virtual_person import write_mot, write_trc
from excite.cli.main import app
from excite.errors import LogError
from excite.human.measure import MeasureSettings, measure_recordings
from excite.human.recording_files import read_recording
from excite.human.segments import JOINT_NAMES, Subject
from tests.human.recordings import write_c3d

pytestmark = pytest.mark.usefixtures("solved_once", "readers_here")


def measured(session, trial, **settings):
    subject = session.who.body.subject
    return measure_recordings(subject, [trial], [session.static], MeasureSettings(**settings))


def kinds(person) -> dict[str, str]:
    return {finding.kind: finding.text for finding in person.findings}


@pytest.mark.slow
def test_gaps_are_bridged_and_named(session, person):
    trial = session.trial
    markers = {label: values.copy() for label, values in trial.markers.items()}
    for label in ("RKNEL", "RANKL"):
        markers[label][300:330] = np.nan
    gappy = measured(session, replace(trial, markers=markers))
    assert "RKNEL" in kinds(gappy)["gaps"]
    difference = joint_angles_of(gappy) - joint_angles_of(person)
    assert np.degrees(np.abs(difference[:, JOINT_NAMES.index("right_knee")]).max()) < 12.0


def joint_angles_of(person):
    return np.concatenate([trial.q for trial in person.log.trials[:1]])


@pytest.mark.slow
def test_exchanged_labels_are_put_back_and_named(session, person):
    trial = session.trial
    markers = {label: values.copy() for label, values in trial.markers.items()}
    span = slice(200, 260)
    markers["RKNEL"][span], markers["LKNEL"][span] = (
        trial.markers["LKNEL"][span],
        trial.markers["RKNEL"][span],
    )
    found = measured(session, replace(trial, markers=markers))
    text = kinds(found)["swapped_markers"]
    assert "RKNEL" in text and "LKNEL" in text
    assert int(text.split(" in ")[1].split()[0]) >= 45
    assert np.degrees(np.abs(joint_angles_of(found) - joint_angles_of(person))).max() < 3.0


def test_millimetres_called_metres_are_named_and_converted(session, tmp_path):
    trial = write_trc(session.trial, tmp_path / "a.trc", unit=1e-3, name="m")
    read = replace(read_recording(trial), plates=session.trial.plates)
    turned = replace(read, markers=read.turn_axes(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])).markers)
    found = measured(session, turned)
    assert "millimetres" in kinds(found)["units"]
    assert found.trials[0].plates_kg == pytest.approx(70.0, rel=0.01)


@pytest.mark.slow
def test_points_of_application_in_millimetres_are_named_and_converted(session, tmp_path):
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    forces = read_recording(write_mot(session.trial, tmp_path / "a.mot", point_unit=1e-3)).turn_axes(turn)
    found = measured(session, replace(session.trial, plates=forces.plates))
    assert "millimetres" in kinds(found)["units"]


def test_swapped_feet_are_named(session, tmp_path):
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    forces = read_recording(write_mot(session.trial, tmp_path / "a.mot", names=("L", "R"))).turn_axes(turn)
    found = measured(session, replace(session.trial, plates=forces.plates))
    text = kinds(found)["swapped_plates"]
    assert "plate_left lies under the right foot" in text


def test_plates_with_each_others_channels_are_named_and_put_back(session, tmp_path, person):
    read = read_recording(write_c3d(session.trial, tmp_path / "a.c3d", swap=True))
    found = measured(session, replace(session.trial, plates=read.plates))
    assert "plate_1 and plate_2 are swapped" in kinds(found)["swapped_plates"]
    for a, b in zip(found.log.trials, person.log.trials, strict=True):
        total = [sum(trial.wrenches.values())[:, :3] for trial in (a, b)]
        # The files end at different instants, and so do the filter's transients.
        assert total[0][:-40] == pytest.approx(total[1][:-40], abs=1.0)


def test_a_plate_without_load_and_missing_markers_are_named(session):
    plates = session.trial.plates
    dead = replace(plates[0], name="plate_3", force=0 * plates[0].force, moment=0 * plates[0].moment)
    markers = {
        label: values for label, values in session.trial.markers.items() if label not in ("RHND", "TOP")
    }
    found = measured(session, replace(session.trial, markers=markers, plates=(*plates, dead)))
    assert all(label in kinds(found)["missing_markers"] for label in ("RHND", "TOP"))
    assert "plate_3 carries no load" in kinds(found)["no_load"]
    assert len(found.log.header.sensors) == 2
    with pytest.raises(LogError, match="no force plate carries load"):
        measured(session, replace(session.trial, plates=(dead,)))


@pytest.mark.slow
def test_forces_on_the_plate_and_a_wrong_mass_are_named(session):
    turned = tuple(replace(p, force=-p.force, moment=-p.moment) for p in session.trial.plates)
    assert "turned round" in kinds(measured(session, replace(session.trial, plates=turned)))["reaction_sign"]
    heavy = replace(session.who.body.subject, mass=85.0)
    found = measure_recordings(heavy, [session.trial], [session.static])
    assert "the person weighs 85.0 kg" in kinds(found)["mass"]


@pytest.mark.slow
def test_a_foot_beside_the_plates_is_named_and_cut(session):
    plates = []
    for plate in session.trial.plates:
        force, moment = plate.force.copy(), plate.moment.copy()
        force[: len(force) // 4], moment[: len(moment) // 4] = 0.0, 0.0
        plates.append(replace(plate, force=force, moment=moment))
    found = measured(session, replace(session.trial, plates=tuple(plates)))
    assert "the rest is left out" in kinds(found)["unlogged_contact"]
    assert found.log.trials[0].time[0] > 1.0


def test_two_people_in_one_file_are_refused(session):
    markers = {f"{who}:{label}": v for who in ("Anna", "Ben") for label, v in session.trial.markers.items()}
    with pytest.raises(LogError, match="markers of 2 people: Anna, Ben"):
        measured(session, replace(session.trial, markers=markers))


def findings_of_the_command(words, tmp_path) -> dict[str, str]:
    """What ``excite human`` says is odd, from its JSON; every finding stands in the summary for a person too."""
    who = ["--mass", "70", "--height", "1.82", "--sex", "male", "--out", str(tmp_path / "out")]
    run = CliRunner().invoke(app, ["human", *map(str, words), *who, "--json"])
    assert run.exit_code == 0, run.output
    document = json.loads(run.stdout)
    return {finding["kind"]: finding["text"] for finding in document["findings"]}


def test_the_command_names_dead_and_swapped_plates_and_missing_markers_of_a_c3d(session, tmp_path):
    plates = session.trial.plates
    beside = np.array([1.0, 0.0, 0.0])
    dead = replace(
        plates[0], force=0 * plates[0].force, moment=0 * plates[0].moment, corners=plates[0].corners + beside
    )
    markers = {label: v for label, v in session.trial.markers.items() if label not in ("RHND", "TOP")}
    # Each plate's channels at the other's place: what it says of its own centre, about the other's.
    moved = []
    for plate, other in zip(plates, plates[::-1], strict=True):
        here, there = plate.corners.mean(axis=0), other.corners.mean(axis=0)
        moment = plate.moment + np.cross(there - here, plate.force)
        moved.append(replace(plate, moment=moment, corners=other.corners))
    trial = write_c3d(replace(session.trial, markers=markers, plates=(*moved, dead)), tmp_path / "walk.c3d")
    static = write_c3d(replace(session.static, plates=plates), tmp_path / "standing.c3d")
    found = findings_of_the_command([trial, "--static", static], tmp_path)
    assert "RHND" in found["missing_markers"] and "TOP" in found["missing_markers"]
    assert "plate_3 carries no load" in found["no_load"]
    assert "plate_1 and plate_2 are swapped" in found["swapped_plates"]


def test_the_command_names_millimetres_and_swapped_feet_of_trc_and_mot(session, tmp_path):
    trial = write_trc(session.trial, tmp_path / "walk.trc", unit=1e-3, name="m")
    forces = write_mot(session.trial, tmp_path / "walk.mot", names=("L", "R"))
    found = findings_of_the_command([trial, forces], tmp_path)
    assert "millimetres" in found["units"] and "walk.trc" in found["units"]
    assert "plate_left lies under the right foot" in found["swapped_plates"]


def mistaken(session, index: int, force: float = 1.0, lever: float = 1.0):
    """The trial with one plate whose readings are in other units: force and local moments times these factors."""
    plates = list(session.trial.plates)
    plate = plates[index]
    about = np.cross(plate.corners.mean(axis=0), plate.force)
    moment = force * (about + lever * (plate.moment - about))
    plates[index] = replace(plate, force=force * plate.force, moment=moment)
    return replace(session.trial, plates=tuple(plates))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force", "lever", "kind", "unit"),
    [
        (1.0 / 4.4482216152605, 1.0, "units", "pounds-force"),
        (1.0 / 9.80665, 1.0, "units", "kilograms-force"),
        (1e-3, 1.0, "units", "kilonewtons"),
        (1.0, 1e-3, "units", "N·m where the file's unit makes them N·mm"),
        (1.0, 1e3, "units", "N·mm where the file's unit makes them N·m"),
        (10.0, 1.0, "units", "tenths of newtons"),
        (0.01, 1.0, "units", "hundreds of newtons"),
        (1.0, 0.1, "units", "ten times too small"),
        (1.0, 100.0, "units", "a hundred times too large"),
        (1.0 / 4.4482216152605, 4.4482216152605, "units", "N·m beside forces in pounds-force"),
        (-1.0, 1.0, "reaction_sign", "turned round"),
    ],
)
@pytest.mark.parametrize("index", [0, 1])
def test_each_plate_is_judged_on_its_own(session, person, index, force, lever, kind, unit):
    found = measured(session, mistaken(session, index, force, lever))
    own, other = (session.trial.plates[k].name for k in (index, 1 - index))
    assert own in kinds(found)[kind] and unit in kinds(found)[kind] and other not in kinds(found)[kind]
    assert {finding.kind for finding in found.findings} - {finding.kind for finding in person.findings} == {
        kind
    }
    for a, b in zip(found.log.trials, person.log.trials, strict=True):
        for name, wrench in a.wrenches.items():
            np.testing.assert_allclose(wrench, b.wrenches[name], rtol=1e-6, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lever", "units"),
    [(1.3558179483314, ["pound-feet"]), (0.1129848290276, ["pound-inches", "ten times too large"])],
)
def test_moments_alone_are_in_pounds(session, person, lever, units):
    """Units that lie as near to each other as a body's moments are known are both named."""
    trial = session.trial
    for index in (0, 1):
        trial = mistaken(replace(session, trial=trial), index, 1.0, 1.0 / lever)
    found = measured(session, trial)
    assert all(unit in kinds(found)["units"] for unit in units)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("turned", "about"), [((0,), "plate"), ((1,), "plate"), ((0, 1), "plate"), ((0, 1), "origin")]
)
def test_plates_turned_about_the_vertical_are_turned_back(session, person, turned, about):
    half, plates = np.diag([-1.0, -1.0, 1.0]), list(session.trial.plates)
    for k in turned:
        plate = plates[k]
        at = plate.corners.mean(axis=0) if about == "plate" else np.zeros(3)
        moment = (plate.moment - np.cross(at, plate.force)) @ half + np.cross(at, plate.force @ half)
        plates[k] = replace(plate, force=plate.force @ half, moment=moment)
    found = measured(session, replace(session.trial, plates=tuple(plates)))
    said = {place for one in found.findings if one.kind == "turned_plate" for place in one.places}
    assert said == {session.trial.plates[k].name for k in turned}
    for a, b in zip(found.log.trials, person.log.trials, strict=True):
        for name, wrench in a.wrenches.items():
            np.testing.assert_allclose(wrench, b.wrenches[name], rtol=1e-6, atol=1e-3)


def split_in_three(plates):
    """The second plate as one below the heel and one below the toes, each with its part of every wrench."""
    first, second = plates
    middle = second.corners.mean(axis=0)
    vertical = np.where(second.force[:, 2] > 30.0, second.force[:, 2], np.inf)
    x, y = -second.moment[:, 1] / vertical, second.moment[:, 0] / vertical
    share = np.clip((x - middle[0]) / 0.12 + 0.5, 0.0, 1.0)
    halves = []
    for side, part in ((-1.0, 1.0 - share), (1.0, share)):
        point = np.column_stack([np.full_like(x, middle[0] + 0.06 * side), y, 0.0 * y])
        force = part[:, None] * second.force
        halves.append([point, force, part])
    rest = second.moment - sum(np.cross(point, force) for point, force, _ in halves)
    made = [first]
    for name, side, (point, force, part) in zip(("heel", "toes"), (-1.0, 1.0), halves, strict=True):
        inner = side * (second.corners[:, 0] - middle[0]) < 0.0
        corners = second.corners.copy()
        corners[inner, 0] = middle[0]
        made.append(
            replace(
                second,
                name=name,
                force=force,
                moment=np.cross(point, force) + part[:, None] * rest,
                corners=corners,
            )
        )
    return made


@pytest.fixture(scope="module")
def on_three_plates(session):
    """The person on three plates as they should be, by whether the file says where they are."""
    own = split_in_three(session.trial.plates)
    placed = {True: own, False: [replace(one, corners=None) for one in own]}
    return {
        known: measured(session, replace(session.trial, plates=tuple(some))) for known, some in placed.items()
    }


def posed(plate, turn=((1, 0, 0), (0, 1, 0), (0, 0, 1)), force=1.0, lever=1.0, by=(0.0, 0.0, 0.0)):
    """A plate as it reads that is turned about its middle, in other units, or stands elsewhere than is said."""
    middle, turned = plate.corners.mean(axis=0), force * plate.force @ np.transpose(turn)
    moment = force * lever * (plate.moment - np.cross(middle, plate.force)) @ np.transpose(turn)
    about = np.cross(middle + by, turned)
    return replace(plate, force=turned, moment=moment + about, corners=plate.corners + by)


QUARTER = ((0, -1, 0), (1, 0, 0), (0, 0, 1))


@pytest.mark.slow
@pytest.mark.parametrize("index", [0, 1, 2])
@pytest.mark.parametrize(
    ("fault", "kind", "with_places"),
    [
        # Moments of a table are about the origin, and not in a unit of the plate's own.
        ({"lever": 1e3}, "units", True),
        *(
            (fault, kind, with_places)
            for fault, kind in (
                ({"turn": QUARTER}, "turned_plate"),
                ({"force": 1.0 / 4.4482216152605}, "units"),
                ({"by": (0.5, 0.0, 0.0)}, "plate_place"),
                ({"by": (0.0, -0.5, 0.0)}, "plate_place"),
            )
            for with_places in (True, False)
        ),
    ],
)
def test_one_plate_of_three_is_mended(session, on_three_plates, fault, kind, index, with_places):
    """In C3D plates have places; tables have none."""
    own = split_in_three(session.trial.plates)
    plates = [posed(one, **fault) if i == index else one for i, one in enumerate(own)]
    if not with_places:
        plates = [replace(one, corners=None) for one in plates]
    healthy = on_three_plates[with_places]
    found = measured(session, replace(session.trial, plates=tuple(plates)))
    known = {one.kind for one in healthy.findings} | {"shared_plate"}
    said = {(one.kind, *one.places) for one in found.findings if one.kind not in known}
    assert said == {(kind, own[index].name)}
    for a, b in zip(found.log.trials, healthy.log.trials, strict=True):
        for name, wrench in a.wrenches.items():
            np.testing.assert_allclose(wrench[:, :3], b.wrenches[name][:, :3], rtol=1e-6, atol=1e-3)
    assert found.trials[0].plates_kg == pytest.approx(healthy.trials[0].plates_kg, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("turned", [{0}, {1}, {0, 1}])
def test_moments_that_count_the_other_way_are_turned_round(session, person, turned):
    plates = [posed(one, lever=-1.0) if i in turned else one for i, one in enumerate(session.trial.plates)]
    found = measured(session, replace(session.trial, plates=tuple(plates)))
    assert all(plates[i].name in kinds(found)["moments"] for i in turned)
    for a, b in zip(found.log.trials, person.log.trials, strict=True):
        for name, wrench in a.wrenches.items():
            np.testing.assert_allclose(wrench, b.wrenches[name], rtol=1e-6, atol=1e-3)


@pytest.mark.slow
def test_horizontal_forces_of_a_table_are_turned_about_their_points_of_application(session, person, tmp_path):
    up = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    plates = list(read_recording(write_mot(session.trial, tmp_path / "a.mot")).turn_axes(up).plates)
    vertical = np.where(plates[0].force[:, 2] > 5.0, plates[0].force[:, 2], np.inf)
    point = np.column_stack(
        [-plates[0].moment[:, 1] / vertical, plates[0].moment[:, 0] / vertical, np.zeros(len(vertical))]
    )
    free = plates[0].moment - np.cross(point, plates[0].force)
    force = plates[0].force @ np.transpose(QUARTER)
    turned = replace(plates[0], force=force, moment=np.cross(point, force) + free)
    twisted = replace(plates[0], moment=np.cross(point, plates[0].force) + 1e3 * free)
    for wrong, kind in ((turned, "turned_plate"), (twisted, "units")):
        found = measured(session, replace(session.trial, plates=(wrong, plates[1])))
        assert {one.places for one in found.findings if one.kind == kind} == {(plates[0].name,)}
        assert found.trials[0].plates_kg == pytest.approx(person.trials[0].plates_kg, rel=1e-3)


@pytest.mark.slow
def test_moments_about_the_laboratory_are_judged_as_well(session):
    """Tables without the plates' places have them about the origin."""
    plates = [replace(plate, corners=None) for plate in session.trial.plates]
    plates[1] = replace(plates[1], moment=1e-3 * plates[1].moment)
    text = kinds(measured(session, replace(session.trial, plates=tuple(plates))))["units"]
    assert f"moments of {plates[1].name} are N·m where" in text and plates[0].name not in text


@pytest.mark.slow
def test_a_plate_that_is_only_touched_has_no_centre_of_pressure(session, person):
    """Thirty newtons at a plate, of a table that does not say where plates are."""
    plates = [replace(one, corners=None) for one in session.trial.plates]
    push = np.tile([0.0, 0.0, 30.0], (len(plates[0].time), 1))
    touched = replace(plates[0], name="touched", force=push, moment=0.0 * push)
    found = measured(session, replace(session.trial, plates=(*plates, touched)))
    assert found.trials[0].plates_kg == pytest.approx(person.trials[0].plates_kg + 30.0 / 9.81, rel=0.01)


def test_plates_as_they_should_be_are_left_alone(session, person):
    assert not {"units", "moments", "reaction_sign", "turned_plate"} & {
        finding.kind for finding in person.findings
    }


@pytest.mark.parametrize(
    ("case", "file", "said"),
    [
        ("c19_plate_moments", "walk.c3d", "moments of plate_1 are N·m"),
        ("c23_one_plate_turned", "flip_one.c3d", "vertical forces of plate_1 point down"),
        ("c25_plates_in_pounds", "walk.c3d", "forces of plate_2 are pounds-force"),
    ],
)
def test_plates_of_stored_recordings_are_put_right(case, file, said):
    path = Path(__file__).resolve().parents[3] / "shared" / "cases" / case / file
    if not path.exists():
        pytest.skip("no recordings here")
    found = measure_recordings(Subject(mass=70.0, height=1.82, sex="male"), [read_recording(path)])
    assert any(said in finding.text for finding in found.findings)
    assert found.trials[0].plates_kg == pytest.approx(70.6, abs=0.1)
    assert found.trials[0].seconds == pytest.approx(5.0, abs=0.1)
