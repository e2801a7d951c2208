"""The plain programs that can enter the benchmark beside ``excite diagnose``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.blind.entry.alone import fitted_alone
from benchmarks.blind.entry.mujoco_sysid import fitted_by_sysid

PROGRAMS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "alone": fitted_alone,
    "mujoco-sysid": fitted_by_sysid,
}
"""From the folder of a log to an answer (``excite.blind_answer/1``), by name."""
