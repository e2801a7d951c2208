"""The plain entries find a plain effect in a log, and the command writes what they say."""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import benchmarks.blind.arm_case
from benchmarks.blind.answers import read_entry
from benchmarks.blind.arm_case import arm_of
from benchmarks.blind.case import build_case
from benchmarks.blind.command import app
from benchmarks.blind.documents import HiddenEffect
from benchmarks.blind.draw import Draft
from benchmarks.blind.entry import mujoco_sysid
from benchmarks.blind.entry.alone import arm_log
from benchmarks.blind.entry.mujoco_sysid import TrialFit, fitted_by_sysid
from benchmarks.blind.make import load_answers
from excite.errors import LogError
from excite.logs.files import save_log
from excite.results import write_json
from excite.robot.loading import load_robot


@pytest.fixture(scope="module")
def biased(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, HiddenEffect]]:
    """A folder of one case, trials of three seconds, whose only effect is a torque's bias; and that effect."""
    folder = tmp_path_factory.mktemp("blind")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(benchmarks.blind.arm_case, "TRIAL_S", 3.0)
        plan = Draft("jaco2", "single", (("torque_bias", "plain"),), True, 1.0, (), False)
        log, answer = build_case(plan, np.random.default_rng(8))
    save_log(log, folder / "cases" / "case_000")
    document = {"schema": "excite.blind/1", "seed": 8, "cases": {"case_000": answer.to_json()}}
    write_json(document, folder / "cases-answers.json")
    yield folder, answer.effects[0]


def test_the_command_enters_and_scores_what_is_fitted_alone(biased: tuple[Path, HiddenEffect]) -> None:
    folder, hidden = biased
    cases, entry = str(folder / "cases"), folder / "alone"
    options = ["--method", "alone", "--jobs", "1", "--out", str(entry)]
    found = CliRunner().invoke(app, ["enter", cases, *options])
    assert found.exit_code == 0, found.output
    answer = json.loads((entry / "case_000.json").read_text())
    named = {(item["effect"], item["location"]) for item in answer["effects"]}
    assert named == {("torque_bias", hidden.location)}
    shares = {item["channel"]: item["share"] for item in answer["effects"]}
    # The noise is counted too; of the other joints a bias takes nothing.
    assert shares.pop(hidden.location) > 0.9
    assert max(abs(share) for share in shares.values()) < 0.1
    scored = CliRunner().invoke(app, ["score", cases, "--entry", str(entry), "--json"])
    figures = json.loads(scored.stdout)["figures"]
    assert (figures["single_named"], figures["single_placed"], figures["firm_wrong"]) == (1.0, 1.0, 0.0)
    assert figures["seconds_median"] > 0.0


def test_mujocos_own_toolbox_has_the_model_that_made_the_log(biased: tuple[Path, HiddenEffect]) -> None:
    sysid = importlib.import_module("mujoco.sysid")
    folder, hidden = biased
    log = arm_log(folder / "cases" / "case_000")
    fit = TrialFit(log, log.log.trials[0], sysid)
    parameters = fit.parameters()
    joints = log.robot.joint_names
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(benchmarks.blind.arm_case, "TRIAL_S", 3.0)
        drives = arm_of(load_robot("jaco2"), True, np.random.default_rng(8)).virtual.drives
    x = parameters.as_nominal_vector()
    for j, name in enumerate(joints):
        for what, value in (
            ("damping", drives.viscous[j]),
            ("frictionloss", drives.coulomb[j]),
            ("armature", drives.armature[j]),
        ):
            x[fit.where[f"{name}.{what}"]] = value
    wrong = fit.squares(x, parameters)
    x[fit.where[f"{hidden.location}.bias"]] = hidden.value
    right = fit.squares(x, parameters)
    # Mean squares of the torques over their variances: noise is a hundredth, a step of 2 ms costs a little more.
    rows = fit.residual(x, parameters)[0][0].size / (2 * len(joints))
    assert np.all(right[len(joints) :] < 0.01 * rows)
    at = len(joints) + joints.index(hidden.location)
    assert wrong[at] > 3.0 * right[at]


@pytest.mark.slow
def test_mujocos_own_toolbox_answers(
    biased: tuple[Path, HiddenEffect], monkeypatch: pytest.MonkeyPatch
) -> None:
    """However near it came: what an answer has to be does not depend on that."""
    monkeypatch.setattr(mujoco_sysid, "_ITERATIONS", 2)
    folder, _ = biased
    write_json(fitted_by_sysid(folder / "cases" / "case_000"), folder / "sysid" / "case_000.json")
    answers = load_answers(folder / "cases")
    (said,) = read_entry(folder / "sysid", answers).values()
    assert len(said.stated) <= 1
    assert all(0.0 <= share <= 1.0 for item in said.stated for share in item.shares.values())


def test_a_log_without_torques_is_refused_in_one_line(
    biased: tuple[Path, HiddenEffect], tmp_path: Path
) -> None:
    case = tmp_path / "case"
    case.mkdir()
    for file in (biased[0] / "cases" / "case_000").iterdir():
        (case / file.name).write_bytes(file.read_bytes())
    header = case / "log.yaml"
    header.write_text(header.read_text().replace("torque: motor_side", "torque: none"))
    with pytest.raises(LogError, match="no log of such an arm"):
        fitted_by_sysid(case)
