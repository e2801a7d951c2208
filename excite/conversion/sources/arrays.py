"""Recordings of arrays by name, whichever format holds them: one a trial where groups or stacks say so."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Column, Recording, Stream
from excite.conversion.shapes import longest_streams, stream_of_arrays
from excite.conversion.sources.source import Source
from excite.formats.arrays import read_npy, read_npz
from excite.formats.arrow import parquet_arrays
from excite.formats.file import MAX_FILE_BYTES, check_size, first_bytes
from excite.formats.hdf5 import MOST_CONSTANTS, hdf5_arrays
from excite.formats.lerobot import COUNTING, DataSet, is_data_set, read_data_set
from excite.formats.matlab import read_mat
from excite.formats.tensors import read_torch

Arrays = Mapping[str, Any]
_NUMBERS = "write its arrays one by one, numbers only: numpy.savez(file, q=…, tau=…)"


class ArraySource(Source):
    """Arrays by name, those of groups by their paths.

    Attributes:
        suffixes: of files.
        beginnings: how files begin, whatever they are called.
        grouped: whether groups and stacks of arrays are recordings of their own.
        arrays: reads a file's arrays by name.
    """

    own_process: ClassVar[bool] = True
    suffixes: ClassVar[tuple[str, ...]]
    beginnings: ClassVar[tuple[bytes, ...]] = ()
    grouped: ClassVar[bool] = True
    arrays: ClassVar[Callable[[Path], Arrays]]

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return path.is_file() and (
            path.suffix.lower() in self.suffixes or first_bytes(path, 8).startswith(self.beginnings)
        )

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        arrays = type(self).arrays(path)
        if self.grouped:
            return recordings_of(path, arrays)
        return (Recording(str(path), path.stem, longest_streams(stream_of_arrays(path.stem, arrays))),)


def _read_numpy(path: Path) -> Arrays:
    if path.suffix.lower() == ".npy":
        return read_npy(path)
    return read_npz(path, limit=MAX_FILE_BYTES, longest_text=100_000, remedy=_NUMBERS)


def _source(
    name: str, what: str, summary: str, suffixes: str, arrays: Callable[[Path], Arrays], **more: Any
) -> Any:
    """A source of a format, by what sets it apart from others."""
    own = {"name": name, "what": what, "summary": summary, "suffixes": tuple(suffixes.split())}
    return type(f"{name.title()}Source", (ArraySource,), own | {"arrays": staticmethod(arrays), **more})


MatSource = _source(
    *("mat", "a .mat file", "MATLAB (.mat, version 7.3 too)", ".mat", lambda path: read_mat(path)),
    beginnings=(b"MATLAB",),
)
Hdf5Source = _source(
    *("hdf5", "HDF5", "HDF5 (.h5, .hdf5)", ".h5 .hdf5", lambda path: hdf5_arrays(path)),
    beginnings=(b"\x89HDF\r\n\x1a\n",),
)
ParquetSource = _source(
    *("parquet", "a Parquet file", "Parquet (.parquet)"),
    *(".parquet .pq", lambda path: parquet_arrays(path)),
    beginnings=(b"PAR1",),
    grouped=False,
)
NpzSource = _source(
    *("npz", "a numpy array", "numpy arrays (.npz, .npy)", ".npz .npy", _read_numpy), own_process=False
)
PaceSource = _source(
    *("pace", "tensors of torch", "tensors saved by torch (.pt, .pth), as PACE writes them", ".pt .pth"),
    read_torch,
)


def recordings_of(path: Path, arrays: Arrays) -> tuple[Recording, ...]:
    """Recordings among arrays by their paths (``trial1/q``): one a trial where they lie in groups."""
    check_size(sum(np.size(values) for values in arrays.values()), 0, path)
    groups = _trial_groups(dict(arrays)) or {path.stem: dict(arrays)}
    return tuple(
        Recording(
            str(path),
            group or path.stem,
            longest_streams(stream_of_arrays(group or path.stem, members)),
            constants(members),
        )
        for group, members in groups.items()
    )


def _trial_groups(arrays: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Data sets of each trial by its group, however deep the groups lie; empty where there are no such groups."""
    groups: dict[str, dict[str, Any]] = {}
    for name, values in arrays.items():
        group, _, rest = name.partition("/")
        groups.setdefault(group if rest else "", {})[rest or name] = values
    shared = groups.pop("", {})
    if not _is_constant(shared):
        return {}
    # What describes the recordings (``info``, ``meta``) is none of them.
    for group in [group for group, members in groups.items() if _is_constant(members)]:
        shared |= {f"{group}/{name}": values for name, values in groups.pop(group).items()}
    if len(groups) == 1:
        ((group, members),) = groups.items()
        return {name: shared | inner for name, inner in _trial_groups(members).items()}
    inner = [frozenset(found) for found in groups.values()]
    if not inner or 2 * len(frozenset.intersection(*inner)) < len(frozenset.union(*inner)):
        return {}
    # Logs of a simulation have a group a signal, each with the same fields in it.
    said = [read_clue(group, ()).quantity for group in groups]
    if len(set(said)) > 1 and all(said):
        return {}
    return {group: shared | members for group, members in groups.items()}


