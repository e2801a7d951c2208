"""What happens where tasks are done."""

from __future__ import annotations

import hashlib
import pickle
import signal
import socket
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Generic, TypeVar

from excite.errors import ExciteError, InputError
from excite.kill_with_parent import die_with_parent
from excite.temporary_folder import TemporaryFolder
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


def perform_task(function: Callable[[Any, Any], Any], shared: SharedFile | None, task: Any) -> Answer:
    """Do a task with one BLAS thread; what it raises comes back as an answer.

    What an executor raises is then its own trouble (a process that was killed, a connection that broke).
    """
    try:
        with _TURN:
            return Answer(one_blas_thread(function)(None if shared is None else load_shared(shared), task))
    except Exception as error:  # noqa: BLE001  (raised again where the result is asked for)
        return Answer(error=_make_portable(error))


def _make_portable(error: Exception) -> Exception:
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


def begin_worker(parent: int) -> None:
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


# What all tasks need: written to a file once, read once by each process that works.

T = TypeVar("T")
# A worker serves one plan after the other: its robot, and the same robot with what runs its motions.
_KEPT = 4


@dataclass(frozen=True)
class SharedFile:
    """Where a shared value is; two files of the same content are the same.

    Attributes:
        path: in a temporary folder, which for several machines has to be on a file system that they share.
        digest: SHA-256 of the file, in hexadecimal digits.
    """

    path: Path = field(compare=False)
    digest: str


class Shared(Generic[T]):
    """A value that several rounds of tasks need; its file is written when the first of them leaves this process.

    Attributes:
        value: the value.
    """

    def __init__(self, value: T) -> None:
        self.value = value
        self._written: tuple[TemporaryFolder, SharedFile] | None = None

    def file(self) -> SharedFile:
        """The file, which is there for as long as this object.

        Raises:
            InputError: it cannot be written.
        """
        if self._written is None:
            from joblib.externals.loky.backend import reduction

            content = bytes(reduction.dumps(self.value))
            folder = TemporaryFolder()
            path = folder.path / "shared.pickle"
            try:
                path.write_bytes(content)
            except OSError as error:
                raise InputError(
                    f"cannot be written ({error.strerror})",
                    source=path,
                    remedy="set TMPDIR to a folder with room",
                ) from error
            self._written = folder, SharedFile(path, hashlib.sha256(content).hexdigest())
        return self._written[1]


@lru_cache(maxsize=_KEPT)
def load_shared(file: SharedFile) -> Any:
    """The value of a shared file; the same object at each call with the same content.

    Raises:
        InputError: this machine does not see the file, or another content.
    """
    remedy = "set TMPDIR to a folder that all machines share"
    try:
        content = file.path.read_bytes()
    except OSError as error:
        raise InputError(
            f"cannot be read on {socket.gethostname()} ({error.strerror})", source=file.path, remedy=remedy
        ) from error
    if hashlib.sha256(content).hexdigest() != file.digest:
        raise InputError(f"has another content on {socket.gethostname()}", source=file.path, remedy=remedy)
    return pickle.loads(content)  # noqa: S301  (of the digest that came with the task)
