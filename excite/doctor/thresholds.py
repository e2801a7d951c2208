"""Thresholds of the doctor: one table, ``thresholds.csv``, with what set each of them."""

from __future__ import annotations

import csv
from importlib.resources import files
from types import SimpleNamespace


def read_table(name: str) -> list[dict[str, str]]:
    """Rows of a table that lies beside this module."""
    text = (files("excite.doctor") / name).read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))


THRESHOLD = SimpleNamespace(**{row["name"]: float(row["value"]) for row in read_table("thresholds.csv")})


def is_near_one(factor: float, within: float) -> bool:
    """Whether a factor lies between ``1 / within`` and ``within``."""
    return 1.0 / within < factor < within
