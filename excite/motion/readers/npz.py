"""npz archives: ``excite.motion/1`` with an array a channel, and the matrices that are exported for controllers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.errors import MotionError
from excite.motion.content import BASE_ACCELERATION, BASE_POSE, BASE_TWIST
from excite.motion.readers.reader import MAX_FILE_BYTES, MotionReader, RawMotion, of_ours, unreadable
from excite.reading.json_document import parse_json
from excite.reading.npz_arrays import read_npz

METADATA = "__metadata__"
# Metadata with a verdict of some hundred violations.
_LONGEST_METADATA = 1_000_000
_MATRICES = {"q": "q", "v": "v", "a": "a"}
_BASE = {"base_pose": BASE_POSE, "base_twist": BASE_TWIST, "base_acceleration": BASE_ACCELERATION}


class NpzReader(MotionReader):
    """Arrays ``time``, ``q.JOINT`` … with metadata; or ``joint_names`` and matrices ``time``, ``q``, ``v``, ``a``."""

    name: ClassVar[str] = "npz"
    summary: ClassVar[str] = "excite.motion/1 in an npz archive, or the matrices that export writes"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        return path.suffix == ".npz"

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        arrays = read_npz(
            path,
            limit=MAX_FILE_BYTES,
            longest_text=_LONGEST_METADATA,
            remedy="check that the file is complete",
            error=MotionError,
        )
        if not arrays:
            raise MotionError("holds no arrays", source=path, remedy="give a motion")
        text = arrays.pop(METADATA, None)
        if "joint_names" in arrays:
            said: dict[str, str] = {
                name: str(arrays.pop(name)) for name in ("robot", "robot_hash") if name in arrays
            }
            return RawMotion(
                _matrix_columns(arrays, path), said if text is None else _parse_metadata(text, path)
            )
        if text is None:
            raise MotionError(
                "has neither metadata nor joint_names", source=path, remedy="add joint_names, or write a CSV"
            )
        # Written by numpy for its own option of that name.
        arrays.pop("allow_pickle", None)
        return RawMotion(arrays, of_ours(_parse_metadata(text, path)))


def _parse_metadata(text: NDArray[Any] | None, path: Path) -> Any:
    try:
        return {} if text is None else parse_json(str(text))
    except (ValueError, RecursionError) as error:
        raise unreadable(path, error) from error


def _matrix_columns(arrays: dict[str, NDArray[Any]], path: Path) -> dict[str, NDArray[Any]]:
    """Columns of matrices."""
    names = [str(name) for name in np.ravel(arrays.pop("joint_names"))]
    columns: dict[str, NDArray[Any]] = {}
    groups = {name: [f"{prefix}.{joint}" for joint in names] for name, prefix in _MATRICES.items()}
    for name, wanted in {**groups, **_BASE}.items():
        if name not in arrays:
            continue
        values = arrays.pop(name)
        if values.ndim != 2 or values.shape[1] != len(wanted):
            raise MotionError(
                f"has the shape {values.shape}, not (n, {len(wanted)})",
                source=path,
                field=name,
                remedy="write one column a joint",
            )
        columns |= {column: values[:, i] for i, column in enumerate(wanted)}
    return columns | arrays
