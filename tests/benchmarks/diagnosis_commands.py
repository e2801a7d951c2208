"""The practice arms without their torques: positions, commands and gains alone; run alone for a table."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace

import numpy as np

from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.result import Diagnosis
from excite.logs.files import load_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from excite.logs.signals.butterworth import lowpass
from excite.logs.signals.differentiate import central_differences
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from tests.benchmarks.diagnosis_arms import PAIR, folder, same
from tests.benchmarks.table import Row

# Errors of a torque sensor: without one there are none, and nothing is the right answer.
_CHANNEL = {"time_delay", "torque_gain", "torque_bias", "torque_ripple"}


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
        made = (c.value - q.value, c.first - q.first, model, trial.tau)
        rows.append(np.stack([lowpass(x, rate, 12.0)[40:-40:4] for x in made], axis=2))
    stacked = np.concatenate(rows).transpose(1, 0, 2)
    # A constant and a factor of a torque channel are the sensor's, not the servo's.
    ones = np.ones((stacked.shape[1], 1))
    found = [np.linalg.lstsq(np.hstack([x[:, :3], ones]), x[:, 3], rcond=None)[0] for x in stacked]
    gains = np.array([f[:2] / f[2] for f in found])
    controller = {
        "mode": "position",
        "kp": dict(zip(log.header.joints, gains[:, 0].tolist(), strict=True)),
        "kd": dict(zip(log.header.joints, gains[:, 1].tolist(), strict=True)),
        "feedforward": "inverse_dynamics",
    }
    header = log.header.model_copy(update={"torque": "none", "controller": controller})
    return replace(log, header=header, trials=tuple(replace(t, tau=None) for t in log.trials))


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


def rows() -> list[Row]:
    """Figures over all practice arms."""
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
    verdicts(sys.argv[1:] or None)
