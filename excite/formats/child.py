"""Native readers in a process of their own: where one crashes, hangs or eats memory, it is one line here."""

from __future__ import annotations

import importlib
import os
import pickle
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from pathlib import Path
from typing import IO, Any

from excite.errors import ExciteError, InputError
from excite.kill_with_parent import die_with_parent

_MAIN = "from excite.formats.child import answer_tasks; answer_tasks({})"


class _Reader:
    """A fresh interpreter that does one task after the other, so that libraries are loaded once.

    Attributes:
        start: what it was started with: the module that it loads, this process, its folder and its environment.
        fresh: whether it has done nothing yet.
    """

    def __init__(self, start: tuple[Any, ...]) -> None:
        self.start, self.fresh = start, True
        self._line, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _MAIN.format(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                env=start[-1],
            )
        self.end = weakref.finalize(self, _end_reader, self._line, self._process, os.getpid())

    def do_task(self, file: IO[bytes], seconds: float) -> int:
        """Do the task that a file begins with and add the answer to it: 0, or what the interpreter ended with.

        Raises:
            TimeoutError: it took longer than this of a processor, or four times as long at all [s].
        """
        self.fresh = False
        self._line.settimeout(seconds)
        worked = _worked_s(self._process.pid)
        try:
            socket.send_fds(self._line, [b"!"], [file.fileno()])
            for left in (3, 2, 1, 0):
                try:
                    spent = self._line.recv(64)
                    break
                except TimeoutError:
                    # A process that had nearly all of a processor had its time.
                    if not left or _worked_s(self._process.pid) - worked > 0.9 * seconds:
                        raise
            _LAST.spent = getattr(_LAST, "spent", 0.0) + float(spent or 0.0)
            return 0 if spent else self._process.wait()
        except ConnectionError:
            return self._process.wait()
        except BaseException:
            self.end()
            raise


def _worked_s(process: int) -> float:
    """Processor time of another process [s]; the clock where the system does not say."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return time.monotonic()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _end_reader(line: socket.socket, process: subprocess.Popen[bytes], owner: int) -> None:
    line.close()
    if os.getpid() == owner:
        process.kill()
        process.wait()


# The reader of each thread, with which it ends (`die_with_parent`), and how long its readers have worked [s].
_LAST = threading.local()


def processor_s() -> float:
    """Processor time of this process, and of what this thread had done by others [s]."""
    return time.process_time() + float(getattr(_LAST, "spent", 0.0))


def in_child(
    function: str,
    *args: Any,
    source: Path,
    seconds: float = 60.0,
    memory_gb: float = 8.0,
    endless: tuple[str, str] = ("takes its reader more than {seconds:g} s", "check that it is complete"),
    kept: bool = False,
) -> Any:
    """Call a function in a child process and return what it returns.

    For readers written in C or C++ that are known to crash on damaged files. The child is an interpreter of its own, so
    that it works from any program, and dies with the thread that calls.

    Args:
        function: ``package.module:name`` of a function; its arguments and its result have to be picklable.
        source: file that it reads, for errors.
        seconds: how long it may take of a processor, which others may keep busy [s].
        memory_gb: how much memory it may ask for [GB].
        endless: what is said, and what is to be done, where that time is over.
        kept: whether the child waits for the next file of this kind, for readers that remember nothing.

    Raises:
        InputError: the child crashed, took too long or too much memory.
        ExciteError: what the function itself raised.
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(entry for entry in sys.path if entry)}
    start = (function.partition(":")[0], os.getpid(), os.stat(".")[1:3], environment)
    # By way of a file: of a pipe, a long recording would stand in memory three times over.
    with tempfile.TemporaryFile() as file:
        pickle.dump((function, args, memory_gb), file)
        file.flush()
        answer = file.tell()
        try:
            code = _run_task(file, seconds, start, kept)
        except TimeoutError as reason:
            raise InputError(endless[0].format(seconds=seconds), source=source, remedy=endless[1]) from reason
        if code != 0:
            raise InputError(
                f"makes its reader fail ({_describe_ending(code)})",
                source=source,
                remedy="it is damaged: export it again",
            )
        file.seek(answer)
        kind, value = pickle.load(file)  # noqa: S301  (written by answer_tasks() below, in our own child)
    if kind == "raised":
        raise value
    return value


def _run_task(file: IO[bytes], seconds: float, start: tuple[Any, ...], kept: bool) -> int:
    """Code with which a task ends; where a reader ends that has read before, what a fresh one does counts."""
    while True:
        reader = _LAST.__dict__.pop("reader", None)
        if reader is None or reader.start != start:
            reader = _Reader(start)
        fresh, code = reader.fresh, reader.do_task(file, seconds)
        if kept and code == 0:
            _LAST.reader = reader
        if code == 0 or fresh:
            return int(code)


def answer_tasks(descriptor: int) -> None:
    """Run in the child: read a task from each file that comes over a socket, add what came of it, and say so."""
    die_with_parent()
    # A crash shall leave no core file beside people's data.
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    line = socket.socket(fileno=descriptor)
    while files := socket.recv_fds(line, 1, 1)[1]:
        begun = time.process_time()
        with os.fdopen(files[0], "r+b") as file:
            file.seek(0)
            function, args, memory_gb = pickle.load(file)  # noqa: S301  (from our own parent)
            # Where an administrator set a lower limit, that one holds.
            hard = resource.getrlimit(resource.RLIMIT_AS)[1]
            limit = (
                int(memory_gb * 1e9) if hard == resource.RLIM_INFINITY else min(int(memory_gb * 1e9), hard)
            )
            resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
            module, _, name = function.partition(":")
            try:
                result: tuple[str, Any] = ("returned", getattr(importlib.import_module(module), name)(*args))
            except ExciteError as error:
                result = ("raised", error)
            pickle.dump(result, file, protocol=pickle.HIGHEST_PROTOCOL)
        line.send(repr(time.process_time() - begun).encode())


def _describe_ending(code: int) -> str:
    if code >= 0:
        return "out of memory or bounds"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
