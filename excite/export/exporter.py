"""What every controller format has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar

from excite.motion.motion import Motion


class Exporter(ABC):
    """Writes a motion as one file (or one folder) that a controller reads.

    Attributes:
        name: name in ``EXPORTERS`` and after ``excite export --format``.
        suffix: what the file's name ends with; empty for a folder.
        summary: one line for help texts.
    """

    name: ClassVar[str]
    suffix: ClassVar[str]
    summary: ClassVar[str]

    @abstractmethod
    def write(self, motion: Motion, path: Path) -> None:
        """Write ``motion``, every sample of it, to ``path``, which appears only when it is complete.

        Args:
            motion: the motion, already on the grid that the controller wants.
            path: the file or folder to write; an older one is replaced.
        """
