"""How long work says how far it has come."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol


class Progress(Protocol):
    """Called from the main process as work proceeds."""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """``done`` of ``total`` items of ``stage`` are finished."""


def silent(stage: str, done: int, total: int) -> None:
    """Say nothing."""


# Steps of one verb lie deep inside each other: they are told to whoever listens, not handed down through all between.
_LISTENER: ContextVar[Progress] = ContextVar("listener", default=silent)


@contextmanager
def told_to(progress: Progress) -> Iterator[None]:
    """While the block runs, its steps are told to ``progress``."""
    token = _LISTENER.set(progress)
    try:
        yield
    finally:
        _LISTENER.reset(token)


@contextmanager
def step(name: str) -> Iterator[None]:
    """A step of long work that has nothing to count, told where it begins and where it ends; a decorator too."""
    progress = _LISTENER.get()
    progress(name, 0, 1)
    yield
    progress(name, 1, 1)
