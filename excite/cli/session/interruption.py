"""Ctrl-C and a request to end: what is complete stays, workers and unfinished files go, and the exit code says so."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from types import FrameType

from excite.atomic import discard_unfinished

# Work is to be over 2 s after the request. What has not unwound by then (native code that Python cannot interrupt)
# ends without unwinding; workers end with their parent.
_GRACE_S = 1.5
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(BaseException):
    """The run was asked to end; no error, so that nothing that handles errors stops it on its way.

    Attributes:
        exit_code: 128 and the number of the signal: 130 for Ctrl-C, 143 for a request to end.
    """

    def __init__(self, number: int):
        self.exit_code = 128 + number
        super().__init__(signal.Signals(number).name)


def handle_signals() -> None:
    """Let SIGINT and SIGTERM raise :class:`Interrupted`, and end the process where that does not help in time."""
    arrived, wakeup = os.pipe()
    os.set_blocking(wakeup, False)
    for number in _SIGNALS:
        signal.signal(number, _interrupt)
    signal.set_wakeup_fd(wakeup, warn_on_full_buffer=False)
    threading.Thread(target=_end_in_time, args=(arrived,), daemon=True).start()


def say_interrupted() -> None:
    """The one line that an interrupted run ends with."""
    print("excite: interrupted; what is complete was left", file=sys.stderr, flush=True)


def _interrupt(number: int, frame: FrameType | None) -> None:
    # A second request changes nothing: the first is being followed.
    for other in _SIGNALS:
        signal.signal(other, signal.SIG_IGN)
    raise Interrupted(number)


def _end_in_time(arrived: int) -> None:
    """Wait for a signal that ends the run, then for the run to end."""
    while True:
        number = os.read(arrived, 1)[0]
        if number in {int(item) for item in _SIGNALS}:
            break
    time.sleep(_GRACE_S)
    discard_unfinished()
    say_interrupted()
    os._exit(128 + number)
