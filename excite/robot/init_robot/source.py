"""How a model file is to be read: packages, xacro arguments, allowed collisions, limits stated elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Source:
    """How a model file is to be read.

    Attributes:
        srdf: a file of allowed collisions beside it, or None.
        package_path: folders in which packages lie, beside those above the model and ``$ROS_PACKAGE_PATH``.
        arguments: of a xacro file, by name.
        limits: a file of joint limits of MoveIt's kind, or None.
    """

    srdf: Path | None = None
    package_path: tuple[Path, ...] = ()
    arguments: Mapping[str, str] = field(default_factory=dict)
    limits: Path | None = None


_READ_BY: ContextVar[Source | None] = ContextVar("read_by", default=None)


@contextmanager
def models_read_by(source: Source) -> Iterator[None]:
    """Within it, models are read as ``source`` says where :func:`~excite.robot.load.load_robot` is not told."""
    token = _READ_BY.set(source)
    try:
        yield
    finally:
        _READ_BY.reset(token)


def model_source() -> Source:
    """How models are read where :func:`~excite.robot.load.load_robot` is not told."""
    return _READ_BY.get() or Source()
