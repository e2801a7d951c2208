"""Diagnosis of the practice arms: names, places, share of the closable gap, time; run alone for a table."""

from __future__ import annotations

import json
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from tests.benchmarks.table import Row

SAME = ({"payload", "link_inertia"},)
PAIR = {"torque_bias", "coulomb_asymmetry"}


@dataclass(frozen=True)
class Score:
    """One case.

    Attributes:
        case: its name.
        truth: what is hidden.
        found: what was said.
        named: whether the first effect's name is right, an honest ambiguous pair included.
        placed: whether its place is right.
        firm_wrong: a wrong name without a doubt.
        recall: share of the effects found.
        extras: effects named that the answers do not list.
        background: whether every joint has more effects, of which the answers list none.
        closed: share of the closable gap that is closed on the validation trials.
        seconds: how long it took.
    """

    case: str
    truth: str
    found: str
    named: bool
    placed: bool
    firm_wrong: bool
    recall: float
    extras: int
    background: bool
    closed: float
    seconds: float


def folder() -> Path:
    """The practice cases: ``gap/arm`` beside the recordings."""
    data = Path(os.environ.get("EXCITE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
    return data.parent / "gap" / "arm"


def same(a: str | None, b: str | None) -> bool:
    """Whether two names count as one."""
    return a == b or any({a, b} <= group for group in SAME)


def score(case: str, answer: dict, result: Diagnosis, seconds: float) -> Score:
    """Compare a diagnosis with what is hidden."""
    hidden = [(e["effect"], e["location"]) for e in answer["effects"]]
    names = [name for name, _ in hidden]
    found = [(e.effect, (e.location, *e.tied_locations)) for e in result.effects]
    options = {item.effect for item in result.ambiguous_with} | {result.effect}
    if names[0] in {"none", "unknown"}:
        named = result.verdict == names[0]
        placed = names[0] == "none" or result.location == hidden[0][1]
        wrong = result.verdict == "effect"
        recall, extras = float(named), len(found)
    else:
        hits = [any(same(n, f) or {n, f} <= PAIR for f, _ in found) for n in names]
        recall = float(np.mean(hits))
        named = any(same(n, o) for n in names for o in options)
        placed = bool(found) and any(place in found[0][1] for _, place in hidden)
        wrong = result.verdict == "effect" and not any(same(n, result.effect) for n in names)
        extras = sum(not any(same(n, f) or {n, f} <= PAIR for n in names) for f, _ in found)
    before, oracle = answer["oracle"]["total_base"], answer["oracle"]["total_oracle"]
    scale = np.array(answer["oracle"]["tau_std"])
    after = np.array([c.after for c in result.gap.per_channel.values()])
    ours = float(np.sqrt(np.mean((after / scale) ** 2)))
    best = float(np.sqrt(np.mean((np.array(answer["oracle"]["val_rmse_oracle"]) / scale) ** 2)))
    closed = (before**2 - ours**2) / max(before**2 - min(best, oracle) ** 2, 1e-12)
    said = f"{result.verdict}: " + ", ".join(f"{e.effect}@{e.location}" for e in result.effects)
    if result.verdict == "ambiguous":
        said += " among " + "/".join(item.effect for item in result.ambiguous_with)
    truth = ", ".join(f"{n}@{p}" for n, p in hidden)
    background = answer.get("clutter", 0.0) > 0.0
    return Score(case, truth, said, named, placed, wrong, recall, extras, background, closed, seconds)


def scores(where: Path | None = None, cases: list[str] | None = None) -> list[Score]:
    """Diagnose the cases; the answers are read after each diagnosis."""
    where = where or folder()
    done = []
    for path in sorted(where.glob("case_*")):
        if cases and path.name not in cases:
            continue
        started = time.perf_counter()
        result = diagnose(path)
        seconds = time.perf_counter() - started
        answers = json.loads((folder() / "answers.json").read_text())
        done.append(score(path.name, answers[path.name], result, seconds))
        if __name__ == "__main__":
            s = done[-1]
            flags = (
                ("" if s.named else " NAME")
                + ("" if s.placed else " PLACE")
                + (" FIRM" if s.firm_wrong else "")
            )
            print(
                f"{s.case} {s.truth:45} | {s.found:70} recall {s.recall:.1f} extras {s.extras} "
                f"closed {s.closed:5.2f} {s.seconds:5.1f}s{flags}",
                flush=True,
            )
    return done


def rows() -> list[Row]:
    """Figures over all practice arms."""
    if not folder().is_dir():
        return [Row("practice arms", "", "not found", None)]
    done = scores()
    n = len(done)
    # Two of the arms have a ripple of 12 periods a turn, a constant and friction under load at every joint besides.
    bare = [s for s in done if not s.background]
    real = [s for s in done if not s.truth.startswith(("none", "unknown"))]
    return [
        Row.at_least(
            "arms: right name (ambiguous pairs included)", sum(s.named for s in done), 22, f"of {n}"
        ),
        Row.at_least("arms: right place", sum(s.placed for s in done), 22, f"of {n}"),
        Row.at_most(
            "arms: names firmly said first that the answers do not list", sum(s.firm_wrong for s in done), 0
        ),
        Row.at_most("arms: effects named that the answers do not list", sum(s.extras for s in done), 0),
        Row.at_most(
            f"arms: both, without the {n - len(bare)} with a background at every joint that no answer lists",
            sum(s.firm_wrong + s.extras for s in bare),
            0,
        ),
        Row.at_least("arms: effects found", float(np.mean([s.recall for s in real])), 0.9),
        Row.at_least(
            "arms: share of the closable gap closed, median", float(np.median([s.closed for s in real])), 0.97
        ),
        Row.at_least("arms: the same, worst tenth", float(np.quantile([s.closed for s in real], 0.1)), 0.8),
        Row.at_most("arms: time of a case, median", float(np.median([s.seconds for s in done])), 10.0, "s"),
    ]


if __name__ == "__main__":
    arguments = sys.argv[1:]
    place = Path(arguments.pop(0)) if arguments and Path(arguments[0]).is_dir() else None
    scores(place, arguments or None)
