"""MATLAB's ``.mat``: variables, structs and tables taken apart, version 7.3 through HDF5; ``timeseries`` as structs."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.columns.words import name_tokens
from excite.conversion.recording import Recording
from excite.conversion.sources.hdf5 import hdf5_arrays, recordings_of
from excite.conversion.sources.matlab.objects import tables_of
from excite.conversion.sources.source import MAX_SOURCE_BYTES, Source, damaged
from excite.errors import LogError
from excite.reading.file import check_file, first_bytes

# Structs within structs; Simulink's logs have four.
_DEEPEST = 8


class MatSource(Source):
    """Variables of numbers, and those in structs, by their paths."""

    name: ClassVar[str] = "mat"
    summary: ClassVar[str] = "MATLAB (.mat, version 7.3 too)"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return path.is_file() and (path.suffix.lower() == ".mat" or first_bytes(path, 6) == b"MATLAB")

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        check_file(path, limit=MAX_SOURCE_BYTES, error=LogError)
        start = first_bytes(path, 520)
        if start[512:].startswith(b"\x89HDF") or start.startswith((b"\x89HDF", b"MATLAB 7.3")):
            return recordings_of(path, hdf5_arrays(path))
        from scipy.io import loadmat
        from scipy.io.matlab import MatReadError

        try:
            content = loadmat(path, simplify_cells=True)
            workspace = content.get("__function_workspace__")
            tables = {} if workspace is None else tables_of(path, workspace)
        except (
            OSError,
            ValueError,
            TypeError,
            MatReadError,
            NotImplementedError,
            KeyError,
            IndexError,
            MemoryError,
        ) as error:
            raise damaged(path, error, "a .mat file") from error
        found: dict[str, Any] = {}
        for name, value in [*content.items(), *tables.items()]:
            if not name.startswith("__"):
                _collect_variables(name, value, found, 0)
        return recordings_of(path, found)


def _collect_variables(name: str, value: object, found: dict[str, Any], depth: int) -> None:
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
        if not {"name", "label"} & set(name_tokens(key)):
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
