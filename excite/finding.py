"""Something that a careful reader of a log or of a result should know: one form for everything that looks at data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Severity = Literal["fatal", "spoils", "limits", "note"]
_WORST_FIRST: tuple[Severity, ...] = ("fatal", "spoils", "limits", "note")


@dataclass(frozen=True)
class Finding:
    """What was found, in a sentence with its figures.

    Attributes:
        kind: what it is about, a word that programs can test for, such as ``degrees``.
        text: the sentence: what was found, the likely cause, what to do.
        figures: the numbers behind it by name, SI.
        places: joints, links, channels or parameters concerned.
        severity: ``fatal`` where nothing can be told; ``spoils`` what is computed until it is mended; ``limits`` what
            can be told; or a ``note``.
        sure: how far it is to be believed, 0 … 1; 1 where it was counted.
        repaired: whether what follows works with it mended.
        remedy: what was done, or what is to be done.
        trials: names of the trials concerned; empty for all.
    """

    kind: str
    text: str
    figures: Mapping[str, float] = field(default_factory=dict)
    places: tuple[str, ...] = ()
    severity: Severity = "note"
    sure: float = 1.0
    repaired: bool = False
    remedy: str = ""
    trials: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """Trials and places in words; ``log`` for the whole of it."""
        return " ".join(part for part in (listed(self.trials), listed(self.places)) if part) or "log"

    def to_json(self) -> dict[str, Any]:
        """The finding as it stands in documents."""
        return {
            "kind": self.kind,
            "text": self.text,
            "figures": dict(self.figures),
            "places": list(self.places),
            "severity": self.severity,
            "sure": round(self.sure, 3),
            "repaired": self.repaired,
            "remedy": self.remedy,
            "trials": list(self.trials),
        }


def worst_first(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """What spoils most and is not mended first; the order within a class is kept."""
    return tuple(sorted(findings, key=lambda item: (item.repaired, _WORST_FIRST.index(item.severity))))


def listed(names: tuple[str, ...] | list[str], most: int = 5) -> str:
    """Names in a sentence, the rest counted."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
