"""Native readers in a process of their own: where one crashes, hangs or eats memory, it is one line here."""

from __future__ import annotations

import importlib
import os
import pickle
import resource
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from excite.errors import ExciteError, InputError
from excite.kill_with_parent import die_with_parent

_MAIN = "from excite.formats.child import answer_task; answer_task()"


def in_child(
    function: str,
    *args: Any,
    source: Path,
    error: type[InputError] = InputError,
    seconds: float = 60.0,
    memory_gb: float = 8.0,
    endless: tuple[str, str] = ("takes its reader more than {seconds:g} s", "check that it is complete"),
) -> Any:
    """Call a function in a child process and return what it returns.

    For readers written in C or C++ that are known to crash on damaged files. The child is a fresh interpreter, so
    that it works from any program, and it dies with this one.

    Args:
        function: ``package.module:name`` of a function; its arguments and its result have to be picklable.
        args: its arguments.
        source: file that it reads, for errors.
        error: class of the errors.
        seconds: how long it may take [s].
        memory_gb: how much memory it may ask for [GB].
        endless: what is said, and what is to be done, where that time is over.

    Raises:
        InputError: of the class ``error``: the child crashed, took too long or too much memory.
        ExciteError: what the function itself raised.
    """
    task = pickle.dumps((function, args, memory_gb))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(entry for entry in sys.path if entry)}
    # By way of a file: of a pipe, a long recording would stand in memory three times over.
    with tempfile.TemporaryFile() as answered:
        try:
            done = subprocess.run(
                [sys.executable, "-c", _MAIN],
                input=task,
                stdout=answered,
                stderr=subprocess.DEVNULL,
                timeout=seconds,
                check=False,
                env=environment,
            )
        except subprocess.TimeoutExpired as reason:
            raise error(endless[0].format(seconds=seconds), source=source, remedy=endless[1]) from reason
        if done.returncode != 0:
            raise error(
                f"makes its reader fail ({_describe_ending(done.returncode)})",
                source=source,
                remedy="it is damaged: export it again",
            )
        answered.seek(0)
        kind, value = pickle.load(answered)  # noqa: S301  (written by answer_task() below, in our own child)
    if kind == "raised":
        raise value
    return value


def answer_task() -> None:
    """Run in the child: read a task from stdin, write what came of it to stdout."""
    out = os.fdopen(os.dup(1), "wb")
    # What native code prints shall not be taken for the answer.
    os.dup2(2, 1)
    die_with_parent()
    function, args, memory_gb = pickle.load(sys.stdin.buffer)  # noqa: S301  (from our own parent)
    # Where an administrator set a lower limit, that one holds.
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    limit = int(memory_gb * 1e9) if hard == resource.RLIM_INFINITY else min(int(memory_gb * 1e9), hard)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    # A crash shall leave no core file beside people's data.
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    module, _, name = function.partition(":")
    try:
        result: tuple[str, Any] = ("returned", getattr(importlib.import_module(module), name)(*args))
    except ExciteError as error:
        result = ("raised", error)
    with out:
        pickle.dump(result, out, protocol=pickle.HIGHEST_PROTOCOL)


def _describe_ending(code: int) -> str:
    if code >= 0:
        return "out of memory or bounds"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
