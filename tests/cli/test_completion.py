"""What a shell gets that asks for completion, and that no colours reach anything but a terminal."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from unittest import mock

import pytest

from excite.cli.main import app
from excite.export.registry import MODEL_FORMATS
from excite.identification.estimators.registry import ESTIMATORS
from excite.robot.catalogue import bundled_robots


def asked(line: str) -> dict[str, str]:
    """What bash sets that wants a line completed."""
    return {"COMP_WORDS": line, "COMP_CWORD": str(line.count(" ")), "_EXCITE_COMPLETE": "complete_bash"}


def answered(asking: dict[str, str]) -> str:
    with mock.patch.dict(os.environ, asking), redirect_stdout(StringIO()) as said, pytest.raises(SystemExit):
        app(prog_name="excite")
    return said.getvalue()


def completed(line: str) -> list[str]:
    """What bash is offered at the end of a line."""
    return answered(asked(line)).split()


def test_commands_robots_formats_and_methods_are_completed() -> None:
    assert set(completed("excite plan ")) >= set(bundled_robots())
    assert completed("excite model result --format m") == [n for n in MODEL_FORMATS if n.startswith("m")]
    assert completed("excite identify ur10 log --method c") == [n for n in ESTIMATORS if n.startswith("c")]
    assert completed("excite plan ur10 --generator four") == ["fourier"]
    assert completed("excite simulate ur10 arm --inject pay") == ["payload"]


def test_the_program_answers_a_shell_with_nothing_else() -> None:
    program = [sys.executable, "-c", "from excite.cli.main import program; program()"]
    environment = os.environ | asked("excite pl")
    done = subprocess.run(program, env=environment, capture_output=True, text=True, check=True)
    assert (done.stdout.split(), done.stderr) == (["plan"], "")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_a_shell_calls_excite(shell: str) -> None:
    script = answered({"_EXCITE_COMPLETE": f"source_{shell}"})
    assert "_EXCITE_COMPLETE" in script and "excite" in script


def test_no_colour_reaches_a_pipe(tmp_path: Path) -> None:
    """One process for all of them, since starting one takes the longest."""
    code = (
        "import sys\nfrom excite.cli import main\n"
        "for words in (['robots'], ['effects'], ['--help'], ['plan', '--help'], ['nothing']):\n"
        "    sys.argv[1:] = words\n    print(words[-1], flush=True)\n"
        "    try:\n        main.main()\n    except SystemExit as end:\n        print('ended', end.code, flush=True)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, cwd=tmp_path, check=True)
    assert b"\x1b" not in done.stdout + done.stderr
    assert done.stdout.count(b"ended 0") == 4 and done.stdout.count(b"ended 2") == 1
    assert b"ur10" in done.stdout and b"viscous_friction" in done.stdout and b"nothing" in done.stderr
