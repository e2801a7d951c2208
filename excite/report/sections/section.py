"""What every section of the report has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from excite.report.folder import Findings


class Section(ABC):
    """One section of the page.

    Attributes:
        identifier: its anchor.
        title: its heading and the text of its link; empty for a part without link.
    """

    identifier: ClassVar[str]
    title: ClassVar[str]

    @abstractmethod
    def build(self, findings: Findings) -> str:
        """Its HTML, empty where the findings have nothing for it."""
