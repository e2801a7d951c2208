"""Logs of positions and commands alone: the practice arms without their torques, and cases drawn blind.

Run alone for a table: of practice cases by name, or ``--blind SEED CASES``.
"""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.make import load_answers, make_cases
from benchmarks.blind.score import BlindScore, score_diagnoses
from excite.arrays import Array
from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from excite.errors import ExciteError
from excite.logs.files import load_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from excite.logs.signals.butterworth import central_differences, lowpass
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from tests.benchmarks.diagnosis_arms import PAIR, folder, same
from tests.benchmarks.table import Row

# Servos of several forms, in about half of the cases without a word on their gains; a seed used for nothing else.
SEED, CASES = 5155, 20
# Errors of a torque sensor: without one there are none, and nothing is the right answer.
_CHANNEL = {"time_delay", "torque_gain", "torque_bias", "torque_ripple"}

# A factor of a torque channel has to leave so much less of the torque to be one.
_CLEARLY = 4.0


@dataclass(frozen=True)
class Said:
    """One case.

    Attributes:
        case: its name.
        truth: what is hidden.
        said: verdict and effects.
        right: the first name is right; no effect where there is none.
        honest: ``ambiguous`` with the right name among the tied, or ``unknown``.
        firm_wrong: a wrong name, or a further one that is not there, without a doubt.
    """

    case: str
    truth: str
    said: str
    right: bool
    honest: bool
    firm_wrong: bool


def without_torque(log: Log, robot: Robot) -> Log:
    """The log without its torques, its servo's gains regressed on them and stated."""
    rate, rows = log.header.rate_hz, []
    for trial in log.role("identification"):
        q, c = (central_differences(lowpass(x, rate, 30.0), rate) for x in (trial.q, trial.q_cmd))
        model = inverse_dynamics(robot.model, c.value, c.first, c.second)
        slope = np.gradient(trial.tau, 1.0 / rate, axis=0)
        made = (c.value - q.value, c.first - q.first, model, slope, trial.tau)
        rows.append(np.stack([lowpass(x, rate, 12.0)[40:-40:4] for x in made], axis=2))
    stacked = np.concatenate(rows).transpose(1, 0, 2)
    gains = np.array([_gains(x[:, :4], x[:, 4]) for x in stacked])
    controller = {
        "mode": "position",
        "kp": dict(zip(log.header.joints, gains[:, 0].tolist(), strict=True)),
        "kd": dict(zip(log.header.joints, gains[:, 1].tolist(), strict=True)),
        "feedforward": "inverse_dynamics",
    }
    header = log.header.model_copy(update={"torque": "none", "controller": controller})
    return replace(log, header=header, trials=tuple(replace(t, tau=None) for t in log.trials))


def _gains(columns: Array, torque: Array) -> Array:
    """kp and kd ``(2,)`` from errors, their rates, the feedforward and the torque's rate ``(n, 4)``, for a torque.

    A constant, a factor and a delay of a torque channel are the sensor's, not the servo's; the last two are believed
    where they leave clearly less: on a joint that hardly needs a feedforward a factor could be anything.
    """
    ones = np.ones((len(torque), 1))
    errors = np.hstack([columns[:, :2], ones])
    rest, scale = torque - columns[:, 2], np.hstack([columns[:, :3], ones])
    late = np.hstack([errors, -columns[:, 3:]])
    tried = [(errors, rest), (scale, torque), (late, rest)]
    found = [np.linalg.lstsq(a, b, rcond=None)[0] for a, b in tried]
    left = [float(np.var(b - a @ x)) for (a, b), x in zip(tried, found, strict=True)]
    if left[0] < _CLEARLY * min(left):
        return found[0][:2]
    return found[2][:2] if left[2] < left[1] else found[1][:2] / found[1][2]


def judged(case: str, answer: dict, result: Diagnosis) -> Said:
    """Compare a diagnosis with what is hidden."""
    hidden = [(e["effect"], e["location"]) for e in answer["effects"]]
    names = [name for name, _ in hidden]
    found = [e.effect for e in result.effects]
    said = f"{result.verdict}: " + ", ".join(f"{e.effect}@{e.location}" for e in result.effects)
    options = {item.effect for item in result.ambiguous_with} | {result.effect}

    def hit(name: str | None) -> bool:
        return any(same(name, n) or {name, n} <= PAIR for n in names)

    silent = result.verdict == "none" and (names[0] == "none" or set(names) <= _CHANNEL)
    right = silent or result.verdict == names[0] or (result.verdict == "effect" and hit(result.effect))
    among = result.verdict == "ambiguous" and any(hit(o) for o in options)
    honest = not right and (result.verdict == "unknown" or among)
    extra = result.verdict in {"effect", "ambiguous"} and any(not hit(f) for f in found[1:])
    wrong = extra or (result.verdict == "effect" and not hit(result.effect))
    truth = ", ".join(f"{n}@{p}" for n, p in hidden)
    if result.verdict == "ambiguous":
        said += " among " + "/".join(sorted(o for o in options if o))
    return Said(case, truth, said, right, honest, wrong)


