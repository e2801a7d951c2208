"""What every section of the report has in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from excite.report.folder import Findings
from excite.report.html import html_section


class Content(NamedTuple):
    """The sentence that says what to see in a section, and what is below it."""

    lead: str
    parts: tuple[str, ...]


@dataclass(frozen=True)
class Section:
    """One section of the page.

    Attributes:
        identifier: its anchor.
        title: its heading and the text of its link; empty for a part without link.
        show: its content, or HTML of its own; empty where the findings have nothing for it.
    """

    identifier: str
    title: str
    show: Callable[[Findings], Content | str]

    def build(self, findings: Findings) -> str:
        """Its HTML, empty where the findings have nothing for it."""
        found = self.show(findings)
        if isinstance(found, str):
            return found
        return html_section(self.identifier, self.title, found.lead, *found.parts)


def section_content(lead: str, *parts: str) -> Content:
    """A section's sentence and what is below it; empty parts are left out."""
    return Content(lead, parts)


def section(identifier: str, title: str = "") -> Callable[[Callable[[Findings], Content | str]], Section]:
    """Makes a section of the function that shows it."""
    return lambda show: Section(identifier, title, show)
