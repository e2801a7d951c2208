"""Roll-outs of the practice cases: the augmented simulator against the nominal one; run alone for a table."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.diagnosis.diagnose import diagnose
from tests.benchmarks.diagnosis_arms import folder
from tests.benchmarks.table import Row


@dataclass(frozen=True)
class Ratio:
    """One case, from ``simulation`` of its document.

    Attributes:
        case: its name.
        total: root of the sum over channels of squared errors, after over before; of metres and of radians the mean.
        best: the same of the channel that gained most: where the effect is.
        worst: of the channel that gained least.
        warnings: what the simulator could not take up, or was left out because it does not help.
    """

    case: str
    total: float
    best: float
    worst: float
    warnings: tuple[str, ...]


def ratios(place: Path, cases: list[str] | None = None) -> list[Ratio]:
    """Diagnose a folder's cases; those where no effect is named have no second simulator and are left out."""
    found = []
    for path in sorted(place.glob("case_*")):
        if cases and path.name not in cases:
            continue
        result = diagnose(path)
        document = result.to_json()["simulation"]
        if not result.effects or not document["before"]:
            continue
        before = np.array(list(document["before"].values()))
        after = np.array([document["after"][name] for name in document["before"]])
        each = after / before
        turns = np.array([name.startswith("base.r") for name in document["before"]])
        groups = [group for group in (turns, ~turns) if group.any()]
        total = float(np.sqrt(np.mean([(after[g] ** 2).sum() / (before[g] ** 2).sum() for g in groups])))
        found.append(
            Ratio(path.name, total, float(each.min()), float(each.max()), tuple(document["warnings"]))
        )
        if __name__ == "__main__":
            r = found[-1]
            named = ", ".join(f"{e.effect}@{e.location}" for e in result.effects)
            print(f"{r.case} {named:50} {r.total:.2f} {r.best:.2f} … {r.worst:.2f} {r.warnings}", flush=True)
    return found


def rows() -> list[Row]:
    """Figures over all practice cases."""
    return [
        *_rows("roll-outs", folder()),
        *_rows("roll-outs of standing robots", folder().parent / "floating"),
    ]


def _rows(title: str, place: Path) -> list[Row]:
    if not place.is_dir():
        return [Row(title, "", "not found", None)]
    found = ratios(place)
    totals = np.array([r.total for r in found])
    return [
        Row.at_most(
            f"{title}: error with the effects, over that without, median", float(np.median(totals)), 0.3
        ),
        Row.at_most(f"{title}: the same, worst case", float(totals.max()), 1.0),
        Row.at_most(
            f"{title}: the same on the channel that gains most, median",
            float(np.median([r.best for r in found])),
            0.3,
        ),
        Row(f"{title}: cases", "", f"{len(found)}", None),
    ]


if __name__ == "__main__":
    for kind in (folder(), folder().parent / "floating"):
        ratios(kind, sys.argv[1:] or None)
