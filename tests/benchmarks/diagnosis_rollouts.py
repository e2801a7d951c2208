"""Roll-outs of the practice arms with the augmented simulator against the nominal one; run alone for a table."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

from excite.diagnosis.diagnose import diagnose
from tests.benchmarks.diagnosis_arms import folder
from tests.benchmarks.table import Row


@dataclass(frozen=True)
class Ratio:
    """One case, from ``simulation`` of its document.

    Attributes:
        case: its name.
        total: root of the sum over channels of squared errors, after over before.
        best: the same of the channel that gained most: where the effect is.
        worst: of the channel that gained least.
        warnings: what the simulator could not take up, or was left out because it does not help.
    """

    case: str
    total: float
    best: float
    worst: float
    warnings: tuple[str, ...]


def ratios(cases: list[str] | None = None) -> list[Ratio]:
    """Diagnose the cases; those where no effect is named have no second simulator and are left out."""
    found = []
    for path in sorted(folder().glob("case_*")):
        if cases and path.name not in cases:
            continue
        result = diagnose(path)
        document = result.to_json()["simulation"]
        if not result.effects or not document["before"]:
            continue
        before = np.array(list(document["before"].values()))
        after = np.array([document["after"][name] for name in document["before"]])
        each = after / before
        total = float(np.sqrt((after**2).sum() / (before**2).sum()))
        found.append(
            Ratio(path.name, total, float(each.min()), float(each.max()), tuple(document["warnings"]))
        )
        if __name__ == "__main__":
            r = found[-1]
            named = ", ".join(f"{e.effect}@{e.location}" for e in result.effects)
            print(f"{r.case} {named:50} {r.total:.2f} {r.best:.2f} … {r.worst:.2f} {r.warnings}", flush=True)
    return found


def rows() -> list[Row]:
    """Figures over all practice arms."""
    if not folder().is_dir():
        return [Row("roll-outs of practice arms", "", "not found", None)]
    found = ratios()
    totals = np.array([r.total for r in found])
    return [
        Row.at_most(
            "roll-outs: error with the effects, over that without, median", float(np.median(totals)), 0.3
        ),
        Row.at_most("roll-outs: the same, worst case", float(totals.max()), 1.0),
        Row.at_most(
            "roll-outs: the same on the channel that gains most, median",
            float(np.median([r.best for r in found])),
            0.3,
        ),
        Row("roll-outs: cases", "", f"{len(found)}", None),
    ]


if __name__ == "__main__":
    ratios(sys.argv[1:] or None)
