"""From a plan's sheet to a log that was made by it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from typer.testing import CliRunner

import excite
from excite.campaign.capture import sheet_text
from excite.campaign.experiment import planned_roles
from excite.cli.main import app
from excite.conversion.capture_sheet import Capture, Run, read_capture
from excite.errors import InputError, LogError

pytestmark = pytest.mark.usefixtures("unexamined")

OFF = Run(name="zero_torque", kind="zero_torque", duration_s=10.0)


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan of two motions to identify from and one to validate on, of the library's."""
    folder = tmp_path_factory.mktemp("plan")
    robot = excite.load_robot("ur10")
    rng = np.random.default_rng(0)
    names = ("swing", "reach", "turn")
    time = np.arange(0.0, 8.0, 0.02)
    for name in names:
        w = rng.uniform(0.5, 2.0, robot.n_joints)
        q = robot.rest + 0.3 * np.sin(np.outer(time, w) + 1.0)
        table = {"time": time} | {f"q.{joint}": q[:, k] for k, joint in enumerate(robot.joint_names)}
        (folder / "motions").mkdir(exist_ok=True)
        rows = np.column_stack(list(table.values()))
        np.savetxt(
            folder / "motions" / f"{name}.csv", rows, delimiter=",", header=",".join(table), comments=""
        )
    document = {
        "schema": "excite.plan/1",
        "robot": "ur10",
        "candidates": {"generated": 3, "accepted": 3, "rejected": {}},
        "selected": [{"motion": f"motions/{n}.csv", "segments": [], "duration_s": 8.0} for n in names[:2]],
        "validation": [f"motions/{names[2]}.csv"],
        "conditioning": {"full": 10.0, "log_det": 1.0, "n_base_parameters": 36, "segments": []},
        "stages": [],
    }
    (folder / "plan.json").write_text(json.dumps(document))
    return folder


def recorded(plan: Path, folder: Path, run: str, motion: str, shift: float = 0.0, stop: float = 1.0) -> Path:
    """A recording of a motion, with torques that follow it, as a run of the sheet."""
    table = np.loadtxt(plan / "motions" / f"{motion}.csv", delimiter=",", skiprows=1)
    table = table[: int(stop * len(table))]
    time = np.arange(0.0, table[-1, 0], 0.001)
    q = np.column_stack([np.interp(time, table[:, 0], column) for column in table[:, 1:].T]) + shift
    names = ["t"] + [f"q{k + 1}" for k in range(6)] + [f"tau{k + 1}" for k in range(6)]
    file = folder / f"{run}.csv"
    np.savetxt(
        file, np.column_stack([time, q, 5.0 * np.cos(q)]), delimiter=",", header=",".join(names), comments=""
    )
    return file


def stood(
    plan: Path,
    folder: Path,
    run: str,
    motion: str,
    torque: float | None = None,
    start: dict[str, float] | None = None,
) -> Path:
    """A recording that stands where a motion begins or at other positions, by its gravity or with one torque at every
    joint."""
    file = recorded(plan, folder, run, motion)
    lines = file.read_text().splitlines()
    rows = np.repeat([[float(x) for x in lines[1].split(",")]], 10_000, axis=0)
    rows[:, 0] = 0.001 * np.arange(len(rows))
    if start is not None:
        rows[:, 1:7] = list(start.values())
        rows[:, 7:] = 5.0 * np.cos(rows[:, 1:7])
    rows[:, 1:7] += 1e-5 * np.random.default_rng(len(run)).normal(size=(len(rows), 6))
    if torque is not None:
        rows[:, 7:] = torque
    np.savetxt(file, rows, delimiter=",", header=lines[0], comments="")
    return file


def test_a_sheet_names_runs_repeats_and_what_to_record(plan, tmp_path):
    sheet = excite.capture(excite.load_robot("ur10"), plan, tmp_path / "sheet.md")
    text = sheet.path.read_text()
    read = read_capture(sheet.path)
    assert read == sheet.capture
    assert {run.kind for run in read.runs} == {"warm_up", "zero_torque", "motion", "static"}
    assert read.roles()["turn"] == "validation" and read.roles()["swing"] == "identification"
    assert read.repeats() == {"swing_again": "swing", "reach_again": "reach"}
    assert "Warm up" in text and "/joint_states" in text and "excite doctor" in text


def test_postures_that_are_held_load_the_joints_differently(plan, tmp_path):
    robot = excite.load_robot("ur10")
    sheet = excite.capture(robot, plan, tmp_path / "sheet.md").capture
    held = [run for run in sheet.runs if run.kind == "static"]
    data = robot.model.createData()
    loads = [
        pin.computeGeneralizedGravity(robot.model, data, np.array([*run.start.values()])) for run in held
    ]
    assert len(held) == 3
    for k, one in enumerate(loads):
        assert all(np.abs(one - other).max() > 1.0 for other in loads[:k])
        moved = excite.load_motions(plan / held[k].motion, robot)[0]
        row = int(np.argmin(np.abs(moved.time - moved.time[0] - held[k].at_s)))
        np.testing.assert_allclose(moved.q[row], [*held[k].start.values()], atol=1e-4)


def test_the_sheets_count_is_that_of_its_table(plan, tmp_path):
    sheet = excite.capture(excite.load_robot("ur10"), plan, tmp_path / "sheet.md")
    text = sheet.path.read_text()
    rows = [line for line in text.splitlines() if line.endswith("☐ |")]
    assert f"{len(rows)} runs in the order" in text and "3 motions, 2 of them again, 3 postures held" in text


