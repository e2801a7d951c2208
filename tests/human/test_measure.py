"""A virtual person from files to identified segments: joint angles, plates, ground reaction, tables."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.people.ground_reaction import ReactionTable, ground_reactions
from benchmarks.virtual_person import ground_wrench, perform_exercise, true_model
from excite.cli.main import app
from excite.human.measure import urdf_text, write_person
from excite.human.plates import foot_line
from excite.human.segments import JOINT_NAMES, Placement
from excite.logs.files import load_log
from excite.logs.signals.butterworth import lowpass
from excite.robot.loading import load_robot
from tests.human.recordings import write_c3d

pytestmark = pytest.mark.usefixtures("readers_here")


def test_dimensions_and_marker_residuals(session, person):
    true = session.who.body.dimensions
    found = person.calibration.dimensions
    assert np.abs(found.values - true.values).max() < 0.03
    assert person.calibration.rms < 0.006
    assert all(rms < 0.012 for rms in person.trials[0].marker_rms_m.values())
    assert not person.findings


def test_a_foot_reaches_from_its_heel_to_its_toe(session):
    body, n = session.who.body, 2
    placement = Placement(np.tile(np.eye(3), (n, 15, 1, 1)), np.zeros((n, 15, 3)))
    heel, toe = foot_line(placement, "left", body).transpose(1, 0, 2)
    d = body.dimensions
    np.testing.assert_allclose(toe - heel, np.tile([d.foot_length, 0.0, 0.0], (n, 1)))
    np.testing.assert_allclose(heel, np.tile([-d.heel, 0.0, -d.ankle_height], (n, 1)))


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
    report = person.trials[0]
    assert report.plates_kg == pytest.approx(70.0, rel=0.01)
    assert {plate.plate: plate.foot for plate in report.plates} == {
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
    show = perform_exercise(session.who.body, 20.0, seed=8)
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
    assert "GRFM y" in table.summary() and table.fits["identification"]["tx"].unit == "N·m"


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
    run = CliRunner().invoke(app, [*words, "--out", str(out), "--json"])
    assert run.exit_code == 0, run.output
    document = json.loads(run.stdout)
    assert document["schema"] == "excite.human/1"
    names = {item["segment"] for item in document["segments"]}
    assert len(names) == 15
    words = ["identify", str(out / "robot.yaml"), str(out), "--method", "lmi", "--out", str(out), "--json"]
    run = CliRunner().invoke(app, words)
    assert json.loads(run.stdout)["total_mass"]["identified"] == pytest.approx(70.0, rel=0.02)
    assert (out / "identified.urdf").is_file()


@pytest.mark.slow
def test_running_generalises_better_than_the_generic_model(data_dir, tmp_path):
    """Rajagopal et al. 2016: strides left out on every axis, total mass within 1.5 % of 72.84 kg."""
    folder = data_dir / "human_running_rajagopal"
    out = tmp_path / "out"
    words = ["human", str(folder / "motion_capture_run.trc"), str(folder / "grf_run.mot")]
    words += ["--static", str(folder / "static_run.trc"), "--mass", "72.84", "--height", "1.80"]
    run = CliRunner().invoke(app, [*words, "--sex", "male", "--out", str(out), "--json"])
    assert run.exit_code == 0, run.output
    document = json.loads(run.stdout)
    assert document["trials"][0]["plates_kg"] == pytest.approx(72.84, rel=0.015)
    words = ["identify", str(out / "robot.yaml"), str(out), "--method", "qp", "--json"]
    found = json.loads(CliRunner().invoke(app, words).stdout)
    assert found["total_mass"]["identified"] == pytest.approx(72.84, rel=0.015)
    for axis in ("fx", "fy", "fz"):
        fit = found["validation"][axis]
        assert fit["rmse"] < fit["reference_rmse"], axis


def test_a_person_on_a_plate_weighs_what_the_model_says(data_dir):
    """figaroh's recording of a person: mean vertical force against the model's 72.2 kg."""
    rows = np.genfromtxt(data_dir / "human_figaroh_forceplate_only" / "force_plate_wrench.csv", delimiter=",")
    rows = rows[np.isfinite(rows).all(axis=1)]
    assert rows[:, 2].mean() / 9.81 == pytest.approx(72.2, rel=0.01)
