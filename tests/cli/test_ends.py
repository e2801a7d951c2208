"""How a command ends: interrupted, unforeseen, unread; never with a traceback."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from excite.campaign.assessment import check
from excite.cli.main import main
from excite.motion.collection import load_motions
from excite.robot.loading import load_robot

_BROKEN = """
import sys
import excite.cli.results
from excite.atomic import write_text
from pathlib import Path
import excite
def fail():
    write_text(Path("first.txt"), "done")
    raise KeyError("something\\nodd")
excite.effect_summaries = fail
from excite.cli.main import program
program()
"""

_BUSY = """
import sys, time
import excite
def work():
    print("at work", file=sys.stderr, flush=True)
    HOW
excite.effect_summaries = work
from excite.cli.main import program
program()
"""


def python(code: str, *arguments: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )


_UNLOADABLE = """
import sys
import excite.cli.results
import excite
def fail():
    raise ImportError("hare cannot be loaded")
excite.effect_summaries = fail
from excite.cli.main import program
program()
"""


def _installed(folder: Path, name: str, version: str, *requires: str) -> None:
    """What pip leaves of a distribution."""
    about = folder / f"{name}-{version}.dist-info"
    about.mkdir()
    lines = ["Metadata-Version: 2.1", f"Name: {name}", f"Version: {version}", *requires]
    (about / "METADATA").write_text("\n".join(lines) + "\n")


def test_a_package_that_cannot_be_loaded_beside_versions_that_do_not_go_together_is_4(tmp_path: Path) -> None:
    asked = [f"Requires-Dist: {one}" for one in ("hare<3,>=2", "fox>=1", "owl>=1", "bear>=1; extra == 'big'")]
    _installed(tmp_path, "excite", "0.1.0", *asked)
    for name, version in (("hare", "1.5"), ("owl", "1.0")):
        _installed(tmp_path, name, version)
    where = os.pathsep.join([str(tmp_path), *sys.path])
    done = python(_UNLOADABLE, "effects", "--json", cwd=tmp_path, PYTHONPATH=where)
    assert done.returncode == 4
    assert done.stderr.count("\n") == 1
    error = json.loads(done.stdout)["error"]
    assert "hare 1.5 (needs <3,>=2), fox is not installed" in error["message"]
    assert "hare cannot be loaded" in error["message"]
    assert error["remedy"] == "pip install 'hare<3,>=2' 'fox>=1'"


def test_an_error_that_nobody_foresaw_is_5_and_says_where_its_details_are(tmp_path: Path) -> None:
    done = python(_BROKEN, "effects", "--json", cwd=tmp_path, TMPDIR=str(tmp_path))
    assert done.returncode == 5
    assert done.stderr.count("\n") == 1 and "Traceback" not in done.stderr
    error = json.loads(done.stdout)["error"]
    assert error["code"] == 5 and set(error) == {"code", "message", "file", "field", "remedy"}
    details = Path(error["file"])
    assert str(details) in done.stderr and "complete by then: first.txt" in done.stderr
    text = details.read_text()
    assert (
        "KeyError" in text
        and "Traceback" in text
        and "'effects', '--json'" in text.replace('"', "'").replace("' '", "', '")
    )


def test_what_an_installed_package_adds_is_named_where_it_fails(tmp_path: Path) -> None:
    """One process for both faults, since starting one takes the longest."""
    _installed(tmp_path, "toys", "1.0")
    (tmp_path / "toys-1.0.dist-info" / "entry_points.txt").write_text("[excite.readers]\ntoy = toys:Toy\n")
    (tmp_path / "toys.py").write_text(
        "import numpy\n"
        "from excite.conversion.sources.source import Source\n"
        "class Toy(Source):\n    name = summary = 'toy'\n"
        "    def recognises(self, path):\n"
        "        if path.name == 'own.csv':\n            raise ValueError('no such row')\n"
        "        numpy.linalg.inv([[0.0]])\n"
        "    def read(self, path):\n        return ()\n"
    )
    for name in ("own.csv", "numpys.csv"):
        (tmp_path / name).write_text("time,q\n0,0\n")
    code = (
        "import sys\nfrom excite.cli import main\n"
        "for name in ('own.csv', 'numpys.csv'):\n"
        "    sys.argv[1:] = ['convert', name, '--robot', 'ur10', '--out', 'log', '--json']\n"
        "    try:\n        main.main()\n    except SystemExit as end:\n        print('ended', end.code, flush=True)\n"
    )
    where = os.pathsep.join([str(tmp_path), *sys.path])
    done = python(code, cwd=tmp_path, PYTHONPATH=where, TMPDIR=str(tmp_path))
    documents = done.stdout.split("ended 4\n")
    assert len(documents) == 3 and documents[2] == "" and done.stderr.count("\n") == 2
    for document in documents[:2]:
        error = json.loads(document)["error"]
        assert error["file"] == "toys:Toy" and error["remedy"].startswith(
            "mend or uninstall the package that adds it"
        )


@pytest.mark.parametrize(
    "how", ["time.sleep(60)", "exec('while True: pass')", "import threading; threading.Event().wait()"]
)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_an_interrupted_command_ends_within_two_seconds(how: str, number: int, tmp_path: Path) -> None:
    code = _BUSY.replace("HOW", how)
    run = subprocess.Popen(
        [sys.executable, "-c", code, "effects"], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    assert run.stderr is not None and run.stderr.readline() == "at work\n"
    sent = time.monotonic()
    run.send_signal(number)
    rest = run.communicate(timeout=10)[1]
    assert time.monotonic() - sent < 2.0
    assert run.returncode == 128 + number
    assert rest.startswith("excite: interrupted") and rest.count("\n") == 1


def run_until(found: Path, arguments: list[str], cwd: Path, least: int) -> subprocess.Popen[str]:
    """A run of the command line, by the time that so many files are in a folder that it makes in ``TMPDIR``."""
    run = subprocess.Popen(
        [sys.executable, "-m", "excite", *arguments],
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(found)},
    )
    for _ in range(1200):
        if len(list(found.glob("**/*.factor"))) >= least or run.poll() is not None:
            break
        time.sleep(0.05)
    assert run.poll() is None, run.communicate()[1]
    return run


def test_an_interrupted_plan_keeps_the_best_so_far(tmp_path: Path) -> None:
    (tmp_path / "waiting").mkdir()
    arguments = ["plan", "ur10", "--candidates", "2000", "--jobs", "2", "--out", "plan"]
    run = run_until(tmp_path / "waiting", arguments, tmp_path, 6)
    run.send_signal(signal.SIGINT)
    said, error = run.communicate(timeout=60)
    assert run.returncode == 130, error
    assert "interrupted" in said and "the best so far is in plan" in error and "Traceback" not in error
    document = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert document["interrupted"] is True and 0 < document["candidates"]["generated"] < 2000
    motions = [entry["motion"] for entry in document["selected"]]
    assert motions and all((tmp_path / "plan" / name).is_file() for name in motions)
    robot = load_robot("ur10")
    assert check(robot, load_motions([tmp_path / "plan"], robot)).safe
    # Nothing is left of what waited.
    assert not list((tmp_path / "waiting").iterdir())


def test_a_plan_that_is_terminated_leaves_no_file(tmp_path: Path) -> None:
    (tmp_path / "waiting").mkdir()
    run = run_until(tmp_path / "waiting", ["plan", "ur10", "--candidates", "400", "--jobs", "2"], tmp_path, 1)
    sent = time.monotonic()
    run.send_signal(signal.SIGTERM)
    error = run.communicate(timeout=10)[1]
    assert time.monotonic() - sent < 2.5
    assert run.returncode == 143
    assert error.startswith("excite: interrupted") and error.count("\n") == 1
    assert [path.name for path in (tmp_path / "waiting").iterdir() if "excite" in path.name] == []


_STUBBORN = """while True:
        try:
            time.sleep(60)
        except KeyboardInterrupt:
            pass"""


@pytest.mark.parametrize("work", ["time.sleep(60)", _STUBBORN], ids=["unwinding", "stubborn"])
def test_with_json_an_interruption_is_one_document(work: str, tmp_path: Path) -> None:
    code = _BUSY.replace("HOW", work)
    run = subprocess.Popen(
        [sys.executable, "-c", code, "effects", "--json"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert run.stderr is not None and run.stderr.readline() == "at work\n"
    run.send_signal(signal.SIGINT)
    said, error = run.communicate(timeout=30)
    assert run.returncode == 130 and error == "excite: interrupted; nothing was written by then\n"
    assert json.loads(said)["error"]["code"] == 130


def test_an_interrupted_command_names_what_it_has_written(tmp_path: Path) -> None:
    done = """from pathlib import Path
    from excite.atomic import atomic_folder, write_text
    from excite.temporary_folder import TemporaryFolder
    folder = TemporaryFolder()
    write_text(folder.path / "passing.txt", "")
    write_text(Path("augmented.xml"), "")
    with atomic_folder(Path("person")) as half:
        write_text(half / "robot.yaml", "")
        raise KeyboardInterrupt"""
    run = python(_BUSY.replace("HOW", done), "effects", cwd=tmp_path)
    assert run.returncode == 130
    assert run.stderr == "at work\nexcite: interrupted; complete by then: augmented.xml\n"


def test_a_second_interrupt_ends_at_once(tmp_path: Path) -> None:
    code = """
