"""Simulate cases, write their logs in one folder and what is hidden in another."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from excite.arrays import Array
from excite.blind.arm import N_TRIALS, N_VALIDATION, PAUSE_S, TRIAL_S, Arm, arm_of
from excite.blind.commands import Servo, drawn_servo
from excite.blind.detectability import detectability
from excite.blind.draw import ROBOTS, Draft, draft
from excite.blind.faults import FAULTS
from excite.blind.floating.case import build_floating_case
from excite.blind.floating.draw import floating_draft
from excite.blind.floating.stand import ROBOTS as STANDING_ROBOTS
from excite.blind.forms import OWN_TERMS, background, hide, left_out, without_term
from excite.blind.hidden import Answer, HiddenEffect
from excite.documents.blind import BlindAnswers
from excite.documents.document import read_document
from excite.errors import InputError
from excite.json_document import write_json
from excite.logs.files import save_log
from excite.logs.log import Log, Role, Trial, TrialHeader
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.reading.number import check_count, check_seed
from excite.robot.loading import load_robot
from excite.simulation.effects.friction.bristles import BristleLaw
from excite.simulation.effects.friction.coulomb_asymmetry import AsymmetryLaw
from excite.simulation.effects.friction.friction_drift import WarmingLaw
from excite.simulation.execution import execute
from excite.simulation.recording import Recording
from excite.simulation.sensing import log_header
from excite.simulation.virtual_robot import VirtualRobot

# They take a day, and 10 GB.
_MOST_CASES = 10_000
_NOISE_Q = 2e-5
_NOISE_TAU = 0.01


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
        jobs: number of processes, or an executor, whose machines see the folder; the cases do not depend on it.
        progress: told after each case.

    Returns:
        The file of answers.

    Raises:
        InputError: the folder holds cases already, or no cases are asked for.
        UnknownNameError: no such robot.
    """
    folder = Path(folder)
    check_count(cases, "cases", 1, _MOST_CASES)
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder} is not empty", remedy="name another folder")
    children = check_seed(seed).spawn(cases)
    families = _families(base, robots)
    setting = _Setting(folder.absolute(), families, torque)
    made = in_order(
        _case,
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


def _families(base: str, robots: tuple[str, ...]) -> tuple[tuple[bool, tuple[str, ...]], ...]:
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


def _case(setting: _Setting, task: tuple[int, np.random.SeedSequence]) -> Answer:
    number, child = task
    folder, families = setting.folder, setting.families
    rng = np.random.default_rng(child)
    standing, robots = families[number % len(families)]
    turn = number // len(families)
    if standing:
        case = build_floating_case(floating_draft(turn, rng, robots), rng)
        save_log(case.log, folder / f"case_{number:03d}")
        return case.answer
    plan = draft(turn, rng, robots)
    servo = drawn_servo(rng) if setting.torque == "none" else None
    log, answer = build_case(plan, rng, servo)
    if servo is not None:
        log, answer = servo.logged(log, answer)
    save_log(log, folder / f"case_{number:03d}")
    return answer


def build_case(plan: Draft, rng: np.random.Generator, servo: Servo | None = None) -> tuple[Log, Answer]:
    """Simulate one case.

    Args:
        plan: what it is to have.
        rng: source of everything else.
        servo: of the arm, where it is another than the robot's own.

    Returns:
        Its log and what is hidden in it.
    """
    arm = arm_of(load_robot(plan.robot), plan.fixed, rng)
    if servo is not None:
        arm = servo.on(arm)
    start = deepcopy(rng)
    virtual, hidden, modelled, others = _prepare(arm, plan, rng)
    recordings = recordings_of(virtual, arm)
    spread = np.vstack([r.tau_motor for r in recordings]).std(axis=0)
    sigma = plan.noise * (_NOISE_TAU * spread + 2e-4 * spread.max())
    trials, headers = _session(recordings, arm, plan, sigma, rng)
    header = log_header(virtual.robot, headers).model_copy(update={"modelled": modelled})
    log = Log(header=header, trials=trials, robot_text=virtual.robot.urdf)
    known = []
    for k, item in enumerate(hidden):
        twin = _prepare(arm, plan, deepcopy(start), without=k)[0]
        clear = detectability(arm.virtual.robot, recordings, recordings_of(twin, arm), modelled, sigma)
        known.append(replace(item, detectability=clear))
    return log, Answer(plan.kind, plan.robot, modelled, tuple(known), plan.noise, plan.faults, others)


def _prepare(
    arm: Arm, plan: Draft, rng: np.random.Generator, without: int | None = None
) -> tuple[VirtualRobot, tuple[HiddenEffect, ...], tuple[str, ...], tuple[HiddenEffect, ...]]:
    """The robot with everything in it, what is hidden, what the log says is modelled, and the background.

    ``without``: position of a hidden effect that is drawn but left out.
    """
    virtual, n = arm.virtual, arm.virtual.robot.n_joints
    hidden: list[HiddenEffect] = []
    modelled = ["rigid_body_fixed" if plan.fixed else "rigid_body", *OWN_TERMS]
    joints = rng.permutation(np.arange(1, n - 1) if plan.fixed else np.arange(n))
    size = 0.6 if plan.kind == "weak" else 1.0
    for k, ((effect, form), drawn) in enumerate(zip(plan.effects, joints, strict=False)):
        if effect in modelled:
            modelled.remove(effect)
        joint = _fit(arm, effect, int(drawn))
        changed, what = hide(virtual, arm, effect, form, joint, size, rng)
        virtual = changed if k != without else left_out(virtual, changed, effect, joint)
        hidden.append(what)
    others: tuple[HiddenEffect, ...] = ()
    if plan.kind == "weak":
        virtual, others = background(virtual, arm, rng)
    if plan.absent in modelled:
        modelled.remove(plan.absent)
        virtual = replace(virtual, drives=without_term(virtual.drives, plan.absent))
    if plan.bristles and "coulomb_friction" in modelled:
        # Bristles take the place of dry friction; a law that takes some of it away would find none.
        taken = {law.joint for law in virtual.laws if isinstance(law, BristleLaw | AsymmetryLaw | WarmingLaw)}
        for j in set(range(n)) - taken:
            virtual = virtual.with_law(BristleLaw(j, float(virtual.drives.coulomb[j]), breakaway=1.5e-3))
    return virtual, tuple(hidden), tuple(modelled), others


def _fit(arm: Arm, effect: str, joint: int) -> int:
    """A joint at which the effect can show: load-dependent friction needs a load, a payload an end."""
    n = len(arm.load)
    if effect == "load_dependent_friction" and arm.load[joint] < 0.1 * arm.load.max():
        return int(np.argmax(arm.load))
    return n - 1 if effect == "payload" and joint % 2 else joint


def recordings_of(virtual: VirtualRobot, arm: Arm) -> list[Recording]:
    """Identification trials, validation trials, then the first command again, without noise."""
    runs = [*arm.motions, replace(arm.motions[0], name=f"trial_{N_TRIALS + N_VALIDATION:02d}")]
    memory: dict[Any, Any] = {}
    recordings: list[Recording] = []
    for k, motion in enumerate(runs):
        recording = execute(virtual, motion, session_s=k * (TRIAL_S + PAUSE_S), memory=memory)
        for reading in virtual.readings:
            recording = reading(recording)
        recordings.append(recording)
    return recordings


def _session(
    recordings: list[Recording], arm: Arm, plan: Draft, sigma: Array, rng: np.random.Generator
) -> tuple[tuple[Trial, ...], tuple[TrialHeader, ...]]:
    """The trials as sensors and logger give them."""
    trials, headers = [], []
    for k, recording in enumerate(recordings):
        role: Role = "validation" if N_TRIALS <= k < N_TRIALS + N_VALIDATION else "identification"
        repeats = f"{arm.motions[0].name}.parquet" if k == len(recordings) - 1 else None
        file = f"{recording.name}.parquet"
        headers.append(TrialHeader(file=file, role=role, start_s=k * (TRIAL_S + PAUSE_S), repeats=repeats))
        shape = recording.q.shape
        trial = Trial(
            name=recording.name,
            role=role,
            time=recording.time,
            q=recording.q + plan.noise * _NOISE_Q * rng.standard_normal(shape),
            tau=recording.tau_motor + sigma * rng.standard_normal(shape),
            q_cmd=recording.q_cmd,
            start_s=headers[-1].start_s,
        )
        for fault in plan.faults:
            trial = FAULTS[fault](trial, rng)
        trials.append(trial)
    return tuple(trials), tuple(headers)
