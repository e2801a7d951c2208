"""Every error that excite raises on purpose, with the data that explains it.

The command line turns each of them into one line: which file, what is wrong, what to do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any


class ExciteError(Exception):
    """Base of all errors raised by excite; ``exit_code`` is what the command line ends with.

    All of them can be pickled with everything that they carry, so that they reach the process that asked.
    """

    exit_code = 4

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild_error, (type(self), self.args, dict(self.__dict__))


class InputError(ExciteError):
    """Something that the caller handed over is wrong.

    Args:
        what: what is wrong, in a few words, with the offending value.
        source: file (or object) in which it was found.
        field: element or column inside the source.
        remedy: what the caller can do about it.
    """

    def __init__(
        self, what: str, *, source: object = None, field: str | None = None, remedy: str | None = None
    ):
        self.what, self.source, self.field, self.remedy = what, source, field, remedy
        # Names that people gave may hold line ends, and an error is one line.
        parts = (str(part) for part in (source, field) if part is not None)
        place = ": ".join(part if part.isprintable() else repr(part)[1:-1] for part in parts)
        text = f"{place}: {what}" if place else what
        super().__init__(f"{text}; {remedy}" if remedy else text)


class PlugInError(InputError):
    """What a member from outside the package raised or returned; ``trace`` is the traceback of its error, if any."""

    trace = ""


@contextmanager
def raised_as(kind: type[InputError]) -> Iterator[None]:
    """Errors about files within the block, which readers raise as InputError, as those of a kind; a decorator too."""
    try:
        yield
    except InputError as error:
        if type(error) is InputError:
            error.__class__ = kind
        raise


class RobotError(InputError):
    """A robot's model or its ``robot.yaml`` is missing, malformed or physically absurd."""


class MotionError(InputError):
    """A motion file is malformed or does not fit the robot."""


class OtherRobotError(MotionError):
    """A motion that says that it is another robot's, and whose joints this one lacks; ``robot`` is whom it names."""

    def __init__(self, whose: str, robot: str, source: object):
        self.robot = whose
        super().__init__(
            f"is a motion of {whose!r}, not of {robot!r}",
            source=source,
            field="robot",
            remedy="name the robot that it was made for",
        )


class LogError(InputError):
    """A log folder is malformed or does not fit the robot."""


class NothingThereError(LogError):
    """A source that holds no numbers over time; among others in a folder it is no recording."""


class IllLogError(LogError):
    """A log that cannot be used as it is and that no check could save; ``findings`` say why, worst first."""

    def __init__(
        self, what: str, *, source: object = None, remedy: str | None = None, findings: Sequence[Any] = ()
    ):
        self.findings = tuple(findings)
        super().__init__(what, source=source, remedy=remedy)


class UnknownNameError(InputError):
    """A name that a registry does not know; ``known`` lists the ones it does."""

    def __init__(self, kind: str, name: str, known: list[str]):
        self.kind, self.name, self.known = kind, name, known
        super().__init__(f"unknown {kind} {name!r}", remedy="choose one of " + ", ".join(known))


class UnsafeMotionError(ExciteError):
    """A motion may not leave: the independent check does not find it safe.

    Attributes:
        verdicts: what the check says of each motion that is not safe.
        remedy: what the caller can do about it.
    """

    exit_code = 1

    def __init__(self, what: str, *, verdicts: Sequence[Any] = (), remedy: str | None = None):
        self.what, self.verdicts, self.remedy = what, tuple(verdicts), remedy
        super().__init__(f"{what}; {remedy}" if remedy else what)


class NoSolutionError(ExciteError):
    """A search or a solver ended without a solution.

    Attributes:
        best: the best found, None if there is none.
        shown: whether the command line has printed the best, and with it this error, already.
    """

    exit_code = 3

    def __init__(self, what: str, *, best: object = None, remedy: str | None = None):
        self.what, self.best, self.remedy, self.shown = what, best, remedy, False
        super().__init__(f"{what}; {remedy}" if remedy else what)


class NothingSafeError(NoSolutionError):
    """No candidate is safe; ``best`` says what refuses them (``to_json()``, ``table()``)."""


def in_one_line(reason: Exception) -> str:
    """What a library says of its error, in one line; what it is where nothing is said."""
    return " ".join(str(reason).split()) or type(reason).__name__


def _rebuild_error(kind: type[ExciteError], args: tuple[Any, ...], attributes: dict[str, Any]) -> ExciteError:
    """An error as it was, without the checks and sentences of its constructor."""
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(attributes)
    return error