def _is_constant(members: dict[str, Any]) -> bool:
    """Whether no data set is long enough for a signal."""
    return all(np.size(values) <= MOST_CONSTANTS for values in members.values())


def constants(arrays: dict[str, np.ndarray]) -> dict[str, object]:
    """Numbers and short lists of numbers among arrays, as lists; words as text."""
    said: dict[str, object] = {}
    for name, values in arrays.items():
        array = np.asarray(values)
        if array.dtype.kind in "fiuU" and array.size <= MOST_CONSTANTS:
            said[name] = np.squeeze(array).tolist()
    return said


# What each feature holds for a follower arm.
_CHANNELS = {
    "observation.state": "q",
    "action": "q_cmd",
    "observation.velocity": "v",
    "observation.effort": "tau",
}
# Names of a feature's numbers may say what each is: arms that report more than positions have it in one state
# (``joint_1.pos``, ``joint_1.vel``, ``joint_1.torque`` of OpenArm). Commands of velocities have no channel in a log.
_ENDINGS = {
    ".pos": {"q": "q", "q_cmd": "q_cmd"},
    ".vel": {"q": "v", "v": "v"},
    ".effort": {"q": "tau", "q_cmd": "tau_cmd", "tau": "tau"},
    ".torque": {"q": "tau", "q_cmd": "tau_cmd", "tau": "tau"},
    ".current": {"q": "i", "tau": "i"},
}


class LeRobotSource(Source):
    """Episodes as recordings; states are positions, actions their commands."""

    name: ClassVar[str] = "lerobot"
    summary: ClassVar[str] = "LeRobot data sets (folder with meta/info.json)"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        return is_data_set(path)

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        return tuple(recordings_of_episodes(read_data_set(path)))


def recordings_of_episodes(data: DataSet) -> Iterator[Recording]:
    """The episodes of a data set, one after the other."""
    fps = data.fps
    note = f"{fps:g} rows a second: inertia and friction of slow motion show, delays and rotors do not"
    said = {"fps": fps or None, "maybe_shares": True}
    for episode, arrays in data.episodes():
        name, time = f"episode_{episode:06d}", arrays.pop("time", None)
        columns = tuple(_feature_columns(data, arrays))
        streams = (Stream(name, columns, time),) if columns else ()
        yield Recording(str(data.path), name, streams, said, (note,) if fps else ())


def _feature_columns(data: DataSet, arrays: dict[str, Any]) -> list[Column]:
    found = []
    for name, values in arrays.items():
        if name in COUNTING:
            continue
        labels = data.names(name)
        values = values.reshape(len(values), -1)
        channel = _CHANNELS.get(name, "")
        for k in range(values.shape[1]):
            label = labels[k] if k < len(labels) else str(k)
            ending = next((word for word in _ENDINGS if label.endswith(word)), "")
            what = _ENDINGS[ending].get(channel, "") if ending else channel
            found.append(
                Column(f"{name}.{label}", values[:, k].astype(float), what, label.removesuffix(ending))
            )
    return found
