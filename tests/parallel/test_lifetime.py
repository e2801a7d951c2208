"""Workers end with whoever started them, and leave nothing behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from excite.parallel.engine import in_order
from excite.temporary_folder import TemporaryFolder
from tests.parallel import work

_ROOT = Path(__file__).resolve().parents[2]
_BUSY = """
import sys
from pathlib import Path
from excite.parallel.engine import in_order
from tests.parallel import work
list(in_order(work.sleep, range(8), jobs=2, shared=Path(sys.argv[1])))
"""
_IDLE = """
import sys, time
from pathlib import Path
from excite.parallel.engine import in_order
from tests.parallel import work
found = set()
# On a busy machine one worker may do all before the other has started.
while len(found) < 2:
    found |= set(in_order(work.process, range(40), jobs=2))
for process in found:
    (Path(sys.argv[1]) / str(process)).touch()
time.sleep(600)
"""
# What starts the workers is a thread that has ended by the time that they work.
_THREAD = """
import sys, threading
from pathlib import Path
from excite.parallel.engine import in_order
from tests.parallel import work
first = threading.Thread(target=lambda: list(in_order(work.identity, range(8), jobs=2)))
first.start()
first.join()
found = set()
# On a busy machine one worker may do all before the other has started.
while len(found) < 2:
    found |= set(in_order(work.process, range(40), jobs=2))
for process in found:
    (Path(sys.argv[1]) / str(process)).touch()
list(in_order(work.sleep, range(8), jobs=2, shared=Path(sys.argv[1])))
"""

# The program ends by itself, with workers that wait for more work.
_PROGRAM = """
import sys
from excite.cli import main
from excite.parallel.engine import in_order
from tests.parallel import work
def command():
    list(in_order(work.identity, range(8), jobs=2))
    sys.exit(0)
main.main = command
main.program()
"""


def _alive(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


def _until(condition, seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


@pytest.fixture
def place(tmp_path: Path) -> Path:
    (tmp_path / "workers").mkdir()
    (tmp_path / "tmp").mkdir()
    return tmp_path


@contextmanager
def _run(code: str, place: Path) -> Iterator[tuple[subprocess.Popen[str], list[int]]]:
    """Run a program until two of its workers are at work."""
    environment = {**os.environ, "PYTHONPATH": str(_ROOT), "TMPDIR": str(place / "tmp")}
    run = subprocess.Popen(
        [sys.executable, "-c", code, str(place / "workers")],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert _until(lambda: len(list((place / "workers").iterdir())) >= 2, 60.0)
        workers = [int(path.name) for path in (place / "workers").iterdir()]
        assert all(_alive(worker) for worker in workers)
        yield run, workers
    finally:
        run.kill()
        run.wait()


def _semaphores(process: int) -> list[str]:
    return [name for name in os.listdir("/dev/shm") if name.startswith(f"sem.loky-{process}-")]


@pytest.mark.parametrize("code", [_BUSY, _IDLE, _THREAD], ids=["busy", "idle", "started_by_a_thread"])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_workers_end_with_a_parent_that_handles_nothing(number: int, code: str, place: Path) -> None:
    with _run(code, place) as (run, workers):
        run.send_signal(number)
        said = run.communicate(timeout=10)[1]
        assert run.returncode == -number
        assert _until(lambda: not any(_alive(worker) for worker in workers), 5.0)
        assert _until(lambda: not _semaphores(run.pid), 5.0)
        assert said == ""


def test_what_a_killed_run_left_is_removed_by_the_next(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with _run(_BUSY, place) as (run, _):
        assert list((place / "tmp").glob("excite_*"))
        run.kill()
        run.wait()
    monkeypatch.setattr(tempfile, "tempdir", str(place / "tmp"))
    mine = TemporaryFolder()
    assert [path for path in (place / "tmp").iterdir() if "excite" in path.name] == [mine.path]


@pytest.mark.parametrize("kind", [KeyboardInterrupt, SystemExit, RuntimeError])
def test_an_interruption_ends_the_workers_within_two_seconds(
    kind: type[BaseException], tmp_path: Path
) -> None:
    def interrupt(number: int, frame: object) -> None:
        raise kind

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        with pytest.raises(kind):
            for _ in in_order(work.sleep, _alarm_when_two_work(tmp_path), jobs=2, shared=tmp_path):
                pass
    finally:
        signal.signal(signal.SIGALRM, before)
    took = time.monotonic() - _SENT[0]
    workers = [int(path.name) for path in tmp_path.iterdir()]
    assert took < 2.0
    assert len(workers) == 2 and not any(_alive(worker) for worker in workers)


_SENT = [0.0]


def _alarm_when_two_work(folder: Path) -> Iterator[int]:
    """Eight tasks; a thread raises the signal once two workers are at one each."""

    def watch() -> None:
        _until(lambda: len(list(folder.iterdir())) >= 2, 60.0)
        _SENT[0] = time.monotonic()
        os.kill(os.getpid(), signal.SIGALRM)

    threading.Thread(target=watch, daemon=True).start()
    yield from range(8)


def test_who_stops_early_ends_the_workers(tmp_path: Path) -> None:
    results = in_order(work.die_once, range(1000), jobs=2, shared=tmp_path)
    assert next(results) == 0
    results.close()  # type: ignore[attr-defined]
    assert list(in_order(work.identity, range(4), jobs=2)) == [0, 1, 2, 3]


def test_the_program_ends_with_its_work_and_not_with_its_idle_workers() -> None:
    started = time.perf_counter()
    assert subprocess.run([sys.executable, "-c", _PROGRAM], cwd=_ROOT, timeout=120).returncode == 0
    # Workers wait for more work for five minutes.
    assert time.perf_counter() - started < 60.0