import sys, time
import excite
def work(*arguments, **options):
    try:
        print("at work", file=sys.stderr, flush=True)
        time.sleep(60)
    except KeyboardInterrupt:
        time.sleep(60)
excite.plan = work
from excite.cli.main import program
program()
"""
    run = subprocess.Popen(
        [sys.executable, "-c", code, "plan", "ur10"], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    assert run.stderr is not None and run.stderr.readline() == "at work\n"
    run.send_signal(signal.SIGINT)
    assert "keeping the best so far" in run.stderr.readline()
    time.sleep(2.0)
    assert run.poll() is None
    sent = time.monotonic()
    run.send_signal(signal.SIGINT)
    assert run.wait(timeout=10) == 130 and time.monotonic() - sent < 1.0


def test_output_that_nobody_reads_is_no_verdict(tmp_path: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "excite", "robots", "--json"],
        stdout=write,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        check=False,
    )
    assert done.returncode == 141 and done.stderr == b""


def test_output_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "excite", "robots", "--json"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
            check=False,
        )
    assert done.returncode == 4
    assert done.stderr.count("\n") == 1 and "No space left on device" in done.stderr


def test_a_terminal_without_unicode_shows_all_that_it_can(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "excite", "effects"],
        capture_output=True,
        cwd=tmp_path,
        check=False,
        env={**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    )
    assert done.returncode == 0 and done.stderr == b""


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("robots", "--bad"), 2),
        (("plan", "ur10", "--candidates", "x"), 2),
        (("plan", "nope"), 4),
        (("plan", "x\0y"), 4),
    ],
)
def test_with_json_a_failure_is_one_document(
    arguments: tuple[str, ...],
    code: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["excite", *arguments, "--json"])
    with pytest.raises(SystemExit) as end:
        main()
    said, error = capsys.readouterr()
    assert end.value.code == code
    assert json.loads(said)["error"]["code"] == code
    assert error.startswith("excite: ") and error.count("\n") == 1
    assert not list(tmp_path.iterdir())
