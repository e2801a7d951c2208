"""Simulate cases, write their logs in one folder and what is hidden in another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from excite.blind.case import build_case
from excite.blind.commands import drawn_servo
from excite.blind.draw import ROBOTS, draft_case
from excite.blind.everything.case import build_mixture
from excite.blind.everything.draw import draw_mixture
from excite.blind.floating.case import build_floating_case
from excite.blind.floating.draw import floating_draft
from excite.blind.floating.stand import ROBOTS as STANDING_ROBOTS
from excite.blind.hidden import Answer
from excite.documents.blind import BlindAnswers
from excite.documents.document import read_document
from excite.errors import InputError
from excite.json_document import write_json
from excite.logs.files import save_log
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.reading.number import check_count, check_seed
from excite.robot.loading import load_robot

# They take a day, and 10 GB.
_MOST_CASES = 10_000

Kind = Literal["ordinary", "everything", "both"]


def answers_file(folder: Path) -> Path:
    """Where the answers of a folder of cases are: beside it, not in it."""
    return folder.parent / f"{folder.name}-answers.json"


def make_cases(
    folder: str | Path,
    *,
    seed: int,
    cases: int = 20,
    base: Literal["fixed", "floating", "both"] = "fixed",
    robots: tuple[str, ...] = (),
    torque: Literal["motor_side", "none"] = "motor_side",
    kind: Kind = "ordinary",
    jobs: Jobs = 1,
    progress: Progress = silent,
) -> Path:
    """Write cases ``case_000`` … into a folder and what is hidden in them into a file beside it.

    Args:
        folder: of the cases; must not hold any yet.
        seed: of everything.
        cases: how many.
        base: arms, standing robots with contact wrenches, or both by turns.
        robots: to choose from, whatever ``base``; none: those of the base.
        torque: what the logs of arms have; without torque, commands and position servos of several forms, whose gains
            are stated in about half of the cases.
        kind: ``ordinary`` cases of one effect, two or none; arms with a little of ``everything`` and the true share of
            each effect in their answers; or ``both`` by turns.
        jobs: number of processes, or an executor, whose machines see the folder; the cases do not depend on it.
        progress: told after each case.

    Returns:
        The file of answers.

    Raises:
        InputError: the folder holds cases already, no cases are asked for, or a little of everything is asked for
            of robots that are no arms with torques.
        UnknownNameError: no such robot.
    """
    folder = Path(folder)
    check_count(cases, "cases", 1, _MOST_CASES)
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder} is not empty", remedy="name another folder")
    children = check_seed(seed).spawn(cases)
    families = _robot_families(base, robots)
    if kind != "ordinary" and (torque == "none" or any(standing for standing, _ in families)):
        remedy = "ask for arms with torques, or for ordinary cases"
        raise InputError("a little of everything is hidden in arms with torques only", remedy=remedy)
    setting = _Setting(folder.absolute(), families, torque, kind)
    made = in_order(
        _make_case,
        enumerate(children),
        jobs=jobs,
        shared=setting,
        total=cases,
        stage="blind cases",
        progress=progress,
    )
    answers = {f"case_{k:03d}": answer.to_json() for k, answer in enumerate(list(made))}
    target = answers_file(folder)
    write_json({"schema": "excite.blind/1", "seed": seed, "cases": answers}, target)
    return target


def load_answers(folder: str | Path) -> dict[str, Answer]:
    """What is hidden in the cases of a folder.

    Raises:
        InputError: there is no such file, or a field in it is missing or wrong.
    """
    path = answers_file(Path(folder))
    document = read_document(path, BlindAnswers, remedy="make the cases with `excite blind make`").content()
    return {name: Answer.from_json(item) for name, item in document["cases"].items()}


def _robot_families(base: str, robots: tuple[str, ...]) -> tuple[tuple[bool, tuple[str, ...]], ...]:
    """Standing or not, and the robots to choose from; the cases take them by turns."""
    if robots:
        standing = {name: load_robot(name).floating for name in robots}
        both = ((kind, tuple(name for name in robots if standing[name] is kind)) for kind in (False, True))
        return tuple(family for family in both if family[1])
    wanted = {"fixed": (False,), "floating": (True,), "both": (False, True)}[base]
    return tuple((kind, STANDING_ROBOTS if kind else ROBOTS) for kind in wanted)


@dataclass(frozen=True)
class _Setting:
    """What all cases of a folder have in common."""

    folder: Path
    families: tuple[tuple[bool, tuple[str, ...]], ...]
    torque: str
    kind: Kind


def _make_case(setting: _Setting, task: tuple[int, np.random.SeedSequence]) -> Answer:
    number, child = task
    folder, families = setting.folder, setting.families
    rng = np.random.default_rng(child)
    standing, robots = families[number % len(families)]
    turn = number // len(families)
    if standing:
        case = build_floating_case(floating_draft(turn, rng, robots), rng)
        save_log(case.log, folder / f"case_{number:03d}")
        return case.answer
    if setting.kind == "both":
        mixed, turn = bool(turn % 2), turn // 2
    else:
        mixed = setting.kind == "everything"
    if mixed:
        log, answer = build_mixture(draw_mixture(rng, robots), rng)
        save_log(log, folder / f"case_{number:03d}")
        return answer
    plan = draft_case(turn, rng, robots)
    servo = drawn_servo(rng) if setting.torque == "none" else None
    log, answer = build_case(plan, rng, servo)
    if servo is not None:
        log, answer = servo.logged(log, answer)
    save_log(log, folder / f"case_{number:03d}")
    return answer
