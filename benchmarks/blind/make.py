"""Simulate cases, write their logs in one folder and what is hidden in another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin
from scipy.signal import butter, sosfiltfilt

from benchmarks.blind.arm_case import drawn_servo
from benchmarks.blind.arms_with_everything import build_mixture, draw_mixture
from benchmarks.blind.case import build_case
from benchmarks.blind.documents import Answer, BlindAnswers
from benchmarks.blind.draw import ROBOTS, draft_case
from benchmarks.blind.floating import MAKERS, FloatingDraft, Hidden, Site, floating_draft
from benchmarks.blind.standing_case import ROBOTS as STANDING_ROBOTS
from benchmarks.blind.standing_case import Stand, stand_of, trial_of
from benchmarks.blind.standing_effects import Truth, truth_of
from excite.arrays import Array
from excite.documents.document import read_document
from excite.errors import InputError
from excite.formats.number import check_count, check_seed
from excite.logs.files import save_log
from excite.logs.log import Log, Trial
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.results import write_json
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.simulation.virtual_robot import Recording

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
    answers = {f"case_{k:03d}": answer for k, answer in enumerate(list(made))}
    target = answers_file(folder)
    write_json(BlindAnswers(answers, seed).to_json(), target)
    return target


def load_answers(folder: str | Path) -> dict[str, Answer]:
    """What is hidden in the cases of a folder.

    Raises:
        InputError: there is no such file, or a field in it is missing or wrong.
    """
    path = answers_file(Path(folder))
    remedy = "make the cases with `python -m benchmarks.blind make`"
    return dict(read_document(path, BlindAnswers, remedy=remedy).cases)


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


# One standing case: its log and what is hidden in it.

# An effect is drawn again, larger, until it stands out as much.
_CLEAR, _DRAWS, _GROWTH = 0.6, 6, 1.25


@dataclass(frozen=True, eq=False)
class FloatingCase:
    """A standing case.

    Attributes:
        log: what is diagnosed.
        answer: what is hidden in it.
        quiet: the same trials without noise, for judging how much of a gap was really closed.
    """

    log: Log
    answer: Answer
    quiet: Log


def build_floating_case(plan: FloatingDraft, rng: np.random.Generator) -> FloatingCase:
    """Simulate one case.

    Args:
        plan: what it is to have.
        rng: source of everything else.

    Raises:
        NoSolutionError: no safe motions were found.
    """
    stand = stand_of(plan.robot, plan.sensors, plan.fixed, plan.noise, rng)
    plain = truth_of(stand)
    recordings = plain.logged()
    truth, hidden = plain, []
    if plan.effects:
        noisy = _logged_trials(stand, recordings, plan.noise, rng)
        yardstick = Yardstick(stand.robot, stand.free, _logged_trials(stand, recordings, 0.0, rng), noisy)
        for k, (effect, form) in enumerate(plan.effects):
            place = _clear_place(plain, yardstick, effect, form, rng)
            truth, what = _hidden_record(truth, effect, form, place.size, place.seed)
            hidden.append(replace(what, detectability=place.clear))
            recordings = place.recordings if k == 0 else truth.logged()
    hidden.sort(key=lambda item: -(item.detectability or 0.0))
    trials = _logged_trials(stand, recordings, plan.noise, rng)
    log = Log(header=stand.header, trials=trials, robot_text=stand.robot.urdf)
    answer = Answer(plan.kind, plan.robot, stand.header.modelled, tuple(hidden), plan.noise)
    return FloatingCase(log, answer, replace(log, trials=_logged_trials(stand, recordings, 0.0, rng)))


@dataclass(frozen=True, eq=False)
class _Place:
    """A drawn effect by itself: its draw, how far it stands out, and what perfect sensors log of it."""

    clear: float
    seed: int
    size: float
    recordings: list[Recording]


def _clear_place(
    plain: Truth, yardstick: Yardstick, effect: str, form: str, rng: np.random.Generator
) -> _Place:
    """The first draw that stands out, or the clearest of several."""
    drawn: list[_Place] = []
    for k in range(_DRAWS):
        seed, size = int(rng.integers(1 << 53)), _GROWTH**k
        recordings = _hidden_record(plain, effect, form, size, seed)[0].logged()
        clear = yardstick.detectability(_logged_trials(plain.stand, recordings, 0.0, rng))
        drawn.append(_Place(clear, seed, size, recordings))
        if clear >= _CLEAR:
            break
    return max(drawn, key=lambda item: item.clear)


def _hidden_record(truth: Truth, effect: str, form: str, size: float, seed: int) -> Hidden:
    return MAKERS[effect](Site(truth, effect, form, size, np.random.default_rng(seed)))


def _logged_trials(
    stand: Stand, recordings: list[Recording], noise: float, rng: np.random.Generator
) -> tuple[Trial, ...]:
    return tuple(
        trial_of(stand.robot, recording, header, noise, rng)
        for recording, header in zip(recordings, stand.header.trials, strict=True)
    )


# How far a hidden effect stands above the noise of a standing robot's log.

_BAND_HZ = 3.5
_EVERY, _EDGE = 4, 10


class Yardstick:
    """What the model's own freedom can take of a session, and what its noise is like.

    Args:
        robot: the nominal robot.
        free: whether its inertial parameters are identified.
        clean: trials of the robot without any effect, without noise.
        noisy: the same with noise.
    """

    def __init__(self, robot: Robot, free: bool, clean: Sequence[Trial], noisy: Sequence[Trial]) -> None:
        self._robot = robot
        plain = [_wrench_residual(robot, trial) for trial in clean]
        loud = [_wrench_residual(robot, trial) for trial in noisy]
        self._plain = np.concatenate(plain)
        self._sigma = (np.concatenate(loud) - self._plain).std(axis=0)
        self._basis: Array | None = None
        if free:
            rows = np.concatenate([_wrench_regressor(robot, trial) for trial in clean]) / self._sigma[:, None]
            flat = rows.reshape(-1, rows.shape[2])
            u, size, _ = np.linalg.svd(flat[:, flat.any(axis=0)], full_matrices=False)
            self._basis = u[:, size > 1e-6 * size[0]]

    def detectability(self, trials: Sequence[Trial]) -> float:
        """Rest of what differs in noiseless trials that the model cannot take, over the noise in the band.

        Each component of the base's wrench counts by its own noise, and all alike.
        """
        change = np.concatenate([_wrench_residual(self._robot, trial) for trial in trials]) - self._plain
        white = (change / self._sigma).ravel()
        if self._basis is not None:
            white = white - self._basis @ (self._basis.T @ white)
        return float(np.sqrt(np.mean(white**2)))


def _wrench_residual(robot: Robot, trial: Trial) -> Array:
    """``(m, 6)`` measured less nominal wrench at the base, in band."""
    data, rows = robot.model.createData(), []
    for k, q, v, a in _difference_states(robot, trial):
        pin.forwardKinematics(robot.model, data, q)
        total = pin.Force.Zero()
        for sensor in robot.sensors:
            pose = data.oMi[sensor.joint] * sensor.placement
            total += data.oMi[1].actInv(pose.act(pin.Force(trial.wrenches[sensor.name][k])))
        body = _base_rows(robot, data, q, v, a)
        rows.append(total.vector - body @ robot.nominal_parameters)
    return _in_band(np.array(rows), trial)


def _wrench_regressor(robot: Robot, trial: Trial) -> Array:
    data = robot.model.createData()
    rows = np.array([_base_rows(robot, data, q, v, a) for _, q, v, a in _difference_states(robot, trial)])
    return _in_band(rows, trial)


def _base_rows(robot: Robot, data: pin.Data, q: Array, v: Array, a: Array) -> Array:
    body = np.array(pin.computeJointTorqueRegressor(robot.model, data, q, v, a)[:6])
    for sensor in robot.sensors:
        for segment in sensor.excludes:
            body[:, 10 * segment : 10 * segment + 10] = 0.0
    return body


def _difference_states(robot: Robot, trial: Trial) -> list[tuple[int, Array, Array, Array]]:
    """Sample, configuration, velocity and acceleration by differences."""
    step = float(trial.time[1] - trial.time[0])
    q = np.hstack([np.asarray(trial.base), trial.q])
    out = []
    for k in range(_EDGE, len(q) - _EDGE, _EVERY):
        ahead, back = (pin.difference(robot.model, q[k], q[k + way]) for way in (1, -1))
        v, a = (ahead - back) / (2.0 * step), (ahead + back) / step**2
        out.append((k, q[k], v, a))
    return out


def _in_band(values: Array, trial: Trial) -> Array:
    rate = 1.0 / (_EVERY * float(trial.time[1] - trial.time[0]))
    sos = butter(4, _BAND_HZ, fs=rate, output="sos")
    return np.asarray(sosfiltfilt(sos, values, axis=0))
