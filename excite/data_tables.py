"""Tables of data that lie beside the modules which read them."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path


@cache
def read_rows(beside: str, name: str) -> list[dict[str, str]]:
    """Rows of a CSV file in a module's folder by their columns; ``beside`` is the module's ``__file__``.

    Lines that begin with ``#`` are comments.
    """
    with Path(beside).with_name(name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))
