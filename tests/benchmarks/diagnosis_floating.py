"""Floating-base diagnosis on simulated practice cases whose hidden effect is known (3 to 8 s a case)."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.floating.diagnose import diagnose_floating
from excite.logs.files import load_log
from tests.benchmarks.table import Row

# A payload and a wrong link inertia are one thing where the inertials are given.
_SAME = {"payload": "link_inertia"}
# Not a word of the contract's; the case says what it is.
_KINDS = {"external_tether": "external_force"}


@dataclass(frozen=True)
class Score:
    """One case.

    Attributes:
        name: name of the case.
        truth: hidden effect, ``none`` or ``unknown``.
        named: right name, or ambiguous with it among the ties.
        placed: right place, or tied places that hold it.
        firm_wrong: a firm name that is wrong, or an effect where there is none.
        said: verdict, effect and place.
        share_closed: of the gap on the validation trials.
        tied: number of tied places.
    """

    name: str
    truth: str
    named: bool
    placed: bool
    firm_wrong: bool
    said: str
    share_closed: float
    tied: int


def score(name: str, answer: dict, found: Diagnosis) -> Score:
    """Compare a diagnosis with its answer."""
    truth, place = answer["effect"], answer["location"]
    said = found.effect or found.verdict
    names = {_canonical(item.effect) for item in found.ambiguous_with} or {_canonical(said)}
    if truth in {"none", "unknown"}:
        right = found.verdict == truth
        wrong = found.verdict == "effect"
        placed = right and (truth == "none" or place in (found.location, *found.tied_locations))
    else:
        right = _canonical(truth) in names and found.verdict in {"effect", "ambiguous"}
        wrong = found.verdict == "effect" and not right
        places = {item.location for item in found.effects} | set(found.tied_locations)
        places |= {tied for item in found.effects for tied in item.tied_locations}
        placed = right and place in places
    text = f"{found.verdict}: {', '.join(f'{e.effect} at {e.location}' for e in found.effects) or found.location}"
    return Score(name, truth, right, placed, wrong, text, found.gap.share_closed, len(found.tied_locations))


def _canonical(effect: str) -> str:
    effect = _KINDS.get(effect, effect)
    return _SAME.get(effect, effect)


def gap_folder() -> Path:
    """Folder of the practice cases: beside the recordings, or ``$EXCITE_GAP``."""
    default = Path(__file__).resolve().parents[3] / "shared" / "gap"
    return Path(os.environ.get("EXCITE_GAP", default)) / "floating"


def scores(folder: Path, names: list[str] | None = None) -> list[Score]:
    """Diagnose the cases of a folder."""
    answers = json.loads((folder / "answers.json").read_text(encoding="utf-8"))
    out = []
    for name in names or sorted(answers):
        out.append(score(name, answers[name], diagnose_floating(load_log(folder / name))))
        sys.stderr.write(f"{out[-1]}\n")
    return out


def rows() -> list[Row]:
    """Figures of all cases; none where the cases are not there."""
    folder = gap_folder()
    if not folder.is_dir():
        return []
    results = scores(folder)
    effects = [s for s in results if s.truth not in {"none", "unknown"}]
    none = [s for s in results if s.truth == "none"]
    unknown = [s for s in results if s.truth == "unknown"]
    closed = sorted(s.share_closed for s in effects)

    def percent(values: list[bool]) -> float:
        return 100.0 * sum(values) / max(1, len(values))

    return [
        Row.at_least(
            f"floating base, {len(effects)} effects: right name",
            percent([s.named for s in effects]),
            90.0,
            "%",
        ),
        Row.at_least(
            "floating base: place, or a tied set with it", percent([s.placed for s in effects]), 95.0, "%"
        ),
        Row.at_least(
            f"floating base: 'none' kept, {len(none)} cases", percent([s.named for s in none]), 98.0, "%"
        ),
        Row.at_least(
            f"floating base: 'unknown' recognised, {len(unknown)} cases",
            percent([s.named for s in unknown]),
            90.0,
            "%",
        ),
        Row.at_most("floating base: firm wrong names", percent([s.firm_wrong for s in results]), 2.0, "%"),
        Row.at_least(
            "floating base: share of the gap closed, median", 100.0 * closed[len(closed) // 2], 97.0, "%"
        ),
        Row.at_least(
            "floating base: share of the gap closed, worst tenth",
            100.0 * closed[len(closed) // 10],
            80.0,
            "%",
        ),
    ]


if __name__ == "__main__":
    scores(gap_folder(), sys.argv[1:] or None)
