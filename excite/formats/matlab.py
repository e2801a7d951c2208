"""MATLAB's ``.mat``: variables, structs and tables taken apart, version 7.3 through HDF5."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.errors import InputError
from excite.formats.file import first_bytes
from excite.formats.hdf5 import hdf5_arrays

# Structs within structs; Simulink's logs have four.
_DEEPEST = 8
# Fields by which structs call themselves: name, label, jointName, joint_name.
_NAMES = re.compile(r"(?:^|[^A-Za-z])(?:name|label)(?![a-z])|(?:Name|Label)(?![a-z])|^(?:NAME|LABEL)$")


def read_mat(path: Path, error: type[InputError] = InputError) -> dict[str, NDArray[Any]]:
    """Variables of numbers and texts, those in structs and tables too, by their paths; raises ``error``."""
    start = first_bytes(path, 520)
    if start[512:].startswith(b"\x89HDF") or start.startswith((b"\x89HDF", b"MATLAB 7.3")):
        return hdf5_arrays(path, error)
    from scipy.io import loadmat

    content = loadmat(path, simplify_cells=True)
    workspace = content.get("__function_workspace__")
    tables = {} if workspace is None else tables_of(path, workspace)
    found: dict[str, NDArray[Any]] = {}
    for name, value in [*content.items(), *tables.items()]:
        if not name.startswith("__"):
            _collect_variables(name, value, found, 0)
    return found


def _collect_variables(name: str, value: object, found: dict[str, NDArray[Any]], depth: int) -> None:
    if depth > _DEEPEST:
        return
    if isinstance(value, dict):
        for key, inner in value.items():
            _collect_variables(f"{name}/{key}", inner, found, depth + 1)
    elif _is_texts(value):
        found[name] = np.array([str(word).strip() for word in np.ravel(np.asarray(value, dtype=object))])
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        found[name] = value
    elif isinstance(value, list | np.ndarray):
        members = list(np.ravel(value)) if isinstance(value, np.ndarray) else value
        called = _own_names(members)
        for k, inner in enumerate(members):
            _collect_variables(f"{name}/{called[k]}" if called else f"{name}{k + 1}", inner, found, depth + 1)
    elif isinstance(value, int | float):
        found[name] = np.asarray(value)


def _own_names(members: list[Any]) -> list[str]:
    """What structs of an array call themselves (``name``, ``label``, ``jointName``); empty unless each has its own."""
    if len(members) < 2 or not all(isinstance(one, dict) for one in members):
        return []
    for key in members[0]:
        if not _NAMES.search(key):
            continue
        said = [one.get(key) for one in members]
        names = [word.strip().replace("/", "_") for word in said if isinstance(word, str)]
        if len(names) == len(members) == len(set(names)) and all(names):
            return names
    return []


def _is_texts(value: object) -> bool:
    """Whether it is a cell array of texts, or a table of characters with one in each row."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "U":
        return True
    return (
        isinstance(value, list | np.ndarray)
        and len(np.shape(value)) > 0
        and len(value) > 0
        and all(isinstance(word, str) for word in np.ravel(np.asarray(value, dtype=object)))
    )


# MATLAB's tables and timetables in a ``.mat`` file of version 7, which packs what is no array into a part of
# its own.
#
# A variable that is an object holds a number alone. What belongs to the number stands in the file's last
# element, the workspace of functions: a file within the file, of one cell array. Its first cell says which of
# the others are which property of which object; names, classes and objects are numbered from one.

_HEADER, _NAMES_AT, _COMPRESSED = 128, 40, 15
# Where an object's reference says its number: behind a mark, the number of axes and the axes.
_MARK = 0xDD000000
# Cells in front of the properties' values; a value that stands in a cell of its own.
_BEFORE, _IN_CELL = 2, 1
# Words that the list of an object has, and that of a property.
_OBJECT, _PROPERTY = 6, 3