def verdicts(cases: list[str] | None = None) -> list[Said]:
    """Diagnose the cases; the answers are read after each diagnosis."""
    done = []
    for path in sorted(folder().glob("case_*")):
        if cases and path.name not in cases:
            continue
        log = load_log(path)
        robot = nominal_robot(log)
        result = diagnose(without_torque(log, robot), robot)
        answers = json.loads((folder() / "answers.json").read_text())
        done.append(judged(path.name, answers[path.name], result))
        if __name__ == "__main__":
            s = done[-1]
            flag = "right" if s.right else "honest" if s.honest else "missed"
            print(
                f"{s.case} {s.truth:48} | {s.said:70} {flag}{' FIRM WRONG' if s.firm_wrong else ''}",
                flush=True,
            )
    return done


@dataclass(frozen=True)
class Blind:
    """A battery drawn blind.

    Attributes:
        score: of the diagnoses.
        ratios: by case with an effect: error of its roll-outs with the effects over that without.
        refused: cases that are refused with a reason, such as gains that the motion does not show.
    """

    score: BlindScore
    ratios: dict[str, float]
    refused: tuple[str, ...] = ()

    @property
    def honest(self) -> int:
        """Cases that are called ``unknown`` and are not."""
        return sum(not c.named and c.said.startswith("unknown") for c in self.score.cases)


def blind(seed: int = SEED, cases: int = CASES) -> Blind:
    """Make cases without torque, diagnose all of them, and only then look at the answers."""
    with tempfile.TemporaryDirectory() as place:
        where = Path(place) / "cases"
        make_cases(where, seed=seed, cases=cases, torque="none")
        documents, refused = {}, []
        for case in sorted(where.glob("case_*")):
            try:
                documents[case.name] = diagnose(case).to_json()
            except ExciteError:
                refused.append(case.name)
        return compared(where, documents, tuple(refused))


def compared(where: Path, documents: dict[str, dict[str, Any]], refused: tuple[str, ...] = ()) -> Blind:
    """Diagnoses of a folder's cases beside their answers."""
    ratios = {
        name: float(
            np.linalg.norm(list(document["simulation"]["after"].values()))
            / np.linalg.norm(list(document["simulation"]["before"].values()))
        )
        for name, document in documents.items()
        if document["effects"] and document["simulation"] and document["simulation"]["before"]
    }
    answers = {name: answer for name, answer in load_answers(where).items() if name in documents}
    return Blind(score_diagnoses(answers, documents, {}), ratios, refused)


def rows() -> list[Row]:
    """Figures over the practice arms and the blind ones."""
    return [*_practice_rows(), *_blind_rows()]


def _blind_rows() -> list[Row]:
    found = blind()
    cases, title = found.score.cases, f"command-only blind arms ({CASES} cases)"
    named = sum(case.named for case in cases)
    return [
        Row.at_least(f"{title}: right name", named / CASES, 0.6),
        Row(f"{title}: honestly unknown", "", f"{found.honest} of {CASES}", None),
        Row(f"{title}: refused with a reason", "", f"{len(found.refused)} of {CASES}", None),
        Row.at_most(f"{title}: firmly wrong", sum(c.firm_wrong for c in cases) / CASES, 0.05),
        Row(f"{title}: effects named that are not there", "", str(sum(c.extras for c in cases)), None),
        Row.at_most(f"{title}: worst roll-out, over that without effects", max(found.ratios.values()), 1.0),
    ]


def _practice_rows() -> list[Row]:
    if not folder().is_dir():
        return [Row("command-only practice arms", "", "not found", None)]
    done = verdicts()
    n = len(done)
    share = sum(s.right or s.honest for s in done) / n
    return [
        Row("command-only: right name", "", f"{sum(s.right for s in done)} of {n}", None),
        Row("command-only: honestly ambiguous or unknown", "", f"{sum(s.honest for s in done)} of {n}", None),
        Row.at_least("command-only: right name or honest", share, 0.6),
        Row.at_most("command-only: firmly wrong", sum(s.firm_wrong for s in done) / n, 0.05),
    ]


if __name__ == "__main__":
    if sys.argv[1:2] == ["--blind"]:
        result = blind(int(sys.argv[2]), int(sys.argv[3]))
        for item in result.score.cases:
            print(f"{item.case} {item.truth:60} | {item.said:70} {result.ratios.get(item.case, 0.0):.2f}")
        print(result.score.summary())
    else:
        verdicts(sys.argv[1:] or None)
