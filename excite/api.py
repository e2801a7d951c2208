"""Names that ``import excite`` offers in groups: each group is a module, and what is in it is loaded on first use."""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any

from excite.data_tables import read_rows

_ROWS = read_rows(__file__, "api.csv")
SPACES = {
    group: {row["name"]: row["module"] for row in _ROWS if row["group"] == group}
    for group in dict.fromkeys(row["group"] for row in _ROWS)
}
PUBLIC = SPACES.pop("")
"""The module that defines each name that is in no group; by group, likewise, are SPACES."""

_ABOUT = {
    "robots": "Robots of one's own: first descriptions, what is wrong with one, and a log's robot.",
    "recordings": "What is done with recordings beside loading and converting: their delays, parts.",
    "methods": "How parameters are identified: estimators and settings, bounds, sessions, residuals.",
    "models": "Models of robots with what was identified in them, file by file, and how uncertain they are.",
    "loads": "Loads: what an arm carries, from logs without and with it.",
    "people": "People: their model and log from markers and force plates.",
    "catalogue": "What there is to choose from: robots, methods, effects, schemas of files, members of one's own.",
}


class Group(ModuleType):
    """A module whose names are defined elsewhere.

    Args:
        name: of the group.
    """

    def __init__(self, name: str) -> None:
        super().__init__(f"excite.{name}", _ABOUT[name])
        self._names = SPACES[name]
        self.__all__ = list(self._names)

    def __getattr__(self, name: str) -> Any:
        where = self._names.get(name)
        if where is None:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return getattr(importlib.import_module(where), name)

    def __dir__(self) -> list[str]:
        return sorted(self._names)


def groups() -> dict[str, Group]:
    """All groups by name, so that they can be imported by that too."""
    made = {name: Group(name) for name in SPACES}
    sys.modules.update({group.__name__: group for group in made.values()})
    return made
