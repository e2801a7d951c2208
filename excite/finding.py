"""Something that a careful reader of a log or of a result should know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Finding:
    """What was found, in a sentence with its figures.

    Attributes:
        kind: what it is about, a word that programs can test for, such as ``degrees``.
        text: the sentence: what was found, the likely cause, what to do.
        figures: the numbers behind it by name, SI.
        places: joints, links, channels or parameters concerned.
    """

    kind: str
    text: str
    figures: Mapping[str, float] = field(default_factory=dict)
    places: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """``{"kind", "text", "figures", "places"}``."""
        return asdict(self) | {"figures": dict(self.figures), "places": list(self.places)}


def listed(names: tuple[str, ...] | list[str], most: int = 5) -> str:
    """Names in a sentence, the rest counted."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
