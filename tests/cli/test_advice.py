"""What messages advise to type has the options that they name."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import typer

import excite
from excite.cli.main import app

_ROOT = Path(excite.__file__).parent
_COMMAND = re.compile(r"\bexcite ([a-z][a-z-]*)((?: (?!excite )[^\s`;,()]+)*)")
_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
_MODEL_OPTIONS = {"--package-path", "--xacro-arg", "--limits"}


def _commands() -> dict[str, set[str]]:
    """Options of each command by its name, those of groups' commands together."""
    found: dict[str, set[str]] = {}

    def gather(name: str, command: object) -> None:
        options = {word for one in command.params for word in (*one.opts, *one.secondary_opts)}  # type: ignore[attr-defined]
        found.setdefault(name, set()).update(options)
        for inner in getattr(command, "commands", {}).values():
            gather(name, inner)

    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        gather(name, command)
    return found


def _texts(tree: ast.AST) -> Iterator[str]:
    """Texts in a module, docstrings left out; what is filled in stands as X."""
    inside: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            inside.add(id(node.value))
        elif isinstance(node, ast.JoinedStr):
            inside |= {id(part) for part in ast.walk(node)}
            yield "".join(part.value if isinstance(part, ast.Constant) else "X" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside:
            yield node.value


@cache
def _advised() -> tuple[set[tuple[str, str, str]], set[tuple[str, str]]]:
    """Where a command is named, which, and an option that is named with it; where a remedy names one, and which."""
    found, alone = set(), set()
    for path in sorted(_ROOT.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        place = path.relative_to(_ROOT).as_posix()
        for text in _texts(tree):
            for command, words in _COMMAND.findall(text):
                found |= {(place, command, option) for option in _OPTION.findall(words)}
        for node in ast.walk(tree):
            if isinstance(node, ast.keyword) and node.arg == "remedy":
                alone |= {(place, one) for text in _texts(node.value) for one in _OPTION.findall(text)}
    return found, alone


def test_a_command_that_is_advised_has_the_option_that_it_is_advised_with() -> None:
    commands, (advised, _) = _commands(), _advised()
    assert len(advised) > 10
    wrong = [
        f"{place} advises excite {command} {option}"
        for place, command, option in sorted(advised)
        if option not in commands.get(command, ())
    ]
    assert wrong == []


def test_an_option_that_a_remedy_names_alone_is_of_some_command() -> None:
    known, (_, named) = set().union(*_commands().values()), _advised()
    assert len(named) > 20
    assert {(place, one) for place, one in named if one not in known} == set()


def test_every_command_that_takes_a_robot_takes_what_errors_of_its_model_advise() -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    taking = {
        name
        for name, command in commands.items()
        if name == "check" or any(one.name in {"robot", "whose"} for one in command.params)
    }
    assert {"plan", "check", "rank", "simulate", "identify", "campaign", "capture", "convert"} <= taking
    lacking = {
        name: missing for name in taking | {"init-robot"} if (missing := _MODEL_OPTIONS - _commands()[name])
    }
    assert not lacking
