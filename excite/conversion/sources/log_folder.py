"""This toolkit's own log folders, so that they can be cut, renamed and joined with others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from excite.conversion.recording import Recording, Stream
from excite.conversion.shapes import stream_of_arrays
from excite.conversion.sources.source import Source
from excite.errors import LogError
from excite.formats.registry import read_contents
from excite.logs.header import read_header


class LogFolderSource(Source):
    """Trials of a log folder, each under its own name, with the contract's columns."""

    name: ClassVar[str] = "log"
    summary: ClassVar[str] = "a log folder of excite (log.yaml)"

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return (path / "log.yaml").is_file() or path.name == "log.yaml"

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        folder = path if path.is_dir() else path.parent
        header = read_header(folder / "log.yaml")
        files = [folder / entry.file for entry in header.trials]
        said = {"roles": {Path(entry.file).stem: entry.role for entry in header.trials}, "log": header}
        return tuple(
            Recording(
                str(file),
                file.stem,
                tuple(_in_si(stream) for stream in stream_of_arrays(file.stem, content.columns)),
                said,
            )
            for file, content in zip(files, read_contents(files, LogError), strict=True)
        )


def _in_si(stream: Stream) -> Stream:
    """The stream with the unit on its torques: whoever wrote the log said what they are."""
    columns = tuple(
        replace(column, unit="N·m") if column.name.startswith("tau.") else column for column in stream.columns
    )
    return replace(stream, columns=columns)
