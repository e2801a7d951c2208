"""Ctrl-C and a request to end: what is complete stays, workers and unfinished files go, and the exit code says so."""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from excite.atomic import discard_unfinished
from excite.cli.session.left_behind import left_behind

# Work is to be over 2 s after the request. What has not unwound by then (native code that Python cannot interrupt)
# ends without unwinding; workers end with their parent.
_GRACE_S = 1.5
# After Ctrl-C, work that keeps its best so far may take as long as it is to choose and write that: of 300 motions of a
# humanoid some seconds. Another Ctrl-C ends it at once.
_KEEPING_S = 60.0
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
# The signal that arrived, as a file's descriptor would be kept: one process has one.
_ARRIVED: list[int] = []
_KEEPING = threading.Event()
# Whether the one document of ``--json`` was printed; the run and the thread that ends it may both be about to.
_ANSWERED, _ANSWERING = threading.Event(), threading.Lock()


def handle_signals() -> None:
    """Let SIGINT and SIGTERM raise KeyboardInterrupt, and end the process where that does not help in time."""
    arrived, wakeup = os.pipe()
    os.set_blocking(wakeup, False)
    for number in _SIGNALS:
        signal.signal(number, _handle_interrupt)
    signal.set_wakeup_fd(wakeup, warn_on_full_buffer=False)
    threading.Thread(target=_end_in_time, args=(arrived,), daemon=True).start()


@contextmanager
def keeping_best() -> Iterator[None]:
    """Work that, interrupted by Ctrl-C, goes on to write the best that it has."""
    _KEEPING.set()
    try:
        yield
    finally:
        _KEEPING.clear()


def exit_code_of_interruption() -> int:
    """What an interrupted run ends with: 130 for Ctrl-C, 143 for a request to end."""
    return 128 + (_ARRIVED[0] if _ARRIVED else signal.SIGINT)


def say_interrupted(kept: str) -> None:
    """The one line that an interrupted run ends with."""
    print(f"excite: interrupted; {kept}", file=sys.stderr, flush=True)


def answer_interrupted(code: int) -> None:
    """What a run ends with that kept no best so far: its line, and with ``--json`` a document if there was none yet."""
    kept = left_behind()
    say_interrupted(kept)
    with _ANSWERING:
        if "--json" not in sys.argv or _ANSWERED.is_set():
            return
        _ANSWERED.set()
        nothing = dict.fromkeys(("file", "field", "remedy"))
        with suppress(OSError):
            text = json.dumps(
                {"error": {"code": code, "message": f"interrupted; {kept}", **nothing}}, indent=2
            )
            print(text, flush=True)


def document_printed() -> None:
    """Remember that stdout has its one document."""
    with _ANSWERING:
        _ANSWERED.set()


def _handle_interrupt(number: int, frame: FrameType | None) -> None:
    # A second request changes nothing here: the first is being followed.
    for other in _SIGNALS:
        signal.signal(other, _ignore_interrupt)
    _ARRIVED.append(number)
    raise KeyboardInterrupt(signal.Signals(number).name)


def _ignore_interrupt(number: int, frame: FrameType | None) -> None:
    """A further request, which :func:`_end_in_time` hears."""


def _end_in_time(arrived: int) -> None:
    """Wait for a signal that ends the run, then for the run to end."""
    numbers = {int(item) for item in _SIGNALS}
    while (number := os.read(arrived, 1)[0]) not in numbers:
        pass
    if _KEEPING.is_set() and number == signal.SIGINT:
        print("excite: keeping the best so far; Ctrl-C again ends without it", file=sys.stderr, flush=True)
        until = time.monotonic() + _KEEPING_S
        while _KEEPING.is_set() and time.monotonic() < until:
            if select.select([arrived], [], [], 0.05)[0] and os.read(arrived, 1)[0] in numbers:
                break
        else:
            # Said and printed within the usual time.
            time.sleep(_GRACE_S)
    else:
        time.sleep(_GRACE_S)
    discard_unfinished()
    answer_interrupted(128 + number)
    os._exit(128 + number)
