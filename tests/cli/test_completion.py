"""What a shell gets that asks for completion, and that no colours reach anything but a terminal."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from excite.export.registry import MODEL_FORMATS
from excite.identification.estimators.registry import ESTIMATORS
from excite.robot.catalogue import bundled_robots

_PROGRAM = [sys.executable, "-c", "from excite.cli.main import program; program()"]


def completed(line: str) -> list[str]:
    """What bash is offered at the end of a line, as its completion script asks."""
    words = {"COMP_WORDS": line, "COMP_CWORD": str(line.count(" ")), "_EXCITE_COMPLETE": "complete_bash"}
    done = subprocess.run(_PROGRAM, env=os.environ | words, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return done.stdout.split()


def test_commands_robots_formats_and_methods_are_completed() -> None:
    assert completed("excite pl") == ["plan"]
    assert set(completed("excite plan ")) >= set(bundled_robots())
    assert completed("excite model result --format m") == [n for n in MODEL_FORMATS if n.startswith("m")]
    assert completed("excite identify ur10 log --method c") == [n for n in ESTIMATORS if n.startswith("c")]
    assert completed("excite plan ur10 --generator four") == ["fourier"]
    assert completed("excite simulate ur10 arm --inject pay") == ["payload"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_a_shell_calls_excite(shell: str) -> None:
    done = subprocess.run(
        _PROGRAM,
        env=os.environ | {"_EXCITE_COMPLETE": f"source_{shell}"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "_EXCITE_COMPLETE" in done.stdout and "excite" in done.stdout


@pytest.mark.parametrize(
    "arguments", [("robots",), ("effects",), ("--help",), ("plan", "--help"), ("nothing",)]
)
def test_no_colour_reaches_a_pipe(arguments: tuple[str, ...], tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "excite", *arguments], capture_output=True, cwd=tmp_path, check=False
    )
    assert b"\x1b" not in done.stdout + done.stderr and (done.stdout or done.stderr)
