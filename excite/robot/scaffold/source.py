"""How a model file is to be read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Source:
    """How a model file is to be read.

    Attributes:
        srdf: a file of allowed collisions beside it, or None.
        package_path: folders in which packages lie, beside those above the model and ``$ROS_PACKAGE_PATH``.
        arguments: of a xacro file, by name.
    """

    srdf: Path | None = None
    package_path: tuple[Path, ...] = ()
    arguments: Mapping[str, str] = field(default_factory=dict)
