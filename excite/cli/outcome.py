"""How a command ends: one line, one JSON document, one exit code; signals, and what stays after them."""

from __future__ import annotations

import errno
import json
import os
import platform
import select
import shlex
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from importlib import metadata
from pathlib import Path
from types import FrameType
from typing import Any

import excite
from excite.atomic import completed_files, discard_unfinished
from excite.errors import ExciteError, InputError, NothingSafeError
from excite.finding import Finding
from excite.folders import unwritable_error
from excite.results import to_json
from excite.temporary_folder import in_temporary_folder

_NAMED_FILES = 3


def kept_files() -> tuple[Path, ...]:
    """Files and folders that this process has completed and that stay, in order."""
    return tuple(path for path in completed_files() if path.exists() and not in_temporary_folder(path))


def left_behind() -> str:
    """What this process has completed by now, in words."""
    files = kept_files()
    if not files:
        return "nothing was written by then"
    rest = len(files) - _NAMED_FILES
    named = ", ".join(map(str, files[-_NAMED_FILES:]))
    return f"complete by then: {named}" + (f" and {rest} more" if rest > 0 else "")


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


# How a command ends that could not do its work: one line, one JSON document if asked for, one exit code.

EXIT_USAGE = 2
EXIT_BAD_INPUT = 4
EXIT_UNFORESEEN = 5


@dataclass(frozen=True)
class Failure:
    """What is said of a failed run.

    Attributes:
        code: exit code.
        message: what is wrong.
        file: in which file, if it is one.
        field: in which field, option or column of it.
        remedy: what to do.
        line: all of it in one line.
        findings: of a log that cannot be used, worst first.
        best: fields of ``{"error": …}`` that say what was found instead of a solution.
        table: the same for a person, a few lines.
    """

    code: int
    message: str
    file: str | None = None
    field: str | None = None
    remedy: str | None = None
    line: str = ""
    findings: tuple[Finding, ...] = ()
    best: Mapping[str, Any] = dataclass_field(default_factory=dict)
    table: str = ""

    def show(self, *, as_json: bool) -> None:
        """One line on stderr; before it on stdout what was found instead, with ``--json`` a document."""
        if self.table and not as_json:
            print(self.table, flush=True)
        print(f"excite: {self.line or self.message}", file=sys.stderr)
        if as_json:
            document_printed()
            print(to_json({"error": self.to_json()}))

    def to_json(self) -> dict[str, Any]:
        """The fields of ``{"error": …}``."""
        found = {"findings": [item.to_json() for item in self.findings]} if self.findings else {}
        return found | {
            "code": self.code,
            "message": self.message,
            "file": self.file,
            "field": self.field,
            "remedy": self.remedy,
            **self.best,
        }


def of_error(error: ExciteError) -> Failure:
    """A failure that excite foresaw; that of a plug-in has its details in a file."""
    trace = str(getattr(error, "trace", ""))
    where = f"; {_where(_write_details(trace, sys.argv[1:]))}" if trace else ""
    refusals: Any = error.best if isinstance(error, NothingSafeError) else None
    what = one_line(getattr(error, "what", None) or str(error))
    source, field, remedy = (getattr(error, name, None) for name in ("source", "field", "remedy"))
    return Failure(
        code=error.exit_code,
        message=what,
        file=None if source is None else one_line(str(source)),
        field=None if field is None else one_line(str(field)),
        remedy=None if remedy is None else one_line(f"{remedy}{where}"),
        line=one_line(f"{error}{where}"),
        findings=getattr(error, "findings", ()),
        best={} if refusals is None else {"refused": refusals.to_json()["refused"]},
        table="" if refusals is None else refusals.table(),
    )


def of_system(error: OSError) -> Failure:
    """A failure of the system that nobody could avoid: a full disk, a folder that went away."""
    if error.filename is not None:
        return of_error(unwritable_error(Path(str(error.filename)), error))
    what = f"the system refuses ({error.strerror or error})"
    remedy = "free memory, processes or files, and try again"
    if error.errno == errno.ENOSPC:
        # Files are named; what has no name is the output.
        what, remedy = f"what was found cannot be printed ({error.strerror})", "check what the output goes to"
    return Failure(EXIT_BAD_INPUT, what, remedy=remedy, line=f"{what}; {remedy}")


