"""Pattern files of OpenHRP: the joints' positions of ``.pos``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.errors import MotionError
from excite.motion.readers.reader import DAMAGED, MAX_FILE_BYTES, MotionReader, RawMotion, unreadable
from excite.motion.readers.remarks import named_joints, of_robot
from excite.reading.file import check_file
from excite.reading.json_document import read_json

STATEMENT = "excite.json"
"""What a folder of patterns says of itself, where export wrote it."""


class OpenHrpReader(MotionReader):
    """A ``.pos`` file, or a folder with one: a time, then the joints as ``excite.json`` or the robot has them."""

    name: ClassVar[str] = "openhrp"
    summary: ClassVar[str] = "OpenHRP/Choreonoid pattern .pos"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        return path.suffix == ".pos" or (path / STATEMENT).is_file()

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        files = sorted(path.glob("*.pos")) if path.is_dir() else [path]
        if len(files) != 1:
            raise MotionError(f"holds {len(files)} patterns .pos", source=path, remedy="name one of them")
        (file,) = files
        check_file(file, limit=MAX_FILE_BYTES, error=MotionError)
        said: Mapping[str, Any] = {}
        if (file.parent / STATEMENT).is_file():
            said = read_json(file.parent / STATEMENT, error=MotionError)
        try:
            rows = np.loadtxt(file, ndmin=2)
        except DAMAGED as error:
            raise unreadable(file, error) from error
        names = named_joints(said, joints)
        if names and rows.shape[1] != 1 + len(names):
            raise MotionError(
                f"has {rows.shape[1] - 1} joints, not {len(names)}", source=file, remedy="check the robot"
            )
        columns = {f"q.{joint}": rows[:, 1 + i] for i, joint in enumerate(names)}
        return RawMotion({"time": rows[:, 0], **columns}, of_robot(said))
