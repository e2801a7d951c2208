"""Which command is running, so that what it writes can say so."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

_RUN: ContextVar[Mapping[str, Any] | None] = ContextVar("run", default=None)


@contextmanager
def made_by(command: str, version: str, seed: int) -> Iterator[None]:
    """While the block runs, documents say that this command writes them.

    Args:
        command: as it was typed, less what the result does not depend on.
        version: of excite.
        seed: of its random numbers.
    """
    token = _RUN.set({"command": command, "version": version, "seed": seed})
    try:
        yield
    finally:
        _RUN.reset(token)


def stated() -> dict[str, Any]:
    """The field ``made`` of a document that is written now, or nothing where no command is running."""
    run = _RUN.get()
    return {} if run is None else {"made": dict(run)}