def test_a_plan_without_a_motion_to_validate_on_gets_one(plan, tmp_path):
    document = json.loads((plan / "plan.json").read_text()) | {"validation": []}
    shutil.copytree(plan / "motions", tmp_path / "motions")
    (tmp_path / "plan.json").write_text(json.dumps(document))
    roles = excite.capture(excite.load_robot("ur10"), tmp_path).capture.roles()
    assert [roles["swing"], roles["reach"]] == ["identification", "validation"]


def test_commands_on_the_sheet_find_a_robot_of_ones_own_from_any_folder(plan, tmp_path):
    written = tmp_path / "own" / "robot.yaml"
    sheet = excite.capture(excite.load_robot("ur10"), plan, tmp_path / "sheet.md", named=str(written))
    text = sheet.path.read_text()
    assert f"excite check {written} motions/" in text and f"--robot {written} " in text
    assert (
        "excite check ur10 motions/"
        in excite.capture(excite.load_robot("ur10"), plan, tmp_path / "other.md").path.read_text()
    )


def test_logs_come_back_with_the_plans_roles(plan, tmp_path):
    sheet = excite.capture(excite.load_robot("ur10"), plan, tmp_path / "sheet.md")
    files = [
        recorded(plan, tmp_path, run.name, Path(run.motion).stem)
        if run.kind == "motion"
        else stood(plan, tmp_path, run.name, Path(run.motion).stem, start=run.start)
        for run in sheet.capture.logged
        if run.motion
    ]
    found = excite.convert(files, "ur10", tmp_path / "log", None, sheet.path)
    roles = {Path(trial.file).stem: (trial.role, trial.repeats) for trial in found.log.header.trials}
    assert roles == {
        "static_1": ("identification", None),
        "static_2": ("identification", None),
        "static_3": ("identification", None),
        "swing": ("identification", None),
        "reach": ("identification", None),
        "turn": ("validation", None),
        "swing_again": ("identification", "swing.parquet"),
        "reach_again": ("identification", "reach.parquet"),
    }
    assert "as the capture sheet asks" in found.notes


def test_runs_with_torques_off_or_cold_drives_are_no_part_of_the_log(plan, tmp_path):
    sheet = excite.capture(excite.load_robot("ur10"), plan, tmp_path / "sheet.md")
    files = [
        recorded(plan, tmp_path, "warm_up", "swing"),
        stood(plan, tmp_path, "zero_torque", "swing", torque=0.7),
        recorded(plan, tmp_path, "swing", "swing"),
        recorded(plan, tmp_path, "turn", "turn"),
    ]
    found = excite.convert(files, "ur10", tmp_path / "log", None, sheet.path)
    assert [Path(trial.file).stem for trial in found.log.header.trials] == ["swing", "turn"]
    notes = " ".join(found.notes)
    assert "zero_torque is left out of the log" in notes and "reads is +0.7 N·m" in notes
    assert "warm_up is left out of the log" in notes and "no run of the sheet" not in notes
    with pytest.raises(LogError, match="nothing belongs into a log"):
        excite.convert(files[:1], "ur10", tmp_path / "other", None, sheet.path)


def test_a_robot_that_stands_is_hung_up_before_its_torques_go_off(tmp_path):
    robot = excite.load_robot("g1")
    assert "hung up, torques off" in sheet_text(
        Capture(robot="g1", rate_hz=500.0, joints=robot.joint_names, runs=(OFF,)), robot, "g1"
    )


def test_what_differs_from_the_sheet_is_said(plan, tmp_path):
    sheet = excite.capture(excite.load_robot("ur10"), plan, tmp_path / "sheet.md")
    files = [
        recorded(plan, tmp_path, "swing", "swing", shift=0.5),
        recorded(plan, tmp_path, "turn", "turn", stop=0.5),
    ]
    notes = " ".join(excite.convert(files, "ur10", tmp_path / "log", None, sheet.path).notes)
    assert "not recorded: reach" in notes
    assert "swing begins" in notes and "turn lasts 4.0 s" in notes


def test_planned_roles_are_found_beside_motions(plan):
    roles = planned_roles([plan / "motions"])
    assert roles == {"swing": "identification", "reach": "identification", "turn": "validation"}
    assert planned_roles([plan / "motions" / "turn.csv"]) == roles


def test_a_plan_of_another_robot_and_no_sheet_are_one_line(plan, tmp_path):
    with pytest.raises(InputError, match="not of 'panda'"):
        excite.capture(excite.load_robot("panda"), plan)
    (tmp_path / "notes.md").write_text("nothing")
    with pytest.raises(LogError, match=r"notes\.md: is .nothing., not an object; write it by"):
        read_capture(tmp_path / "notes.md")


@pytest.mark.parametrize(
    ("motions", "roles"),
    [(["turn"], ["identification"]), (["swing", "turn"], ["identification", "validation"])],
)
def test_motions_that_judge_are_learnt_from_where_they_are_run_alone(plan, tmp_path, motions, roles):
    files = [str(plan / "motions" / f"{name}.csv") for name in motions]
    words = ["simulate", "ur10", *files, "--nominal", "--jobs", "1", "--out", str(tmp_path / "log")]
    assert CliRunner().invoke(app, words).exit_code == 0
    header = yaml.safe_load((tmp_path / "log" / "log.yaml").read_text(encoding="utf-8"))
    assert [trial["role"] for trial in header["trials"]] == roles
