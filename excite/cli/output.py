"""What a command says: a summary or one JSON document on stdout, progress on stderr."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from excite.cli.outcome import document_printed
from excite.progress import Progress as ProgressCallback
from excite.progress import silent
from excite.results import to_json, with_origin
from excite.robot.init_robot.source import Source, model_source

EXIT_NEGATIVE = 1
"""Done, and the answer is "unsafe" or "targets not met"."""


def print_document(document: dict[str, Any]) -> None:
    """Print one JSON document on stdout."""
    text = to_json(with_origin(document))
    document_printed()
    print(text)


def command_line(*words: object) -> str:
    """A command as it can be typed, names with spaces quoted; models are read in it as in the one that says it."""
    # A report reads no model.
    source = Source() if words[:1] == ("report",) else model_source()
    more = [word for folder in source.package_path for word in ("--package-path", folder)]
    more += [word for one in source.arguments.items() for word in ("--xacro-arg", ":=".join(one))]
    more += [] if source.limits is None else ["--limits", source.limits]
    return " ".join(["excite", *(shlex.quote(str(word)) for word in (*words, *more))])


@contextmanager
def progress_bars() -> Iterator[ProgressCallback]:
    """Progress bars with the time left on stderr while it is a terminal; silence otherwise, as scripts are promised."""
    if not sys.stderr.isatty():
        yield silent
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description:<28}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=False) as bars:
        tasks: dict[str, Any] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield show


# Folders of a campaign on a real robot, which waits for recordings: what is made for an iteration belongs
# into it.


def log_folder(plan: Path) -> Path:
    """Where the log of a plan's motions goes: into the campaign's iteration that the plan is of, else anywhere.

    Args:
        plan: folder of the plan.
    """
    return plan / "log" if (plan.parent / "journal.json").is_file() else Path("log")


def campaign_of(log: Path) -> Path | None:
    """The campaign that waits for a log; None where none does.

    Args:
        log: folder of the log.
    """
    campaign = log.parent.parent
    return campaign if log == log_folder(log.parent) and (campaign / "journal.json").is_file() else None


def stated_origin(robot: str, log: Path | None, folder: Path) -> dict[str, str]:
    """Where robot and log of a result lie, relative to its folder; of a bundled robot, or the log's own, only the log.

    Args:
        robot: as it was given, a name or a path; empty where it was not.
        log: the first log; None where there is none.
        folder: folder of the document.
    """
    files = {"robot_file": Path(robot)} if os.path.exists(robot) else {}
    if log is not None:
        files["log_file"] = Path(log)
    return {name: relative_to(folder, file) for name, file in files.items()}


def relative_to(folder: Path, file: Path) -> str:
    """A file as a document in a folder names it."""
    return Path(os.path.relpath(Path(file).resolve(), Path(folder).resolve())).as_posix()
