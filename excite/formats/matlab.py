"""MATLAB's ``.mat``: variables and structs taken apart, version 7.3 through HDF5."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.errors import InputError
from excite.formats.file import DEEPEST, first_bytes
from excite.formats.hdf5 import hdf5_arrays

# Fields by which structs call themselves: name, label, jointName, joint_name.
_NAMES = re.compile(r"(?:^|[^A-Za-z])(?:name|label)(?![a-z])|(?:Name|Label)(?![a-z])|^(?:NAME|LABEL)$")


def read_mat(path: Path) -> dict[str, NDArray[Any]]:
    """Variables of numbers and texts, those in structs too, by their paths.

    Raises:
        InputError: it holds objects alone, such as tables.
    """
    start = first_bytes(path, 520)
    if start[512:].startswith(b"\x89HDF") or start.startswith((b"\x89HDF", b"MATLAB 7.3")):
        return hdf5_arrays(path)
    from scipy.io import loadmat

    content = loadmat(path, simplify_cells=True)
    found: dict[str, NDArray[Any]] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _collect_variables(name, value, found, 0)
    if not found and "__function_workspace__" in content:
        raise InputError(
            "holds objects of MATLAB alone, such as tables",
            source=path,
            remedy="save their columns: s = table2struct(timetable2table(t), ToScalar=true); save run.mat -struct s",
        )
    return found


def _collect_variables(name: str, value: object, found: dict[str, NDArray[Any]], depth: int) -> None:
    if depth > DEEPEST:
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
