"""The README and CONTRIBUTING say what is so: commands exist, blocks run, pictures and links are there."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import typer

import excite
from excite.cli.main import app

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
COMMANDS = sorted(set(re.findall(r"^(?:    )?excite ([^#\n]*[^#\s])", README, flags=re.MULTILINE)))
PYTHON = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


@cache
def _cli() -> typer.core.TyperGroup:
    return typer.main.get_command(app)


@pytest.mark.parametrize("line", COMMANDS)
def test_commands_in_the_readme_are_accepted_as_written(line):
    name, *arguments = shlex.split(line)
    command = _cli().commands[name]
    command.make_context(name, arguments)


def test_every_command_is_in_the_readme():
    shown = {line.split()[0] for line in COMMANDS} | set(re.findall(r"`excite ([a-z-]+)", README))
    assert set(_cli().commands) <= shown


def test_verbs_named_in_the_readme_exist():
    named = set(re.findall(r"`excite\.(\w+)`", README))
    assert named and named <= set(excite.__all__)


@pytest.mark.slow
@pytest.mark.parametrize("block", PYTHON, ids=range(len(PYTHON)))
def test_python_blocks_run_and_print_what_is_shown(block, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(compile(block, "README.md", "exec"), {"__name__": "__main__"})
    said = capsys.readouterr().out
    assert (tmp_path / "plan" / "report.html").is_file()
    shown = _between("result").strip("`\n").removeprefix("text\n").strip()
    # The same words; numbers to what another processor's rounding may change of a choice among motions.
    number = r"\d+(?:\.\d+)?"
    assert re.sub(number, "#", said.strip()) == re.sub(number, "#", shown)
    found, wanted = (np.array(re.findall(number, text), dtype=float) for text in (said, shown))
    np.testing.assert_allclose(found, wanted, rtol=0.1)


def test_the_robot_of_ones_own_is_there_when_its_lines_are_typed(tmp_path, excite_here):
    """The URDF is fetched by the line that says so, and described by the next that needs a moment only."""
    block = README.split("## Your own robot")[1].split("```")[1]
    fetch = next(line for line in block.splitlines() if line.startswith("cp "))
    subprocess.run(
        ["bash", "-c", fetch.replace("python -c", f"{sys.executable} -c")], cwd=tmp_path, check=True
    )
    describe = next(line for line in block.splitlines() if line.startswith("excite init-robot "))
    run = excite_here(*shlex.split(describe, comments=True)[1:], cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert excite.load_robot(tmp_path / "solo12" / "robot.yaml").description.base == "floating"


def test_what_one_looks_for_first_comes_first():
    lines = README.split("\n")
    assert lines.index("```python") < 30
    result = lines.index("<!-- result -->")
    assert result < 60 and lines[result + 1].startswith("```")
    assert next(i for i, line in enumerate(lines) if line.startswith("![")) < 60


def test_pictures_and_links_lead_somewhere():
    targets = re.findall(r"\]\(([^)#]+)\)", README + CONTRIBUTING)
    local = [target for target in targets if "://" not in target]
    assert local and [target for target in local if not (ROOT / target).is_file()] == []


def test_paths_and_targets_in_contributing_exist():
    for path in re.findall(r"`(excite/[\w/.]+)`", CONTRIBUTING):
        assert (ROOT / path).exists(), path
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"`?make ([\w-]+)", README + CONTRIBUTING):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target


def test_the_recipe_has_ten_lines_at_most():
    recipe = CONTRIBUTING.split("\n## ")[1]
    assert 3 <= len(re.findall(r"^\d+\. ", recipe, flags=re.MULTILINE)) <= 10


def _between(name: str) -> str:
    return re.search(rf"<!-- {name} -->\n(.*?)<!-- /{name} -->", README, flags=re.DOTALL)[1]
