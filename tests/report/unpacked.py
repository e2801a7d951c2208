"""Tables of a page's replay as numbers again."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.report.replay.tracks import _UNKNOWN


def unpack_table(block: dict[str, Any]) -> Array:
    """The table of :func:`pack_table`, ``(n, m)``."""
    low, step = np.array(block["low"]), np.array(block["step"])
    numbers = np.frombuffer(zlib.decompress(base64.b64decode(block["data"])), "<u2")
    numbers = np.cumsum(numbers.reshape(len(low), block["rows"]).T, axis=0, dtype=np.uint16)
    return np.where(numbers == _UNKNOWN, np.nan, low + step * numbers)
