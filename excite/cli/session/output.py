"""What a command says: a summary or one JSON document on stdout, progress on stderr."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from excite.cli.session.interruption import document_printed
from excite.json_document import to_json, with_origin, write_json
from excite.progress import Progress as ProgressCallback
from excite.progress import silent
from excite.robot.scaffold.source import Source, model_source

EXIT_NEGATIVE = 1
"""Done, and the answer is "unsafe" or "targets not met"."""


def print_document(document: dict[str, Any]) -> None:
    """Print one JSON document on stdout."""
    text = to_json(with_origin(document))
    document_printed()
    print(text)


def emit_result(summary: str, document: dict[str, Any], *, as_json: bool, then: str = "") -> None:
    """Print the summary and the command to go on with, or the JSON document where ``--json`` was given."""
    if as_json:
        print_document(document)
        return
    print(summary)
    if then:
        print(f"then: {then}")


def command_line(*words: object) -> str:
    """A command as it can be typed, names with spaces quoted; models are read in it as in the one that says it."""
    # A report reads no model.
    source = Source() if words[0] == "report" else model_source()
    more = [word for folder in source.package_path for word in ("--package-path", folder)]
    more += [word for one in source.arguments.items() for word in ("--xacro-arg", ":=".join(one))]
    more += [] if source.limits is None else ["--limits", source.limits]
    return " ".join(["excite", *(shlex.quote(str(word)) for word in (*words, *more))])


def write_and_emit(document: dict[str, Any], name: str, *, as_json: bool, out: Path | None) -> bool:
    """Write the document where there is a folder and print it where ``--json`` was given; whether it was printed."""
    if out is not None:
        write_json(document, out / name)
    if as_json:
        print_document(document)
    return as_json


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
