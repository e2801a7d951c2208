"""``excite campaign``: what it ends with."""

from __future__ import annotations

import json
import re
import shutil
from html import unescape
from pathlib import Path

import pytest
from typer.testing import CliRunner

from excite.cli.main import app

pytestmark = pytest.mark.usefixtures("readers_here")


def run(line: str) -> str:
    """Run a command in this process: what it says to do next."""
    done = CliRunner().invoke(app, line.split())
    assert done.exit_code in (0, 1), (line, done.exception)
    return "".join(re.findall(r"^then: excite (.*)$", done.stdout, re.MULTILINE))


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A folder with a campaign in ``out`` that waits for a recording, and what its command said to do next."""
    folder = tmp_path_factory.mktemp("campaign")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        options = "--candidates 4 --max-iterations 1 --on-robot --seed 3 --target-rsd 20 --out out"
        return folder, run(f"campaign so101 {options}")


@pytest.fixture
def begun(planned: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A copy of that in the working directory, and what to do next."""
    shutil.copytree(planned[0], tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return planned[1]


def test_it_ends_with_the_command_that_its_page_proposes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    then = run("campaign so101 --candidates 4 --max-iterations 1 --out out")
    page = unescape((tmp_path / "out" / "report.html").read_text(encoding="utf-8"))
    assert then and f"<code>excite {then}</code>" in page


def test_a_resumed_campaign_keeps_the_options_that_it_was_begun_with(begun: str, tmp_path: Path) -> None:
    """What an interrupted campaign suggests has no options but --resume; it failed wherever it was begun with some."""
    run("campaign so101 --resume --out out")
    settings = json.loads((tmp_path / "out" / "journal.json").read_text())["settings"]
    kept = {"n_candidates": 4, "on_robot": True, "seed": 3, "target_rsd": 20.0}
    assert kept.items() <= settings.items()
    made = json.loads((tmp_path / "out" / "campaign.json").read_text())["made"]
    assert made["seed"] == 3
    assert made["command"] == (
        "excite campaign so101 --candidates 4 --target-rsd 20 --max-iterations 1 --on-robot"
    )
    # An option that is given has to be the same, or to ask for more iterations.
    other = CliRunner().invoke(app, "campaign so101 --resume --seed 4 --out out".split())
    assert other.exit_code != 0 and "seed 3, not 4" in str(other.exception)
    run("campaign so101 --resume --max-iterations 5 --out out")
    assert json.loads((tmp_path / "out" / "journal.json").read_text())["settings"]["max_iterations"] == 5


def test_each_command_of_a_campaign_on_a_robot_says_the_next(begun: str, tmp_path: Path) -> None:
    """Before anything is recorded its page was empty, and nothing said what to do."""
    assert begun == "capture so101 out/iteration_1"
    page = unescape((tmp_path / "out" / "report.html").read_text(encoding="utf-8"))
    assert "Nothing is recorded yet" in page and f"<code>excite {begun}</code>" in page
    assert 'id="motions"' in (tmp_path / "out" / "iteration_1" / "report.html").read_text(encoding="utf-8")
    convert = run(begun)
    assert "--out out/iteration_1/log --capture out/iteration_1/capture.md" in convert
    run("simulate so101 out/iteration_1 --out recorded")
    recorded = " ".join(str(file) for file in sorted(Path("recorded").glob("*.parquet")))
    resume = run(convert.replace("RECORDING", recorded))
    assert resume == "campaign so101 --resume --out out"
    run(resume)
    assert json.loads((tmp_path / "out" / "campaign.json").read_text())["iterations"]
