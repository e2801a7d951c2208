"""Thresholds of the doctor: one table, ``thresholds.csv``, with what set each of them."""

from __future__ import annotations

from types import SimpleNamespace

from excite.data_tables import read_rows

THRESHOLD = SimpleNamespace(
    **{row["name"]: float(row["value"]) for row in read_rows(__file__, "thresholds.csv")}
)


def is_near_one(factor: float, within: float) -> bool:
    """Whether a factor lies between ``1 / within`` and ``within``."""
    return 1.0 / within < factor < within
