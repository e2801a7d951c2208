"""What holds for every command: examples that can be typed, choices in its help, failures that programs can read."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

import excite
from excite.campaign.schemas import schema_names
from excite.campaign.searches import SEARCHES
from excite.cli.main import _run_command, app
from excite.cli.options import EXAMPLES
from excite.cli.output import command_line, emit_result
from excite.excitation.selection import SELECTIONS
from excite.export.registry import EXPORTERS, MODEL_FORMATS
from excite.human.body import ANTHROPOMETRY
from excite.identification.estimators.registry import ESTIMATORS
from excite.motion import files
from excite.motion.generators.registry import GENERATORS
from excite.motion.readers.registry import read_motion
from excite.simulation.effects.registry import INJECTED_EFFECTS


def _commands(command: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    inner = getattr(command, "commands", None)
    if inner is None:
        yield name, command
    else:
        for key, item in inner.items():
            yield from _commands(item, f"{name} {key}".strip())


COMMANDS = dict(_commands(typer.main.get_command(app)))
LINES = [line for lines in EXAMPLES.values() for line, _ in lines]


def help_of(name: str, capsys: pytest.CaptureFixture[str]) -> str:
    assert _run_command([*name.split(), "--help"]) == 0
    return capsys.readouterr().out


def test_there_are_examples_of_every_command_and_of_no_other() -> None:
    assert set(EXAMPLES) == set(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_ends_with_the_examples(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    last = help_of(name, capsys).split("\nExamples:\n")[1]
    assert [line.strip() for line in last.splitlines() if line.startswith("  excite ")] == [
        line for line, _ in EXAMPLES[name]
    ]


@pytest.mark.parametrize("line", LINES)
def test_an_example_is_accepted_as_written(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    _, *arguments = shlex.split(line)
    name = next(name for name in COMMANDS if arguments[: len(name.split())] == name.split())
    COMMANDS[name].make_context(name, arguments[len(name.split()) :]).close()


@pytest.mark.parametrize("name", COMMANDS)
def test_a_failure_with_json_is_a_document(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run_command([*name.split(), "--no-such-option", "--json"]) == 2
    said = capsys.readouterr()
    error = json.loads(said.out)["error"]
    assert error["code"] == 2 and "--no-such-option" in error["message"]
    assert f"excite {name} --help" in error["remedy"]
    assert said.err.startswith("excite: ") and said.err.count("\n") == 1


@pytest.mark.parametrize(
    "line",
    [
        "plan nowhere.urdf",
        "check ur10 nowhere.csv",
        "rank ur10 nowhere",
        "export nowhere.csv --format csv",
        "export nowhere.csv --format colour",
        "capture ur10 nowhere",
        "simulate nobody motions",
        "init-robot nowhere.urdf",
        "init-log nowhere",
        "convert nowhere.csv --robot ur10 --out log",
        "identify ur10 nowhere",
        "identify-load ur10 nowhere neither",
        "model nowhere --format urdf --out model",
        "doctor nowhere",
        "diagnose nowhere",
        "human nowhere.c3d --mass 70 --height 1.8 --sex male",
        "campaign nobody",
        "report nowhere",
        "schema colour",
    ],
)
def test_a_file_or_name_that_is_not_there_ends_in_one_line_and_a_document(
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert _run_command([*line.split(), "--json"]) == 4
    said = capsys.readouterr()
    error = json.loads(said.out)["error"]
    assert error["code"] == 4 and error["message"] and error["remedy"]
    assert said.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "choices"),
    [
        ("plan", [*GENERATORS, *SEARCHES]),
        ("plan", SELECTIONS),
        ("export", EXPORTERS),
        ("identify", ESTIMATORS),
        ("campaign", ESTIMATORS),
        ("human", ANTHROPOMETRY),
        ("simulate", INJECTED_EFFECTS),
        ("schema", schema_names()),
        ("model", MODEL_FORMATS),
    ],
)
def test_every_choice_is_listed(name: str, choices: Any, capsys: pytest.CaptureFixture[str]) -> None:
    words = set(re.findall(r"[\w-]+", help_of(name, capsys)))
    assert set(choices) and set(choices) <= words


def test_what_comes_next_is_a_line_of_its_own_and_never_in_a_document(
    capsys: pytest.CaptureFixture[str],
) -> None:
    then = command_line("rank", "ur10", Path("my plan"))
    emit_result("done", {"a": 1}, as_json=False, then=then)
    assert capsys.readouterr().out == "done\nthen: excite rank ur10 'my plan'\n"
    emit_result("done", {"a": 1}, as_json=True, then=then)
    assert json.loads(capsys.readouterr().out) == {"a": 1}


@pytest.mark.slow
def test_the_next_command_is_one_that_exists(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each command's own suggestion, followed from the motions that come with the package to a model."""
    monkeypatch.chdir(tmp_path)
    for motion in excite.load_motions("ur10")[:1]:
        (tmp_path / "arm").mkdir(exist_ok=True)
        excite.save_motion(motion, tmp_path / "arm" / f"{motion.name}.parquet")
    for line in ("check ur10 arm", "rank ur10 arm", "simulate ur10 arm --jobs 1 --out log", "doctor log"):
        assert _run_command(line.split()) == 0
        (then,) = re.findall(r"^then: excite (.*)$", capsys.readouterr().out, flags=re.MULTILINE)
        name, *arguments = shlex.split(then)
        COMMANDS[name].make_context(name, arguments).close()


def test_the_next_command_names_the_robot_whatever_a_file_says_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    # Positions alone are another curve: one whose jerk leaves room for that.
    motion = excite.load_motions("ur10")[1]
    excite.save_motion(motion, tmp_path / "known.parquet")
    names = [f"q.{joint}" for joint in excite.load_robot("ur10").joint_names]
    rows = np.column_stack([motion.time, motion.q])
    np.savetxt("mine.csv", rows, delimiter=",", header=",".join(["time", *names]), comments="")
    reads = []
    monkeypatch.setattr(files, "read_motion", lambda *given: reads.append(given) or read_motion(*given))
    for name in ("known.parquet", "mine.csv"):
        assert _run_command(["rank", "ur10", name]) == 0
        (then,) = re.findall(r"^then: excite (.*)$", capsys.readouterr().out, flags=re.MULTILINE)
        assert then == f"export {name} --robot ur10 --format csv --out commands"
    # Each is read once.
    assert len(reads) == 2
    assert _run_command(shlex.split(then)) == 0
