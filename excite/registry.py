"""Members of an axis by name, each loaded when it is asked for: their names cost nothing, as help texts need it."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from typing import Generic, TypeVar

from excite.errors import UnknownNameError

Member = TypeVar("Member")


class Registry(Mapping[str, type[Member]], Generic[Member]):
    """Classes by name; a new one is a file and a line.

    Args:
        kind: what a member is, for errors.
        members: ``package.module:Class`` by the name that the class says itself (``name``).
    """

    def __init__(self, kind: str, members: Mapping[str, str]) -> None:
        self._kind, self._members = kind, dict(members)

    def __getitem__(self, name: str) -> type[Member]:
        module, _, word = self._members[name].partition(":")
        found: type[Member] = getattr(importlib.import_module(module), word)
        return found

    def __contains__(self, name: object) -> bool:
        return name in self._members

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)

    def find(self, name: str) -> type[Member]:
        """The member of that name; raises UnknownNameError."""
        if name not in self:
            raise UnknownNameError(self._kind, name, sorted(self))
        return self[name]

    def make(self, name: str) -> Member:
        """One of the member of that name; raises UnknownNameError."""
        return self.find(name)()
