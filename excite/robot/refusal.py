"""How a robot's files are refused: which file, which place in it, what is wrong there, what to do."""

from __future__ import annotations

from collections.abc import Iterable

from excite.errors import RobotError


def robot_error(source: object, field: str | None, what: str, remedy: str | None = None) -> RobotError:
    """The error of a robot's file, its parts in the order in which they are printed.

    Args:
        field: element or field in it; None where it is the whole file.
        what: what is wrong, in a few words, with the offending value.
        remedy: what the caller can do about it.
    """
    return RobotError(what, source=source, field=field, remedy=remedy)


def unknown_name(source: object, field: str | None, kind: str, name: str, known: Iterable[str]) -> RobotError:
    """The error of a name that is none of the model's; ``kind`` says of what, such as ``link``."""
    return robot_error(source, field, f"no {kind} {name!r}", "the model has " + ", ".join(known))
