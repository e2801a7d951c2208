"""Pages as a roboticist reads them: units, one clock, figures that do not contradict each other, commands that work."""

from __future__ import annotations

import doctest
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from excite.provenance import made_by
from excite.report import html
from excite.report.comparisons import Record, load_report_data, save_report_data
from excite.report.html import html_table
from excite.report.page import report
from excite.report.sections.motions import show_moving
from excite.results import write_json
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log
from tests.report.sample import sample_folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return sample_folder(tmp_path_factory.mktemp("results"), load_robot("ur10"), n_motions=2)


def plain(page: str) -> str:
    return re.sub(r"[\s|]+", " ", re.sub(r"<[^>]+>", "|", page))


def test_curves_begin_when_their_trial_does(folder: Path, tmp_path: Path) -> None:
    """A record's clock may start anywhere; the same trial in motion begins at zero."""
    late = sample_folder(tmp_path / "late", load_robot("ur10"), n_motions=2)
    data = load_report_data(late / "report_data.npz")
    assert data.forces is not None
    shifted = replace(data.forces, time=data.forces.time + 840.0)
    save_report_data(replace(data, forces=shifted, path=None), late / "report_data.npz")
    islands = [
        re.search(r'id="forces-plots-data">(.*?)</script>', report(one, tmp_path).read_text())[1]
        for one in (folder, late)
    ]
    first, second = (json.loads(island)["time"]["low"] for island in islands)
    assert abs(second[0] - first[0]) < 1.0


def test_errors_have_units(folder: Path, tmp_path: Path) -> None:
    document = json.loads((folder / "campaign.json").read_text())["identification"]
    for row in document["validation"].values():
        row["unit"] = "N·m"
    write_json(document, tmp_path / "identification.json")
    text = plain(report(tmp_path).read_text(encoding="utf-8"))
    assert "channel unit RMSE nominal RMSE identified change correlation nominal" in text
    assert re.search(r"[a-z] N·m [\d.]+ [\d.]+ ", text)


def test_a_campaign_is_resumed_with_what_it_was_begun_with(folder: Path, tmp_path: Path) -> None:
    document = json.loads((folder / "campaign.json").read_text())
    with made_by("excite campaign g1 --candidates 40 --max-iterations 2 --seed 3", "0.1.0", 3):
        write_json(document, tmp_path / "campaign.json")
        write_json(document["identification"], tmp_path / "identification.json")
    text = plain(report(tmp_path).read_text(encoding="utf-8"))
    n = 2 * len(document["iterations"])
    command = f"excite campaign g1 --candidates 40 --seed 3 --max-iterations {n} --resume --out {tmp_path}"
    assert command in text
    # What one command made at once stands in one line.
    assert text.count("made by") == 1 and "identification.json and campaign.json made by" in text


def test_negative_numbers_have_a_minus() -> None:
    assert ">−31<" in html_table(("closes",), [(-31,)]) and 'data-v="-31"' in html_table(
        ("closes",), [(-31,)]
    )


def test_a_simulator_that_runs_away_is_not_shown(folder: Path) -> None:
    robot = load_robot("ur10")
    log = arm_log(robot, 1, trials=2, duration=4.0)
    data = load_report_data(folder / "report_data.npz")
    assert data.path is not None
    away = replace(data.path, trial=log.trials[0].name, nominal=data.path.measured + 1e5)
    findings = SimpleNamespace(
        record=Record(robot, log), data=replace(data, path=away), diagnosis={"effects": []}
    )
    page = "".join(show_moving(findings))  # type: ignore[arg-type]
    assert "runs away by more than half a turn" in page and "the simulator as it was" not in page


def test_a_mass_that_is_right_is_not_off_by_minus_nothing(folder: Path, tmp_path: Path) -> None:
    data = load_report_data(folder / "report_data.npz")
    assert data.masses is not None
    near = replace(data.masses, true=data.masses.identified * (1.0 + 1e-7))
    write_json(json.loads((folder / "plan.json").read_text()), tmp_path / "plan.json")
    save_report_data(replace(data, masses=near), tmp_path / "report_data.npz")
    assert "(0.00 %)" in plain(report(tmp_path).read_text(encoding="utf-8"))
    told = np.full(len(near.names), 0.1)
    save_report_data(
        replace(data, masses=replace(near, true=None, determined=told)), tmp_path / "report_data.npz"
    )
    assert "not all of it is told by the data" in plain(report(tmp_path).read_text(encoding="utf-8"))


# Numbers and cells as a reader sees them.


def test_examples_in_docstrings():
    assert doctest.testmod(html).failed == 0


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.00123, "−0.00123"),
        (99999.0, "99999"),
        (123456.0, "1.23 · 10⁵"),
        (-2.5e-7, "−2.50 · 10⁻⁷"),
        (float("nan"), "–"),
    ],
)
def test_numbers(value, text):
    assert html.format_number(value) == text


def test_text_is_escaped_and_numeric_columns_stand_right():
    page = html.html_table(("<name>", "value"), [("a & b", 1.0), ("c", None)])
    assert "&lt;name&gt;" in page and "a &amp; b" in page and "<name>" not in page
    assert page.count('class="number"') == 3


def test_commands_in_a_sentence_are_typed() -> None:
    assert (
        html.html_paragraph("`excite diagnose` tells < more")
        == "<p><code>excite diagnose</code> tells &lt; more</p>"
    )


def test_a_number_in_words_sorts_as_the_number_that_it_is() -> None:
    text = html.html_table(
        ("RSD",), [(html.Said(4e9, "not shown"),), (html.Said(None, "not shown"),), (3.0,)]
    )
    assert '<td class="number" data-v="4e+09">not shown</td>' in text
    assert '<td class="number">not shown</td>' in text
    assert '<th class="number">' in text
