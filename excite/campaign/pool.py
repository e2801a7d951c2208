"""Accepted motions to choose from: what the choice looks at in memory, motions and R factors on disk."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Generic, TypeVar, overload

import numpy as np

from excite.arrays import Array, Indices
from excite.errors import InputError
from excite.excitation.conditioning import (
    MotionFactor,
    Ranking,
    motion_factor,
    segment_columns,
    segment_conditions,
)
from excite.motion.motion import Motion
from excite.regressor.base_parameters import BaseParameters, structural_base_parameters
from excite.regressor.columns import measured_columns
from excite.robot.robot import Robot
from excite.temporary_folder import TemporaryFolder
from excite.threads import one_blas_thread


@dataclass(frozen=True, eq=False, slots=True)
class Accepted:
    """What is known of an accepted motion without reading it; where its files are follows from its name, since a path
    takes more memory than all else here.

    Attributes:
        name: of the motion.
        generator: registry name of its generator.
        duration_s: [s]
        conditions: ``(n_segments, 2)`` condition numbers of its segments' sub-regressors, and their smallest singular
            values [SI].
    """

    name: str
    generator: str
    duration_s: float
    conditions: Array


@dataclass(frozen=True)
class Keeper:
    """Judges an accepted motion and puts it on disk, in the process that made it.

    Attributes:
        folder: where to.
        prefix: put before the motion's name.
    """

    folder: Path
    prefix: str = ""

    @one_blas_thread
    def __call__(self, robot: Robot, motion: Motion) -> Accepted:
        """Write a motion and its R factor; raises InputError where that cannot be done."""
        motion = motion.renamed(self.prefix + motion.name)
        factor = motion_factor(robot, motion, base=_pool_base_parameters(robot))
        write_value(motion, _motion_file(self.folder, motion.name))
        write_value(factor, _factor_file(self.folder, motion.name))
        return Accepted(
            name=motion.name,
            generator=motion.metadata.generator,
            duration_s=motion.duration,
            conditions=np.array(
                [
                    (c.condition, c.smallest)
                    for c in segment_conditions(factor.matrix, _segment_columns(robot))
                ]
            ),
        )


@dataclass(frozen=True, eq=False)
class Pool:
    """Motions to choose from, in the order of the candidates.

    Attributes:
        entries: one a motion.
        folder: that of their files.
        segments: names of the segments that motions are ranked by, in the order of their conditions.
    """

    entries: tuple[Accepted, ...]
    folder: TemporaryFolder
    segments: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the motions."""
        return tuple(entry.name for entry in self.entries)

    @property
    def durations(self) -> Array:
        """``(n_motions,)`` [s]."""
        return np.array([entry.duration_s for entry in self.entries])

    @property
    def motions(self) -> OnDisk[Motion]:
        """The motions."""
        return OnDisk(tuple(_motion_file(self.folder.path, name) for name in self.names), self.folder)

    @property
    def factors(self) -> OnDisk[MotionFactor]:
        """Their R factors."""
        return OnDisk(tuple(_factor_file(self.folder.path, name) for name in self.names), self.folder)

    @property
    def ranking(self) -> Ranking:
        """Condition numbers of each segment in each motion."""
        conditions = np.array([entry.conditions for entry in self.entries])
        return Ranking(self.names, self.segments, conditions[:, :, 0], conditions[:, :, 1])

    def without(self, fallen: set[str]) -> Pool:
        """The pool without motions of these names."""
        return replace(self, entries=tuple(entry for entry in self.entries if entry.name not in fallen))

    def in_turn(self) -> list[int]:
        """Indices of the motions, generators taken in turn."""
        place: dict[str, int] = {}
        keys = []
        for index, entry in enumerate(self.entries):
            place[entry.generator] = place.get(entry.generator, 0) + 1
            keys.append((place[entry.generator], index))
        return [index for _, index in sorted(keys)]

    def first_seconds(self, seconds: float) -> list[int]:
        """The first motions whose durations add up to at least ``seconds``, generators taken in turn."""
        taken: list[int] = []
        for index in self.in_turn():
            if sum(self.entries[i].duration_s for i in taken) >= seconds:
                break
            taken.append(index)
        return sorted(taken)


def _motion_file(folder: Path, name: str) -> Path:
    return folder / f"{name}.motion"


def _factor_file(folder: Path, name: str) -> Path:
    return folder / f"{name}.factor"


def ranked_segments(robot: Robot) -> tuple[str, ...]:
    """Names of the segments that motions of a robot are ranked by."""
    return tuple(_segment_columns(robot))


@lru_cache(maxsize=4)
def _pool_base_parameters(robot: Robot) -> BaseParameters:
    return structural_base_parameters(robot)


@lru_cache(maxsize=4)
def _segment_columns(robot: Robot) -> dict[str, Indices]:
    return segment_columns(robot, measured_columns(robot), _pool_base_parameters(robot))


# Values that wait in files of a temporary folder, so that memory does not grow with their number.

T = TypeVar("T")


def write_value(value: object, path: Path) -> Path:
    """Write a value, bit for bit.

    Raises:
        InputError: the disk is full, or the folder is gone.
    """
    try:
        with path.open("wb") as file:
            pickle.dump(value, file, protocol=pickle.HIGHEST_PROTOCOL)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror})",
            source=path,
            remedy="set TMPDIR to a folder with room: a candidate takes up to 5 MB",
        ) from error
    return path


def read_value(path: Path) -> Any:
    """A value from :func:`write_value`.

    Raises:
        InputError: this machine does not see the file.
    """
    try:
        with path.open("rb") as file:
            return pickle.load(file)  # noqa: S301  (written by this run, in a folder of its own)
    except OSError as error:
        raise InputError(
            f"cannot be read ({error.strerror})",
            source=path,
            remedy="leave the temporary folder alone; with several machines, set TMPDIR to one that they share",
        ) from error


@dataclass(frozen=True, eq=False)
class OnDisk(Sequence[T], Generic[T]):
    """A sequence whose values are read anew at each access.

    Attributes:
        files: one a value, from :func:`write_value`.
        folder: what keeps them there.
    """

    files: tuple[Path, ...]
    folder: TemporaryFolder

    def __len__(self) -> int:
        """Number of values."""
        return len(self.files)

    @overload
    def __getitem__(self, index: int) -> T: ...

    @overload
    def __getitem__(self, index: slice) -> OnDisk[T]: ...

    def __getitem__(self, index: int | slice) -> T | OnDisk[T]:
        """One value; of a slice, the sequence of its values."""
        if isinstance(index, slice):
            return OnDisk(self.files[index], self.folder)
        value: T = read_value(self.files[index])
        return value

    def only(self, indices: Iterable[int]) -> OnDisk[T]:
        """Those at some places, still on disk."""
        return OnDisk(tuple(self.files[i] for i in indices), self.folder)
