"""``excite identify --bounds``: kept, reported, refused in one line, and contradictory ones end with 3."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from excite.cli import main as command_line
from excite.logs.files import save_log
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log

HEADER = "schema: excite.physical_bounds/1\n"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short log of a UR10 whose links are off from the model."""
    made = arm_log(load_robot("ur10"), 0, trials=2, duration=5.0)
    return save_log(replace(made, robot_text="<robot/>"), tmp_path_factory.mktemp("bounds") / "log")


@pytest.fixture
def excite(monkeypatch, capsys, log):
    """Run ``excite identify ur10 LOG …``; exit code, stdout and stderr."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["excite", "identify", "ur10", str(log), *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            command_line.main()
        said = capsys.readouterr()
        return int(ended.value.code or 0), said.out, said.err

    return run


def written(folder: Path, text: str) -> Path:
    path = folder / "bounds.yaml"
    path.write_text(HEADER + text, encoding="utf-8")
    return path


def inertia_about_com(entry: dict) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia about it, from the document's block of a link."""
    mass, first = entry["mass"], np.array(entry["first_moment"])
    xx, yy, zz, xy, xz, yz = entry["inertia"]
    about_joint = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    center = first / mass
    return mass, center, about_joint - mass * (center @ center * np.eye(3) - np.outer(center, center))


@pytest.mark.parametrize("method", ["physical", "cls1", "cls2", "cls3"])
def test_bounds_hold_and_those_reached_are_named(excite, tmp_path, method):
    """The forearm is bounded to half of what the data want; the document says that it lies at the bound."""
    path = written(
        tmp_path,
        "links:\n  forearm_link: {m: [1.0, 1.5], cx: [-0.01, 0.01]}\n"
        "  wrist_1_link: {cy: [0.0, 1e-2]}\ndrives:\n  viscous.elbow_joint: [0.0, 0.01]\n",
    )
    out = tmp_path / "out"
    code, _, said = excite("--method", method, "--bounds", path, "--json", "--out", out)
    assert code == 0, said
    document = json.loads((out / "identification.json").read_text())
    mass, center, _ = inertia_about_com(document["standard_parameters"]["forearm_link"])
    assert 1.0 - 1e-6 <= mass <= 1.5 + 1e-6 and abs(center[0]) <= 0.01 + 1e-6
    _, center, _ = inertia_about_com(document["standard_parameters"]["wrist_1_link"])
    assert -1e-6 <= center[1] <= 0.01 + 1e-6
    assert document["drive_parameters"]["viscous.elbow_joint"] <= 0.01 + 1e-9
    assert document["bounds"]["stated"] == 4 and document["bounds"]["outside"] == []
    assert "viscous.elbow_joint" in [entry["parameter"] for entry in document["bounds"]["at_bound"]]
    assert (document["certificate"] is not None) == (method == "physical")


def test_the_certificate_is_printed_and_written(excite, tmp_path):
    """Tighter bounds cannot lower the objective, and the proof of the looser ones holds for the tighter."""
    objectives = []
    for upper in (4.0, 0.8):
        path = written(tmp_path, f"links: {{upper_arm_link: {{m: [0.5, {upper}], cx: [-0.02, 0.02]}}}}\n")
        out = tmp_path / str(upper)
        code, said, _ = excite("--method", "physical", "--bounds", path, "--out", out)
        assert code == 0
        certificate = json.loads((out / "identification.json").read_text())["certificate"]
        assert certificate["lower_bound"] <= certificate["objective"]
        gap = 1.0 - certificate["lower_bound"] / certificate["objective"]
        assert certificate["gap"] == pytest.approx(gap, abs=1e-12) and gap <= 1e-3
        assert f"certificate: objective {certificate['objective']:.4g}, proven not to go below" in said
        objectives.append(certificate)
    assert objectives[1]["objective"] > objectives[0]["lower_bound"]


def test_an_untouched_template_changes_nothing(excite, tmp_path):
    path = tmp_path / "template.yaml"
    code, said, _ = excite("--bounds-template", path)
    assert code == 0 and said.startswith(f"wrote {path}\nthen: excite identify ur10 ")
    plain, given = (
        json.loads(excite("--method", "physical", "--json", *more)[1]) for more in ([], ["--bounds", path])
    )
    assert given["certificate"]["objective"] == pytest.approx(plain["certificate"]["objective"], rel=1e-3)
    assert given["bounds"]["stated"] == 6 * 10 + 1 and plain["bounds"] is None
    document = yaml.safe_load(path.read_text())
    nominal = plain["standard_parameters"]
    for link, entries in document["links"].items():
        assert entries["m"][0] < nominal[link]["nominal_mass"] < entries["m"][1]


