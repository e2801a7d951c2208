"""Runs the blocks of a page of the manual as somebody would who follows it from an empty folder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from excite.cli.main import _run_command

ROOT = Path(__file__).resolve().parents[2]
DOCS, SKILLS = ROOT / "docs", ROOT / "skills"
_BLOCK = re.compile(r"^```(python|bash)\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)
_WORDS = "show() { printf '%s\\0' \"$@\"; }; show "


@dataclass(frozen=True)
class Block:
    """A fenced block.

    Attributes:
        language: ``python`` or ``bash``.
        text: what stands in it.
        line: number of its first line in the page.
    """

    language: str
    text: str
    line: int


def blocks_of(page: Path) -> list[Block]:
    """The blocks of a page that are to be run, in order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(found[1], found[2], text.count("\n", 0, found.start()) + 2) for found in _BLOCK.finditer(text)
    ]


def pages() -> Iterator[Path]:
    """Pages and skills with blocks that are to be run."""
    for page in sorted([*DOCS.rglob("*.md"), *SKILLS.rglob("*.md")]):
        if "generated" not in page.parts and blocks_of(page):
            yield page


def run_page(page: Path, folder: Path) -> None:
    """Run the blocks of a page in a folder, one after the other; names of Python blocks live on from one to the next.

    Lines that begin with ``excite`` run in this process, which saves loading the libraries for every one of them; the
    shell reads them first, so that quotes, variables and patterns are what they are there.
    """
    names: dict[str, object] = {"__name__": "__main__"}
    before = Path.cwd()
    os.chdir(folder)
    try:
        for block in blocks_of(page):
            where = f"{page.relative_to(ROOT)}:{block.line}"
            if block.language == "python":
                exec(compile("\n" * (block.line - 1) + block.text, str(page), "exec"), names)
            else:
                _run_shell(block.text, where)
    finally:
        os.chdir(before)


def _run_shell(text: str, where: str) -> None:
    """Run a block line by line; it fails where a line does not end with the exit code it states, or else with 0."""
    for line in text.replace("\\\n", " ").splitlines():
        if line.startswith("excite "):
            code = _run_command(_words(line.removeprefix("excite ")))
            said = re.search(r"# exit code (\d)", line)
            expected = int(said[1]) if said else 0
            if code != expected:
                raise AssertionError(f"{where}: {line!r} ended with {code}")
        elif line.strip():
            subprocess.run(["bash", "-euo", "pipefail", "-c", line], check=True, env=_environment())


def _words(arguments: str) -> list[str]:
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", _WORDS + arguments], check=True, capture_output=True, text=True
    )
    return done.stdout.split("\0")[:-1]


def _environment() -> dict[str, str]:
    """The environment of somebody whose ``python`` is the one with excite."""
    return os.environ | {"PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}
