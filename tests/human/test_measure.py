"""A virtual person from files to identified segments: joint angles, plates, and every fault named."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from excite.cli.main import app
from excite.errors import LogError
from excite.human.ground_reaction import ReactionTable, ground_reactions
from excite.human.measure import MeasureSettings, measure_recordings, write_person
from excite.human.readers.registry import read_recording
from excite.human.segments import JOINT_NAMES
from excite.human.urdf import urdf_text
from excite.logs.files import load_log
from excite.logs.signals.butterworth import lowpass
from excite.robot.loading import load_robot
from tests.human.recordings import write_c3d, write_mot, write_trc
from tests.human.virtual_subject import ground_wrench, perform, true_model


@pytest.fixture(scope="module")
def person(session):
    return measure_recordings(session.who.body.subject, [session.trial], [session.static])


def measured(session, trial, **settings):
    subject = session.who.body.subject
    return measure_recordings(subject, [trial], [session.static], MeasureSettings(**settings))


def kinds(person) -> dict[str, str]:
    return {finding.kind: finding.text for finding in person.findings}


def test_dimensions_and_marker_residuals(session, person):
    true = session.who.body.dimensions
    found = person.calibration.dimensions
    assert np.abs(found.values - true.values).max() < 0.03
    assert person.calibration.rms < 0.006
    assert all(rms < 0.012 for rms in person.trials["virtual"]["marker_rms_m"].values())
    assert not person.findings


def test_joint_angles_follow_the_truth(session, person):
    log_q = np.concatenate([trial.q for trial in person.log.trials[:1]])
    time = person.log.trials[0].time
    frames = np.searchsorted(session.show.time, time - 1e-9)
    error = np.degrees(log_q - session.show.angles[frames])
    spread = dict(zip(JOINT_NAMES, error.std(axis=0), strict=True))
    for name in (
        "right_knee",
        "left_knee",
        "right_elbow",
        "left_elbow",
        "right_hip_flexion",
        "lumbar_bending",
    ):
        assert spread[name] < 3.0, name


def test_plates_carry_the_weight_under_the_right_feet(session, person):
    report = person.trials["virtual"]
    assert report["plates_kg"] == pytest.approx(70.0, rel=0.01)
    assert {plate["plate"]: plate["foot"] for plate in report["plates"]} == {
        "plate_right": "right_foot",
        "plate_left": "left_foot",
    }
    trial = person.log.trials[0]
    total = sum(trial.wrenches.values())
    assert total[:, 2].mean() == pytest.approx(70.0 * 9.81, rel=0.02)


def test_log_is_read_back_with_its_robot(person, tmp_path):
    write_person(person, tmp_path / "log")
    robot = load_robot(tmp_path / "log" / "robot.yaml")
    log = load_log(tmp_path / "log", robot)
    assert log.header.lowpass_hz == 6.0 and log.header.base_link == "pelvis"
    roles = [trial.role for trial in log.trials]
    assert roles == ["identification", "validation"]


def test_ground_reaction_of_the_true_body_is_that_of_inverse_dynamics(session, person, tmp_path):
    """True motion and parameters: both curves against pinocchio's, in the world, about a point of the ground."""
    body = session.who.body
    show = perform(session.who, 20.0, seed=8)
    wrench = ground_wrench(true_model(body), show)
    header = person.log.header
    plates = [np.array(sensor.xyz) for sensor in header.sensors]
    halves = [
        np.hstack([w[:, :3], w[:, 3:] - np.cross(p, w[:, :3])])
        for p, w in zip(plates, (0.3 * wrench, 0.7 * wrench), strict=True)
    ]
    wrenches = {sensor.name: half for sensor, half in zip(header.sensors, halves, strict=True)}
    trial = replace(person.log.trials[0], time=show.time, q=show.angles, base=show.base, wrenches=wrenches)
    alone = header.model_copy(update={"trials": header.trials[:1]})
    log = replace(person.log, header=alone, trials=(trial,), robot_text=urdf_text(body))
    write_person(replace(person, body=body, log=log), tmp_path / "log")
    robot = load_robot(tmp_path / "log" / "robot.yaml")
    (found,) = ground_reactions(robot, load_log(tmp_path / "log", robot), 0.9 * robot.nominal_parameters)
    about = np.hstack([wrench[:, :3], wrench[:, 3:] - np.cross(found.point, wrench[:, :3])])
    true = lowpass(about, 100.0, 6.0, 4)[np.searchsorted(show.time, found.time - 1e-9)]
    assert found.point[2] == 0.0
    assert np.abs(found.measured - true).max() < 1e-6
    assert (np.sqrt(np.mean((found.nominal - true) ** 2, axis=0)) < 0.5).all()
    assert found.identified == pytest.approx(0.9 * found.nominal, abs=1e-6)
    table = ReactionTable.of([found])
    fit = table.fits["identification"]["fz"]
    assert fit.rmse == pytest.approx(68.7, abs=1.0) and fit.reference_rmse < 0.5
    assert "GRFM y" in table.summary() and table.to_json()["identification"]["tx"]["unit"] == "N·m"