@pytest.mark.parametrize(
    ("text", "field", "remedy"),
    [
        ("links: {elbow_link: {m: [1, 2]}}", "links.elbow_link.m", "forearm_link"),
        ("links: {forearm_link: {mass: [1, 2]}}", "links.forearm_link.mass", "m, cx, cy"),
        ("links: {forearm_link: {m: [3, 2]}}", "links.forearm_link.m", "lower one below the upper"),
        ("links: {forearm_link: {m: [.nan, 2]}}", "links.forearm_link.m", "give a number"),
        ("links: {forearm_link: {m: [1, .inf]}}", "links.forearm_link.m", "write numbers up to"),
        ("links: {forearm_link: {m: 2}}", "links.forearm_link.m", "[lower, upper]"),
        ("links: {forearm_link: {m: [1, 2, 3]}}", "links.forearm_link.m", "[lower, upper]"),
        ("links: {forearm_link: {m: [true, 2]}}", "links.forearm_link.m", "[lower, upper]"),
        ("links: {forearm_link: {m: [-2, -1]}}", "links.forearm_link.m", "positive"),
        ("links: {forearm_link: [1, 2]}", "links.forearm_link", "m: [lower, upper]"),
        ("links: [1, 2]", "links", "NAME"),
        ("drives: {viscous.joint9: [0, 1]}", "viscous.joint9", "elbow_joint"),
        ("drives: {friction.elbow_joint: [0, 1]}", "friction.elbow_joint", "viscous"),
        ("total_mass: [heavy, 2]", "total_mass", "[lower, upper]"),
        ("rules: {diagonal_ratio: -1}", "rules.diagonal_ratio", "positive"),
        ("rules: {slender: {elbow: x}}", "rules.slender.elbow", "forearm_link"),
        ("bodies: {}", "bodies", "links"),
        ("links: {}", "bounds nothing", "give links"),
        ("links: {a: [", "is not valid YAML", "mend"),
    ],
)
def test_a_bad_file_is_one_line_with_file_field_and_remedy(excite, tmp_path, text, field, remedy):
    path = written(tmp_path, text + "\n")
    code, said, error = excite("--method", "physical", "--bounds", path)
    assert code == 4 and said == "" and error.count("\n") == 1
    assert str(path) in error and field in error and remedy in error


def test_a_missing_file_and_a_method_without_bounds_are_refused(excite, tmp_path):
    code, _, error = excite("--method", "physical", "--bounds", tmp_path / "none.yaml")
    assert code == 4 and "none.yaml: no such file" in error
    path = written(tmp_path, "total_mass: [20, 40]\n")
    code, _, error = excite("--method", "wls", "--bounds", path)
    assert code == 4 and error.startswith("excite: ") and error.count("\n") == 1
    assert f"{path}: bounds: is not used by method 'wls'" in error and "cls1, cls2, cls3, physical" in error


@pytest.mark.parametrize("method", ["physical", "cls1", "cls2", "cls3"])
def test_contradictory_bounds_end_with_3_and_the_best_point(excite, tmp_path, method):
    """No forearm of less than 2 kg in a robot of more than 60 kg whose other links are below 5 kg each."""
    links = load_robot("ur10").segments
    lines = [f"  {segment.link}: {{m: [0.5, 5.0]}}" for segment in links]
    path = written(tmp_path, "total_mass: [60, 70]\nlinks:\n" + "\n".join(lines) + "\n")
    out = tmp_path / "out"
    code, said, error = excite("--method", method, "--bounds", path, "--out", out)
    assert code == 3 and error.count("\n") == 1
    document = json.loads((out / "identification.json").read_text())
    assert document["solved"] is False and "NO SOLUTION" in said
    values = [value for entry in document["standard_parameters"].values() for value in entry["first_moment"]]
    assert np.isfinite(values).all()
    assert not (out / "identified.urdf").exists()
    if method == "physical":
        assert "total_mass" in error
        total = sum(entry["mass"] for entry in document["standard_parameters"].values())
        assert 30.0 <= total < 60.0
