"""Why candidates are refused: which pair, joint, limit or contact, how often, by how much, and what would help."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from excite.safety.repairs.draft import Rejection
from excite.safety.verdict import Verdict, Violation

# What most likely helps, by a word in the reason; the first that fits.
_ADVICE = (
    ("collision", "a posture that parts them, or collision.ignored_pairs if they may touch"),
    ("torque", "lower limits.acceleration, or a true limits.torque"),
    ("velocity", "a true limits.velocity"),
    ("accel", "a true limits.acceleration"),
    ("jerk", "a true limits.jerk"),
    ("position", "a posture further from the limits"),
    (
        "zmp",
        "a posture with the centre of mass above the middle of the feet, or larger soles if they are larger",
    ),
    (
        "balance",
        "a posture with the centre of mass above the middle of the feet, or larger soles if they are larger",
    ),
    ("friction", "the true friction of the feet, or lower limits.acceleration"),
    ("foot", "soles in feet as they are, and a posture with bent knees"),
    ("contact", "soles in feet as they are, and a posture with bent knees"),
    ("rest", "a posture of rest that is itself safe"),
)


@dataclass
class Refusals:
    """Refusals counted as they come.

    Attributes:
        places: how many candidates each reason refused at each place.
        worst: the violation furthest beyond its limit, by reason and place, relative to the limit.
    """

    places: Counter[tuple[str, str]] = field(default_factory=Counter)
    worst: dict[tuple[str, str], Violation] = field(default_factory=dict)

    def add(self, rejection: Rejection, verdict: Verdict | None) -> None:
        """Count one refusal; ``verdict`` is the check's, None where no motion came so far."""
        key = (rejection.reason, rejection.where)
        self.places[key] += 1
        violation = verdict.violations[0] if verdict is not None and verdict.violations else None
        if violation is None or _beyond(violation) is None:
            return
        before = self.worst.get(key)
        if before is None or (_beyond(violation) or 0.0) > (_beyond(before) or 0.0):
            self.worst[key] = violation

    def commonest(self, most: int = 3) -> list[tuple[str, str, int]]:
        """Reason, place and number of what refuses most candidates."""
        ordered = sorted(self.places.items(), key=lambda item: (-item[1], item[0]))
        return [(reason, where, count) for (reason, where), count in ordered[:most]]

    def advice(self) -> str:
        """The one change most likely to help."""
        first = self.commonest(1)
        if not first:
            return "ask for more candidates"
        reason, where, _ = first[0]
        change = next((text for word, text in _ADVICE if word in reason), "calmer limits")
        return f"{where}: {change}"

    def summary(self) -> str:
        """What refuses most, in one line."""
        parts = []
        for reason, where, count in self.commonest():
            worst = self.worst.get((reason, where))
            more = f", worst {worst}" if worst is not None else ""
            parts.append(f"{reason} of {where} refuses {count}{more}")
        return "; ".join(parts)

    def to_json(self) -> list[dict[str, Any]]:
        """All of it, the commonest first."""
        found = []
        for reason, where, count in self.commonest(20):
            worst = self.worst.get((reason, where))
            found.append(
                {
                    "reason": reason,
                    "where": where,
                    "candidates": count,
                    "worst": None
                    if worst is None
                    else {"value": worst.value, "limit": worst.limit, "time_s": worst.time_s},
                }
            )
        return found


def _beyond(violation: Violation) -> float | None:
    if violation.value is None or violation.limit is None:
        return None
    return abs(violation.value - violation.limit)
