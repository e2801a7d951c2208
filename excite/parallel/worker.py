"""What happens where tasks are done."""

from __future__ import annotations

import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from excite.errors import ExciteError
from excite.lifetime import die_with_parent
from excite.parallel.shared import SharedFile, load_shared
from excite.threads import one_blas_thread

# How often a worker's objects are looked through for some that nothing refers to but themselves [s]: 0.1 s each time.
_COLLECTED_S = 60.0

# Models keep room for their calculations: threads of one process take turns.
_TURN = threading.Lock()


@dataclass(frozen=True)
class Answer:
    """What became of a task.

    Attributes:
        value: what the function returned.
        error: what it raised; None if it returned.
    """

    value: Any = None
    error: Exception | None = None

    def given(self) -> Any:
        """Return or raise."""
        if self.error is not None:
            raise self.error
        return self.value


def perform(function: Callable[[Any, Any], Any], shared: SharedFile | None, task: Any) -> Answer:
    """Do a task with one BLAS thread; what it raises comes back as an answer.

    What an executor raises is then its own trouble (a process that was killed, a connection that broke).
    """
    try:
        with _TURN:
            return Answer(one_blas_thread(function)(None if shared is None else load_shared(shared), task))
    except Exception as error:  # noqa: BLE001  (raised again where the result is asked for)
        return Answer(error=_portable(error))


def _portable(error: Exception) -> Exception:
    """The error, with where it was raised, in a form that reaches other processes."""
    if isinstance(error, ExciteError):
        return error
    text = traceback.format_exc()
    error.add_note(text)
    try:
        pickle.loads(pickle.dumps(error))  # noqa: S301  (dumped in the same line)
    except Exception:  # noqa: BLE001  (constructors raise what they like)
        error = RuntimeError(f"{type(error).__name__}: {error}")
        error.add_note(text)
    return error


def begin(parent: int) -> None:
    """Begin the life of a worker process of this machine."""
    # Ctrl-C reaches the whole group of processes; what becomes of the work is the parent's affair.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent(parent)
    # Where psutil is installed, loky takes a worker that has loaded a robot for one that leaks memory, ends it and
    # warns of it.
    from joblib.externals.loky import process_executor

    process_executor._USE_PSUTIL = False
    # Without psutil it has all of a worker's objects looked through after a task as often as this [s]: once a second
    # was a tenth of what a plan of the G1 took. Python itself does so as objects grow in number.
    process_executor._MEMORY_LEAK_CHECK_DELAY = _COLLECTED_S


def ready() -> int:
    """Show that a worker works: its process number."""
    return os.getpid()
