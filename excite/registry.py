"""Members of an axis by name, each loaded when it is asked for: their names cost nothing, as help texts need it.

Installed packages add members by entry points of the group ``excite.AXIS``, a running program by :func:`register`.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points
from importlib.util import find_spec
from typing import Any, Generic, TypeVar

from excite.errors import ExciteError, InputError, UnknownNameError

Member = TypeVar("Member")

# What can be added from outside: the module and the name where its members stand, and the class that they derive from.
_AXES = {
    "effects": ("excite.diagnosis.effects.registry", "EFFECTS", "Effect"),
    "exporters": ("excite.export.registry", "EXPORTERS", "Exporter"),
    "readers": ("excite.conversion.sources.registry", "SOURCES", "Source"),
    "checks": ("excite.safety.check", "CHECKS", "Check"),
}


def installed(axis: str) -> dict[str, str]:
    """``package.module:Class`` by name of the members that installed packages offer."""
    return {point.name: point.value for point in entry_points(group=f"excite.{axis}")}


def load_member(place: str) -> Any:
    """What stands at ``package.module:name``; raises ExciteError where another package's cannot be loaded."""
    module, _, word = place.partition(":")
    try:
        return getattr(importlib.import_module(module), word)
    except Exception as error:
        if module.startswith("excite."):
            raise
        raise ExciteError(f"{place}, which an installed package adds, cannot be loaded: {error}") from error


def find_failed_member(trace: str) -> str | None:
    """``package.module:Class`` of an installed package's member whose files a traceback's text goes through, if any."""
    for place in (place for axis in _AXES for place in installed(axis).values()):
        spec = find_spec(place.partition(":")[0].partition(".")[0])
        files = [] if spec is None else [*(spec.submodule_search_locations or ()), str(spec.origin)]
        if any(f'File "{file}' in trace for file in files):
            return place
    return None


def register(axis: str, member: type) -> None:
    """Add a member of one's own to an axis, for as long as this process runs; workers know what is installed alone.

    Args:
        axis: ``effects``, ``exporters``, ``readers`` or ``checks``.
        member: class that derives from the axis's abstract class; its ``name`` is what users type.

    Raises:
        UnknownNameError: no such axis.
        InputError: the name is taken, or the class is none of the axis or lacks a method.
    """
    if axis not in _AXES:
        raise UnknownNameError("axis", axis, sorted(_AXES))
    module, table, _ = _AXES[axis]
    _add(axis, getattr(importlib.import_module(module), table), member)


def add_installed(axis: str, members: Any) -> None:
    """Add what installed packages offer to an axis whose members are loaded together; raises as :func:`register`."""
    for place in installed(axis).values():
        _add(axis, members, load_member(place))


def _add(axis: str, members: Any, member: Any) -> None:
    base, kinds = _AXES[axis][-1], [kind.__name__ for kind in getattr(member, "__mro__", ())]
    lacks = sorted(getattr(member, "__abstractmethods__", ())) if base in kinds else [f"the class {base}"]
    if lacks:
        raise InputError(
            f"lacks {', '.join(lacks)}", source=axis, field=str(member), remedy=f"derive it from {base}"
        )
    if member.name in members:
        raise InputError("is taken", source=axis, field=member.name, remedy="give the class another name")
    members[member.name] = member() if axis == "effects" else member


class Registry(Mapping[str, type[Member]], Generic[Member]):
    """Classes by name; a new one is a file and a line.

    Args:
        kind: what a member is, for errors.
        members: ``package.module:Class`` by the name that the class says itself (``name``).
    """

    def __init__(self, kind: str, members: Mapping[str, str | type[Member]]) -> None:
        self._kind, self._members = kind, dict(members)

    def __getitem__(self, name: str) -> type[Member]:
        member = self._members[name]
        return load_member(member) if isinstance(member, str) else member

    def __setitem__(self, name: str, member: type[Member]) -> None:
        # Readers are asked in this order, and the last take most files.
        self._members = {name: member} | self._members

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
