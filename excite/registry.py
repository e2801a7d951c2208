"""Members of an axis by name, each loaded when it is asked for: their names cost nothing, as help texts need it.

Installed packages add members by entry points of the group ``excite.AXIS``, a running program by :func:`register`.
"""

from __future__ import annotations

import importlib
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import is_dataclass
from functools import wraps
from importlib.metadata import entry_points
from numbers import Integral, Real
from types import FunctionType, SimpleNamespace, UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Generic,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from excite.errors import ExciteError, InputError, PlugInError, UnknownNameError

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
    admit_member(axis, member)
    if member.name in members:
        raise InputError("is taken", source=axis, field=member.name, remedy="give the class another name")
    members[member.name] = member() if axis == "effects" else member


# What comes from outside: a class of the axis, whose methods are judged as they are called.


def admit_member(axis: str, member: Any) -> Any:
    """The class of a member of one's own; from now on its errors, and what it returns that it must not, name it.

    Raises:
        InputError: the class is none of the axis, lacks a method, or an attribute is of another type.
    """
    name, kinds = _AXES[axis][-1], getattr(member, "__mro__", ())
    lacks = sorted(getattr(member, "__abstractmethods__", ()))
    if name not in [kind.__name__ for kind in kinds]:
        lacks = [f"the class {name}"]
    elif not isinstance(getattr(member, "name", None), str):
        lacks.append("a name")
    if lacks:
        raise InputError(
            f"lacks {', '.join(lacks)}", source=axis, field=str(member), remedy=f"derive it from {name}"
        )
    base = next(kind for kind in kinds if _is_ours(kind))
    attributes = [word for word, hint in _hints_of(base).items() if get_origin(hint) is ClassVar]
    for word in (word for word in attributes if hasattr(member, word)):
        if fault := find_fault(getattr(member, word), _hints_of(base)[word]):
            raise InputError(fault, source=_place(member), field=word, remedy=f"see {base.__module__}")
    for word in dir(base):
        owner = next(kind for kind in kinds if word in vars(kind))
        own = vars(owner)[word]
        if _is_ours(owner) or (word.startswith("__") and word != "__init__"):
            continue
        if isinstance(own, FunctionType):
            setattr(member, word, _judge_calls(own, word, base))
        elif isinstance(own, property) and own.fget is not None:
            setattr(member, word, property(_judge_calls(own.fget, word, base)))
    return member


def _is_ours(kind: type) -> bool:
    return kind.__module__.startswith("excite.") or kind.__module__ in ("abc", "builtins")


def _place(member: type) -> str:
    return f"{member.__module__}:{member.__qualname__}"


def _hints_of(thing: Any, names: dict[str, Any] | None = None) -> dict[str, Any]:
    """Types by name, of a class by the names of its own module; none of a library that is not loaded."""
    with suppress(NameError):
        return get_type_hints(thing, names, include_extras=True)
    return {}


def _judge_calls(method: Callable[..., Any], word: str, base: Any) -> Callable[..., Any]:
    """A method that raises PlugInError where it fails, or returns what the method of its base class does not."""
    inherited = getattr(base, word)
    inherited = inherited.fget if isinstance(inherited, property) else inherited
    stated = {"return": getattr(inherited, "__annotations__", {}).get("return", "Any")}
    known = vars(sys.modules[getattr(inherited, "__module__", __name__)])
    hint = _hints_of(cast(Any, SimpleNamespace(__annotations__=stated)), known).get("return", Any)

    @wraps(method)
    def judged(self: Any, *args: Any, **named: Any) -> Any:
        remedy, trace = "mend or uninstall the package that adds it", ""
        try:
            result = method(self, *args, **named)
        except ExciteError:
            raise
        except Exception as error:
            if getattr(base, "is_of_file", lambda *_: False)(word, error):
                raise
            fault, trace = f"fails ({type(error).__name__}: {error})", traceback.format_exc()
        else:
            fault = find_fault(result, hint)
            fault = fault or getattr(base, "mistake_in", lambda *_: "")(self, word, result, *args)
            if not fault:
                return result
            fault = f"what it returns {fault}"
        failure = PlugInError(fault[:300], source=_place(type(self)), field=word, remedy=remedy)
        failure.trace = trace
        raise failure

    return judged


_NUMBERS: dict[Any, tuple[Any, ...]] = {float: (Real,), int: (Integral,)}


def find_fault(value: Any, hint: Any) -> str:
    """In which words a value is not of a type; empty where it is, as far as the type says so.

    >>> find_fault((1, "two"), tuple[float, ...])
    "holds 'two' where float is expected"
    """
    origin, args = get_origin(hint) or hint, get_args(hint)
    if origin in (Annotated, ClassVar):
        return find_fault(value, args[0])
    if origin in (Union, UnionType):
        right = any(not find_fault(value, one) for one in args)
    elif not isinstance(origin, type):
        right = True
    elif hasattr(value, "dtype") and args:
        right = value.dtype.kind in ("O" if "object" in str(hint) else "biuf")
    else:
        # Booleans of numpy's are none of Python's.
        right = (
            isinstance(value, _NUMBERS.get(origin, (origin,)))
            or type(value).__name__ == f"{origin.__name__}_"
        )
    if not right:
        shown = f"an array {value.shape} of {value.dtype}" if hasattr(value, "dtype") else repr(value)[:60]
        expected = hint.__name__ if origin is hint else re.sub(r"(\w+\.)+(?=\w)", "", str(hint))
        return f"is {shown} where {expected} is expected"
    found = next((fault for one, kind in _parts(value, origin, args) if (fault := find_fault(one, kind))), "")
    return f"holds{found.removeprefix('is').removeprefix('holds')}" if found else ""


def _parts(value: Any, origin: Any, args: tuple[Any, ...]) -> Iterator[tuple[Any, Any]]:
    """What a value holds, each with its type."""
    if isinstance(value, Mapping) and args:
        yield from (one for pair in value.items() for one in zip(pair, args, strict=True))
    elif isinstance(value, tuple | list) and args:
        kinds = args if origin is tuple and args[-1] is not Ellipsis else args[:1] * len(value)
        yield from zip(value, kinds, strict=len(kinds) == len(value))
    elif is_dataclass(value):
        hints = _hints_of(type(value))
        yield from ((getattr(value, word), kind) for word, kind in hints.items() if not word.startswith("_"))


class Registry(Mapping[str, type[Member]], Generic[Member]):
    """Classes by name; a new one is a file and a line.

    Args:
        kind: what a member is, for errors.
        members: ``package.module:Class`` by the name that the class says itself (``name``).
        axis: that installed packages add members to; empty for none.
    """

    def __init__(self, kind: str, members: Mapping[str, str | type[Member]], axis: str = "") -> None:
        self._kind, self._axis = kind, axis
        self._members = {**(installed(axis) if axis else {}), **members}

    def __getitem__(self, name: str) -> type[Member]:
        member = self._members[name]
        if isinstance(member, str):
            ours, member = member.startswith("excite."), load_member(member)
            self._members[name] = member if ours or not self._axis else admit_member(self._axis, member)
        return cast(type[Member], member)

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
