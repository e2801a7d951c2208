"""Arms with a little of everything, and real robots: what the budget names and what it leaves."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.budget.thresholds import Thresholds
from excite.diagnosis.diagnose import diagnose
from excite.logs.log import Log
from tests.benchmarks.diagnosis_arms import PAIR, same
from tests.benchmarks.table import Row
from tests.reproduction import emps
from tests.reproduction.recordings import UR10E_JOINTS, ur10e_log
from tests.reproduction.tiago import tiago_log

DATA = Path(os.environ.get("EXCITE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
FRICTION = ("viscous_friction", "coulomb_friction")


@dataclass(frozen=True)
class Many:
    """One arm with a little of everything.

    Attributes:
        case: its name.
        found: effects that can be found and were named at their place.
        findable: how many there are.
        share: of what those take of the gap, what the named ones take.
        right: named effects that are there.
        named: effects named.
        off: of each found effect, budget's share less the true one.
        seconds: of the processor.
    """

    case: str
    found: int
    findable: int
    share: float
    right: int
    named: int
    off: tuple[float, ...]
    seconds: float


def many(case: str, answer: dict, result: Diagnosis, seconds: float) -> Many:
    """Compare a diagnosis with what is hidden in an arm with a little of everything."""
    named = [(e.effect, (e.location, *e.tied_locations)) for e in result.effects]
    findable = [e for e in answer["effects"] if e["findable"]]
    hits = [any(_is(e, name, places) for name, places in named) for e in findable]
    right = [any(_is(e, name, places) for e in answer["effects"]) for name, places in named]
    weights = np.maximum([e["share"] for e in findable], 0.0)
    shares = [] if result.budget is None else result.budget.named
    off = [
        item.share - e["share"] for e in findable for item in shares if _is(e, item.effect, (item.location,))
    ]
    share = float(weights @ np.array(hits) / max(float(weights.sum()), 1e-12))
    return Many(case, sum(hits), len(hits), share, sum(right), len(named), tuple(off), seconds)


def _is(hidden: dict, name: str, places: tuple[str | None, ...]) -> bool:
    """Whether a name at places is what is hidden; links are known by their joints in the answers."""
    alike = same(hidden["effect"], name) or {hidden["effect"], name} <= PAIR
    return alike and _bare(hidden["location"]) in {_bare(place or "") for place in places}


def _bare(place: str) -> str:
    return place.removesuffix("_link").removesuffix("_joint").replace("link", "joint")


def diagnosed_many(folder: Path, cases: tuple[str, ...] | None = None) -> list[Many]:
    """Diagnose the arms of a folder that has their answers; all of them by default."""
    answers = json.loads((folder / "answers.json").read_text())
    made = []
    for case in cases or tuple(sorted(answers)):
        start = time.process_time()
        result = diagnose(folder / case)
        made.append(many(case, answers[case], result, time.process_time() - start))
    return made


def rows() -> list[Row]:
    """The table; rows that say so where the recordings or the practice arms are not there."""
    made = [Row.at_most("constants that decide in the model of the gap", len(fields(Thresholds)), 12)]
    folder = DATA.parent / "gap" / "many"
    if not folder.is_dir():
        return [*made, Row("arms with a little of everything", "", f"not found in {folder}", None)]
    scores = diagnosed_many(folder)
    found, findable = sum(s.found for s in scores), sum(s.findable for s in scores)
    off = np.abs([value for s in scores for value in s.off])
    made += [
        Row.at_least(
            "a little of everything: recall by share", float(np.mean([s.share for s in scores])), 0.9
        ),
        Row.at_least("a little of everything: recall by count", found / findable, 0.75),
        Row.at_least(
            "a little of everything: precision",
            sum(s.right for s in scores) / max(sum(s.named for s in scores), 1),
            0.95,
        ),
        Row.at_most("a little of everything: shares off the true ones, median", float(np.median(off)), 0.1),
        Row.at_most(
            "a little of everything: processor time, worst", max(s.seconds for s in scores), 30.0, "s"
        ),
    ]
    with tempfile.TemporaryDirectory() as name:
        return [*made, *_emps(Path(name)), *_ur10e(Path(name)), *_tiago(Path(name))]


def _emps(folder: Path) -> list[Row]:
    result = diagnose(_modelled(emps.emps_log(DATA, folder), "rigid_body"))
    values = {e.effect: next(iter(e.parameters.values())).value for e in result.effects}
    bars = {"coulomb_friction": 20.39, "viscous_friction": 203.5}
    made = []
    for name, published in bars.items():
        off = 100.0 * abs(values.get(name, 0.0) / published - 1.0)
        made.append(Row.at_most(f"EMPS without friction: {name.replace('_', ' ')}", off, 5.0, "% off"))
    return made


def _ur10e(folder: Path) -> list[Row]:
    log, made = ur10e_log(DATA, folder), []
    for judge in ("14harm50sec", "12-50sec", "12-40sec", "10-30sec", "05-20sec"):
        trials = tuple(
            replace(t, role="validation" if judge in t.name else "identification") for t in log.trials
        )
        result = diagnose(_modelled(replace(log, trials=trials), "rigid_body", *FRICTION, "torque_bias"))
        values = {e.location: e for e in result.effects if e.effect == "load_dependent_friction"}
        for joint in UR10E_JOINTS[1:3]:
            gap = result.gap.per_channel[joint]
            value = values[joint].parameters["coefficient"].value if joint in values else 0.0
            text = f"{value:.3f}, RMSE −{100.0 * (1.0 - gap.after / gap.before):.0f} %"
            inside = 0.06 <= value <= 0.075
            made.append(
                Row.holds(
                    f"UR10e judged by {judge}: load-dependent friction, {joint}", ".06 – .075", text, inside
                )
            )
    return made


def _tiago(folder: Path) -> list[Row]:
    result = diagnose(_modelled(tiago_log(DATA, folder), "rigid_body"))
    joints = set(result.gap.per_channel)
    rubbing = {e.location for e in result.effects if e.effect in FRICTION}
    first = result.effects[0].effect if result.effects else "nothing"
    text = f"{len(rubbing & joints)} of {len(joints)}, first {first.replace('_', ' ')}"
    met = joints <= rubbing and first in FRICTION
    return [Row.holds("TIAGo without friction: joints with friction named", "all, friction first", text, met)]


def _modelled(log: Log, *words: str) -> Log:
    return replace(log, header=log.header.model_copy(update={"modelled": words}))


if __name__ == "__main__":
    for score in diagnosed_many(DATA.parent / "gap" / "many", tuple(sys.argv[1:]) or None):
        print(score)
