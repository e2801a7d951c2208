"""What to measure next: doubts left by poor logs, and whether the motion proposed settles them."""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.blind.documents import HiddenEffect
from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.next_experiment.advice import FILE
from excite.motion.files import load_motion
from excite.safety.check import check_motion
from tests.benchmarks.table import Row
from tests.diagnosis.poor_logs import RECIPES, Recipe, build

SEED = 52026
ROUNDS = 2
# What no motion tells apart: a reading at zero torque does.
STILL = {"torque_bias", "coulomb_asymmetry"}
SAME = {"payload": "link_inertia"}


def same(a: str | None, b: str | None) -> bool:
    """Whether two names count as one."""
    return SAME.get(a or "", a) == SAME.get(b or "", b)


@dataclass(frozen=True)
class Outcome:
    """What became of a case.

    Attributes:
        truth: what is hidden.
        first: what the poor log's diagnosis said.
        eligible: whether that was an honest doubt that motion can settle.
        motion: what was said of the proposed motion, None where none was.
        safe: verdict of the independent check on the file.
        then: what the diagnosis of the log with the motion in it said.
        separated: whether that is firm and right, and the motion safe.
        seconds: processor time of both diagnoses.
    """

    truth: str
    first: str
    eligible: bool
    motion: str | None = None
    safe: bool | None = None
    then: str = ""
    separated: bool = False
    seconds: tuple[float, ...] = field(default=())


def said(result: Diagnosis) -> str:
    """For people."""
    text = f"{result.verdict} " + ", ".join(
        f"{e.effect}@{'/'.join(e.tied_locations)}" for e in result.effects
    )
    tied = result.candidates[: result.n_tied]
    return text + (" among " + " ".join(f"{c.effect}@{c.location}" for c in tied) if tied else "")


def doubt(result: Diagnosis, answer: HiddenEffect) -> bool:
    """Whether the truth is among rivals, names or places, that some motion tells apart."""
    if result.verdict == "ambiguous":
        names = {c.effect for c in result.candidates[: result.n_tied]}
        return not names <= STILL and any(same(answer.effect, name) for name in names)
    places = result.tied_locations
    return result.verdict == "effect" and len(places) > 1 and same(result.effect, answer.effect)


def right(result: Diagnosis, answer: HiddenEffect) -> bool:
    """Whether the verdict is firm and true; what only a reading at zero torque tells apart counts as one."""
    names = {c.effect for c in result.candidates[: result.n_tied]}
    firm = result.verdict == "effect" or (result.verdict == "ambiguous" and names <= STILL)
    named = same(result.effect, answer.effect) or {result.effect, answer.effect} <= STILL
    return firm and named and result.location == answer.location and len(result.tied_locations) <= 1


def outcome(recipe: Recipe, rng: np.random.Generator, out: Path) -> Outcome:
    """Diagnose, take the motion that is proposed, run the true robot on it, diagnose again."""
    case = build(recipe, rng)
    robot, answer = case.virtual.robot, case.answer
    truth = f"{answer.effect}@{answer.location} ({robot.name})"
    started = time.process_time()
    first = diagnose(case.sensed(), robot, out=out)
    seconds = time.process_time() - started
    done = Outcome(truth, said(first), doubt(first, answer), seconds=(seconds,))
    file = first.next_experiment.motion if first.next_experiment is not None else None
    if not done.eligible or file is None:
        return done
    motion = load_motion(out / FILE, robot)
    safe = check_motion(robot, motion).safe
    case.run(motion, "next_a", "identification")
    case.run(motion, "next_b", "validation")
    started = time.process_time()
    again = diagnose(case.sensed(), robot)
    seconds = time.process_time() - started
    return replace(
        done,
        motion=first.next_experiment.why if first.next_experiment is not None else file,
        safe=safe,
        then=said(again),
        separated=safe and right(again, answer),
        seconds=(*done.seconds, seconds),
    )


def outcomes(seed: int = SEED, rounds: int = ROUNDS) -> list[Outcome]:
    """One case a recipe and round; all of them, whether the poor log left a doubt or not."""
    done = []
    for k, child in enumerate(np.random.SeedSequence(seed).spawn(rounds * len(RECIPES))):
        with tempfile.TemporaryDirectory() as place:
            done.append(outcome(RECIPES[k % len(RECIPES)], np.random.default_rng(child), Path(place)))
        if __name__ == "__main__":
            print(k, done[-1], flush=True)
    return done


def rows() -> list[Row]:
    """Figures of the battery."""
    done = [o for o in outcomes() if o.eligible]
    n = max(len(done), 1)
    proposed = [o for o in done if o.motion is not None]
    share = 100.0 * sum(o.separated for o in done) / n
    title = "next experiment"
    return [
        Row.at_least(f"{title}: poor logs that leave a doubt", len(done), 15),
        Row.at_least(f"{title}: separated by the motion proposed", share, 80.0, "%"),
        Row.at_least(f"{title}: with a motion", 100.0 * len(proposed) / n, 80.0, "%"),
        Row.holds(
            f"{title}: motions that the independent check finds safe",
            "all",
            f"{sum(bool(o.safe) for o in proposed)} of {len(proposed)}",
            all(o.safe for o in proposed),
        ),
    ]


if __name__ == "__main__":
    outcomes(int(sys.argv[1]) if len(sys.argv) > 1 else SEED)