def of_usage(error: Any) -> Failure:
    """A command line that means nothing, as typer says it."""
    context = getattr(error, "ctx", None)
    remedy = f"see `{context.command_path if context else 'excite'} --help`"
    what = one_line(error.format_message()).rstrip(".")
    return Failure(EXIT_USAGE, what, remedy=remedy, line=f"{what}; {remedy}")


def of_unforeseen(error: BaseException, arguments: Sequence[str]) -> Failure:
    """An error of our own: the details go to a file, the line says where.

    Not our own is one of loading a package of a version not asked for.
    """
    name = one_line(f"{type(error).__name__}: {error}")[:200]
    unmet = unmet_requirements()
    if unmet and isinstance(error, ImportError):
        what = f"versions do not go together: {', '.join(one.text for one in unmet)} ({name})"
        remedy = "pip install " + " ".join(shlex.quote(one.asked) for one in unmet)
        return of_error(InputError(what, source="installed packages", remedy=remedy))
    details = _write_details("".join(traceback.format_exception(error)), arguments)
    where, done = _where(details), left_behind()
    return Failure(
        code=EXIT_UNFORESEEN,
        message=name,
        file=None if details is None else str(details),
        remedy="report it with that file",
        line=f"an error that nobody foresaw ({name}); {done}; {where}: report it with that file",
    )


def one_line(text: str) -> str:
    """Text without line breaks and control characters, of a length that can be read."""
    text = " ".join(text.split())
    text = "".join(char if char.isprintable() else repr(char)[1:-1] for char in text)
    return text if len(text) <= 1000 else text[:997] + "…"


def _where(details: Path | None) -> str:
    return f"details in {details}" if details else "its details could not be written"


def _write_details(trace: str, arguments: Sequence[str]) -> Path | None:
    lines = [
        f"excite {excite.__version__}, Python {platform.python_version()}, {platform.platform()}",
        "arguments: " + " ".join(map(repr, arguments)),
        "packages that are not as excite asks for them: "
        + (", ".join(one.text for one in unmet_requirements()) or "none"),
        "complete by then:",
        *(f"  {path}" for path in kept_files()),
        "",
        trace,
    ]
    stamp = time.strftime("%Y%m%d_%H%M%S")
    for folder in (tempfile.gettempdir(), "."):
        try:
            with tempfile.NamedTemporaryFile(
                "w",
                prefix=f"excite_error_{stamp}_",
                suffix=".txt",
                dir=folder,
                delete=False,
                encoding="utf-8",
                errors="backslashreplace",
            ) as stream:
                stream.write("\n".join(lines))
            return Path(stream.name)
        except OSError:
            continue
    return None


# Packages that are not as excite asks for them: what an error that nobody foresaw is most often about.
# Any version may do, so that they are looked at only after something failed.


@dataclass(frozen=True)
class Unmet:
    """A package of another version than asked for, or none at all.

    Attributes:
        asked: what pip would be told, such as ``numpy<2.4,>=2.3``.
        text: what is there and what is asked for.
    """

    asked: str
    text: str


def unmet_requirements() -> list[Unmet]:
    """What the installed package asks for, extras left out, and does not find; empty where it is not installed."""
    from packaging.requirements import Requirement
    from packaging.version import InvalidVersion

    found: list[Unmet] = []
    try:
        asked = [Requirement(text) for text in metadata.requires("excite") or ()]
    except metadata.PackageNotFoundError:
        return []
    for one in asked:
        if one.marker is not None and not one.marker.evaluate({"extra": ""}):
            continue
        wanted = f"{one.name}{one.specifier}"
        try:
            version = metadata.version(one.name)
        except metadata.PackageNotFoundError:
            found.append(Unmet(wanted, f"{one.name} is not installed"))
            continue
        try:
            fits = one.specifier.contains(version, prereleases=True)
        except (InvalidVersion, TypeError):  # of a distribution whose own description is damaged
            fits = False
        if not fits:
            found.append(Unmet(wanted, f"{one.name} {version} (needs {one.specifier})"))
    return found
