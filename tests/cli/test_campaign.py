"""``excite campaign``: what it ends with."""

from __future__ import annotations

import json
import re
from html import unescape
from pathlib import Path

import pytest
from typer.testing import CliRunner

from excite.cli.main import app

pytestmark = pytest.mark.usefixtures("readers_here")


def test_it_ends_with_the_command_that_its_page_proposes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(
        app, ["campaign", "so101", "--candidates", "4", "--max-iterations", "1", "--out", "out"]
    )
    assert done.exit_code in (0, 1), done.exception
    (then,) = re.findall(r"^then: (excite .*)$", done.stdout, re.MULTILINE)
    page = unescape((tmp_path / "out" / "report.html").read_text(encoding="utf-8"))
    assert f"<code>{then}</code>" in page


def test_a_resumed_campaign_keeps_the_options_that_it_was_begun_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What an interrupted campaign suggests has no options but --resume; it failed wherever it was begun with some."""
    monkeypatch.chdir(tmp_path)
    begun = [
        "campaign",
        "so101",
        "--candidates",
        "4",
        "--on-robot",
        "--seed",
        "3",
        "--target-rsd",
        "20",
        "--out",
        "out",
    ]
    first = CliRunner().invoke(app, begun)
    assert isinstance(first.exception, SystemExit | None), first.exception
    again = CliRunner().invoke(app, ["campaign", "so101", "--resume", "--out", "out"])
    assert isinstance(again.exception, SystemExit | None), again.exception
    settings = json.loads((tmp_path / "out" / "journal.json").read_text())["settings"]
    kept = {"n_candidates": 4, "on_robot": True, "seed": 3, "target_rsd": 20.0}
    assert kept.items() <= settings.items()
    made = json.loads((tmp_path / "out" / "campaign.json").read_text())["made"]
    assert (
        made["command"] == "excite campaign so101 --candidates 4 --target-rsd 20 --on-robot"
        and made["seed"] == 3
    )
    # An option that is given has to be the same, or to ask for more iterations.
    other = CliRunner().invoke(app, ["campaign", "so101", "--resume", "--seed", "4", "--out", "out"])
    assert other.exit_code != 0 and "seed 3, not 4" in str(other.exception)
    longer = CliRunner().invoke(
        app, ["campaign", "so101", "--resume", "--max-iterations", "5", "--out", "out"]
    )
    assert isinstance(longer.exception, SystemExit | None), longer.exception
    assert json.loads((tmp_path / "out" / "journal.json").read_text())["settings"]["max_iterations"] == 5


def test_each_command_of_a_campaign_on_a_robot_says_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is recorded its page was empty, and nothing said what to do."""
    monkeypatch.chdir(tmp_path)

    def run(line: str) -> str:
        done = CliRunner().invoke(app, line.split())
        assert isinstance(done.exception, SystemExit | None), (line, done.exception)
        return "".join(re.findall(r"^then: excite (.*)$", done.stdout, re.MULTILINE))

    capture = run("campaign so101 --candidates 4 --max-iterations 1 --on-robot --out out")
    assert capture == "capture so101 out/iteration_1"
    page = unescape((tmp_path / "out" / "report.html").read_text(encoding="utf-8"))
    assert "Nothing is recorded yet" in page and f"<code>excite {capture}</code>" in page
    assert 'id="motions"' in (tmp_path / "out" / "iteration_1" / "report.html").read_text(encoding="utf-8")
    convert = run(capture)
    assert "--out out/iteration_1/log --capture out/iteration_1/capture.md" in convert
    run("simulate so101 out/iteration_1 --out recorded")
    recorded = " ".join(str(file) for file in sorted(Path("recorded").glob("*.parquet")))
    resume = run(convert.replace("RECORDING", recorded))
    assert resume == "campaign so101 --resume --out out"
    run(resume)
    assert json.loads((tmp_path / "out" / "campaign.json").read_text())["iterations"]