@dataclass(frozen=True, eq=False)
class Objects:
    """Objects of a file.

    Attributes:
        cells: of the workspace.
        properties: by an object's number, the numbers of its properties' cells by their names.
    """

    cells: tuple[Any, ...]
    properties: Mapping[int, Mapping[str, int]]

    @classmethod
    def of(cls, workspace: NDArray[Any]) -> Objects:
        """From the bytes of a file's workspace, as ``scipy.io.loadmat`` gives them."""
        packed = workspace.tobytes()
        inner = next(_read_variables(b" " * (_HEADER - 4) + packed[:4] + packed[8:]))
        cells = inner["__function_workspace__"][0, 0]["MCOS"][0]["arr"].ravel()
        return cls(tuple(cells), _object_properties(cells[0].tobytes()))

    def table(self, reference: Any) -> dict[str, Any] | None:
        """Columns of a table by name, a timetable's times as ``Time`` [s]; None for another object."""
        held = self._held(reference)
        if {"data", "varnames"} <= held.keys():
            return dict(zip(_read_words(held["varnames"]), self._columns(held["data"]), strict=False))
        if "any" in held and (held["any"].dtype.names or ()):
            inside = held["any"].ravel()[0]
            columns = dict(zip(_read_words(inside["varNames"]), self._columns(inside["data"]), strict=False))
            times = self._times(inside["rowTimes"], int(np.ravel(inside["numRows"])[0]))
            return columns if times is None else {"Time": times} | columns
        return None

    def _held(self, reference: Any) -> dict[str, Any]:
        """Values of an object's properties by name."""
        words = np.ravel(reference)
        if len(words) < 2 or words[0] != _MARK:
            return {}
        number = int(words[2 + int(words[1])])
        return {name: self.cells[at] for name, at in self.properties.get(number, {}).items()}

    def _columns(self, cells: Any) -> list[Any]:
        columns = []
        for cell in cells.ravel():
            seconds = self._seconds(cell)
            columns.append(cell if seconds is None else seconds)
        return columns

    def _seconds(self, value: Any) -> NDArray[Any] | None:
        """A duration or date in seconds; None for anything else."""
        held = self._held(_object_reference(value))
        stamp = held.get("millis", held.get("data"))
        if stamp is None or stamp.dtype.kind not in "fc":
            return None
        # Dates of more digits than a number has keep the rest in the imaginary part.
        return np.asarray(1e-3 * (np.real(stamp) + np.imag(stamp)), dtype=float).ravel()

    def _times(self, rows: Any, count: int) -> NDArray[Any] | None:
        """Times of a timetable's rows [s]: each of them, or the first with a step or a rate."""
        seconds = self._seconds(rows)
        if seconds is not None or not (rows.dtype.names or ()):
            return seconds
        even = rows.ravel()[0]
        first = self._seconds(even["origin"])
        step = self._seconds(even["stepSize"]) if "stepSize" in rows.dtype.names else None
        if step is None or not np.isfinite(step).all() or not step.any():
            step = 1.0 / np.ravel(even["sampleRate"]).astype(float)
        return np.asarray((0.0 if first is None else first[0]) + step[0] * np.arange(count))


def tables_of(path: Path, workspace: NDArray[Any]) -> dict[str, dict[str, Any]]:
    """Tables and timetables of a file by the names of their variables.

    Args:
        path: the file, of version 7.
        workspace: its bytes that ``scipy.io.loadmat`` calls the function workspace.
    """
    objects = Objects.of(workspace)
    found = {}
    for variable in _read_variables(path.read_bytes()):
        # Of a variable that is an object the name stands in its first field.
        fields = variable.get("None")
        if fields is None or "arr" not in (fields.dtype.names or ()):
            continue
        table = objects.table(fields[0]["arr"])
        if table is not None:
            found[fields[0]["s0"].decode()] = table
    return found


def _read_variables(data: bytes) -> Iterator[dict[str, Any]]:
    """A file's variables, each read alone: of several objects scipy keeps the last one."""
    from scipy.io import loadmat

    order = "<" if data[_HEADER - 2 : _HEADER] == b"IM" else ">"
    at = _HEADER
    while at + 8 <= len(data):
        kind, size = (int(word) for word in np.frombuffer(data, order + "u4", 2, at))
        yield loadmat(io.BytesIO(data[:_HEADER] + data[at : at + 8 + size]))
        at += 8 + (size if kind == _COMPRESSED else -(-size // 8) * 8)


def _object_reference(value: Any) -> Any:
    """What a value that is an object refers to it by; the value itself where it is none."""
    return value[0]["arr"] if "arr" in (getattr(value.dtype, "names", None) or ()) else value


def _object_properties(packed: bytes) -> dict[int, dict[str, int]]:
    """Numbers of the cells that hold each object's properties."""
    words = np.frombuffer(packed, "<u4", len(packed) // 4)
    names = packed[_NAMES_AT:].split(b"\0", int(words[1]))
    _, saved, objects, plain, end = (int(at) // 4 for at in words[2:7])
    lists = [_property_lists(words[first:last]) for first, last in ((saved, objects), (plain, end))]
    found = {}
    for number, at in enumerate(range(objects + _OBJECT, plain - _OBJECT + 1, _OBJECT), start=1):
        of_saved, of_plain = (int(word) for word in words[at + 3 : at + 5])
        held = lists[0][of_saved] if of_saved else lists[1][of_plain]
        found[number] = {
            names[int(name) - 1].decode(): int(value) + _BEFORE
            for name, kind, value in held
            if kind == _IN_CELL
        }
    return found


def _property_lists(words: NDArray[Any]) -> list[NDArray[Any]]:
    """Lists of properties, each behind its length and filled up to pairs of words."""
    found, at = [], 0
    while at < len(words):
        count = int(words[at])
        found.append(words[at + 1 : at + 1 + _PROPERTY * count].reshape(-1, _PROPERTY))
        at += 1 + _PROPERTY * count
        at += at % 2
    return found


def _read_words(cells: Any) -> list[str]:
    return [str(np.ravel(cell)[0]) if np.size(cell) else "" for cell in cells.ravel()]
