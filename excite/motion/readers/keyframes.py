"""Keyframes of MuJoCo that say which joints they are of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from excite.errors import MotionError
from excite.motion.readers.reader import MotionReader, RawMotion, unreadable
from excite.motion.readers.remarks import of_robot
from excite.reading.file import first_bytes
from excite.reading.json_document import parse_json
from excite.reading.xml_document import read_xml

STATEMENT = "excite"
"""How the name of the custom text begins that says whose motion the keys are."""

# Remarks and the statement stand above the keys; a statement holds a verdict.
_BEGINNING = 1 << 18


class KeyframesReader(MotionReader):
    """Files of keys that export writes: the joints and their addresses stand in a custom text."""

    name: ClassVar[str] = "mujoco-keyframes"
    summary: ClassVar[str] = "MuJoCo keyframes that export wrote"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        if path.suffix != ".xml":
            return False
        start = first_bytes(path, _BEGINNING)
        return f'<custom><text name="{STATEMENT}.'.encode() in start

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        root = read_xml(path, error=MotionError)
        try:
            said = parse_json(root.find("custom/text").get("data", ""))  # type: ignore[union-attr]
            names, places = said["joints"], {"qpos": said["qpos"], "qvel": said["qvel"]}
            keys = root.findall("keyframe/key")
            columns: dict[str, NDArray[Any]] = {"time": _key_numbers(keys, "time")[:, 0]}
            for channel, field in (("q", "qpos"), ("v", "qvel")):
                values = _key_numbers(keys, field)
                columns |= {
                    f"{channel}.{joint}": values[:, int(place)]
                    for joint, place in zip(names, places[field], strict=True)
                }
            for joint, zero in zip(names, said["zero"], strict=True):
                columns[f"q.{joint}"] = columns[f"q.{joint}"] - float(zero)
        except (ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError) as error:
            raise unreadable(path, error) from error
        return RawMotion(columns, of_robot(said))


def _key_numbers(keys: Sequence[Element], field: str) -> NDArray[Any]:
    """An attribute of every key, ``(n, width)``."""
    return np.array([[float(value) for value in key.get(field, "").split()] for key in keys], ndmin=2)