def test_one_command_from_c3d_to_a_table(session, tmp_path):
    trial = write_c3d(session.trial, tmp_path / "walk.c3d")
    static = write_c3d(replace(session.static, plates=session.trial.plates), tmp_path / "standing.c3d")
    out = tmp_path / "out"
    words = [
        "human",
        str(trial),
        "--static",
        str(static),
        "--mass",
        "70",
        "--height",
        "1.82",
        "--sex",
        "male",
    ]
    run = CliRunner().invoke(app, [*words, "--out", str(out), "--identify", "lmi", "--json"])
    assert run.exit_code == 0, run.output
    document = json.loads(run.stdout)
    assert document["schema"] == "excite.human/1"
    names = {item["segment"] for item in document["segments"]}
    assert len(names) == 15
    assert document["identification"]["total_mass"]["identified"] == pytest.approx(70.0, rel=0.02)
    lines = (out / "segments.csv").read_text().splitlines()
    assert lines[0] == "segment,de_leva_kg,dumas_kg,identified_kg,std_kg" and len(lines) == 16
    assert (out / "human_identified.osim").is_file() and (out / "human_identified.urdf").is_file()


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
    turned = replace(read, markers=read.turned(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])).markers)
    found = measured(session, turned)
    assert "millimetres" in kinds(found)["units"]
    assert found.trials["a"]["plates_kg"] == pytest.approx(70.0, rel=0.01)


@pytest.mark.slow
def test_points_of_application_in_millimetres_are_named_and_converted(session, tmp_path):
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    forces = read_recording(write_mot(session.trial, tmp_path / "a.mot", point_unit=1e-3)).turned(turn)
    found = measured(session, replace(session.trial, plates=forces.plates))
    assert "millimetres" in kinds(found)["units"]


def test_swapped_feet_are_named(session, tmp_path):
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    forces = read_recording(write_mot(session.trial, tmp_path / "a.mot", names=("L", "R"))).turned(turn)
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


@pytest.mark.slow
def test_running_generalises_better_than_the_generic_model(data_dir, tmp_path):
    """Rajagopal et al. 2016: strides left out on every axis, total mass within 1.5 % of 72.84 kg."""
    folder = data_dir / "human_running_rajagopal"
    out = tmp_path / "out"
    words = ["human", str(folder / "motion_capture_run.trc"), str(folder / "grf_run.mot")]
    words += ["--static", str(folder / "static_run.trc"), "--mass", "72.84", "--height", "1.80"]
    run = CliRunner().invoke(app, [*words, "--sex", "male", "--out", str(out), "--identify", "qp", "--json"])
    assert run.exit_code == 0, run.output
    document = json.loads(run.stdout)
    assert document["trials"][0]["plates_kg"] == pytest.approx(72.84, rel=0.015)
    found = document["identification"]
    assert found["total_mass"]["identified"] == pytest.approx(72.84, rel=0.015)
    for axis in ("fx", "fy", "fz"):
        fit = found["validation"][axis]
        assert fit["rmse"] < fit["reference_rmse"], axis


def test_a_person_on_a_plate_weighs_what_the_model_says(data_dir):
    """figaroh's recording of a person: mean vertical force against the model's 72.2 kg."""
    rows = np.genfromtxt(data_dir / "human_figaroh_forceplate_only" / "force_plate_wrench.csv", delimiter=",")
    rows = rows[np.isfinite(rows).all(axis=1)]
    assert rows[:, 2].mean() / 9.81 == pytest.approx(72.2, rel=0.01)


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
