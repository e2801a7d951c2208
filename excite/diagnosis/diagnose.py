"""The diagnosis of a log: where it differs from its nominal model, which effect explains it, how far it shrinks."""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.diagnosis.answer.answer import Diagnosis, estimated_gains
from excite.diagnosis.arm.diagnose import diagnose_arm
from excite.diagnosis.effects.readings import TimeDelay, TorqueGain
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.own_columns import SCALED
from excite.diagnosis.equations.standstill import long_trials
from excite.diagnosis.floating.diagnose import diagnose_floating
from excite.diagnosis.floating.registry import FLOATING_EFFECTS
from excite.diagnosis.servo.diagnose import diagnose_commands
from excite.diagnosis.servo.gains import torque_constants
from excite.diagnosis.servo.servo import read_signals
from excite.diagnosis.walking.diagnose import diagnose_walking, is_walking
from excite.doctor.doubt import Doubt
from excite.doctor.examine import Chart, examine
from excite.errors import InputError, LogError
from excite.finding import list_names
from excite.formats.number import check_seed
from excite.logs.load_with_robot import robot_and_log
from excite.logs.log import Log, LogHeader
from excite.logs.robot import robot_in_log
from excite.logs.vocabulary import RIGID_BODY
from excite.progress import Progress, silent, told_to
from excite.robot.load import RobotLike
from excite.robot.robot import Robot
from excite.rows.drive_terms import DRIVE_TERMS
from excite.rows.joint_rows import drive_terms
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread


@one_blas_thread
def diagnose(
    log: str | Path | Log,
    robot: RobotLike | None = None,
    *,
    seed: int = 0,
    out: str | Path | None = None,
    budget: bool = True,
    progress: Progress = silent,
) -> Diagnosis:
    """Find where a robot differs from its nominal model, which effect causes it, and how far it shrinks.

    Args:
        log: a log folder, or a log in memory.
        robot: the nominal model, or what :func:`~excite.robot.load.load_robot` takes; by default the one that the
            log names.
        seed: of the bootstrap.
        out: folder for the augmented simulator and motions; none are written without it.
        budget: whether the answer holds where each joint's gap goes: shares of all effects together, what has no
            name, what does not repeat. The verdict is read from it either way.
        progress: told at each step.

    Returns:
        The diagnosis (``excite.diagnosis/1``).

    Raises:
        LogError: the log is malformed or has not what a diagnosis needs.
        IllLogError: no check can save the log; with the findings.
        InputError: a diagnosis of this kind of log is not available.
    """
    rng = np.random.default_rng(check_seed(seed))
    robot, loaded = robot_and_log(robot, log)
    if robot.mechanism is not None and (
        loaded.header.free_base or loaded.header.torque in {"none", "current"}
    ):
        raise InputError(
            "has joints that no motor drives, and effects are told through loops and couplings by joint torques on a "
            "fixed base alone",
            source=robot.source,
            field="loops" if robot.description.loops else "couplings",
            remedy="identify it, or record its torques on a stand",
        )
    if not loaded.header.free_base and not loaded.role("identification"):
        raise LogError(
            "has no identification trial", field="trials", remedy="give one the role identification"
        )
    with told_to(progress):
        found = _examine_and_diagnose(robot, loaded, rng, None if out is None else Path(out))
    return found if budget else replace(found, budget=None)


def _examine_and_diagnose(robot: Robot, log: Log, rng: np.random.Generator, folder: Path | None) -> Diagnosis:
    """The diagnosis of a log that the doctor looks through first, with what limits it."""
    header = log.header
    if header.free_base or header.torque == "none":
        chart = examine(robot, log)
    else:
        # A delay is told apart from what looks like one: viscous friction made torques of 25 ms 31 ms late.
        chart = examine(robot, log, latest_s=TimeDelay.linear[0].high)
    chart.check_usable()
    trials = chart.log.trials if chart.log.header.free_base else long_trials(robot, chart.log)
    short = [trial.name for trial in chart.log.trials if trial.name not in {kept.name for kept in trials}]
    chart = replace(chart, log=replace(chart.log, trials=trials))
    found = _diagnose_clean(robot, chart, rng, folder)
    limits = tuple(item.text for item in chart.findings if not item.repaired and item.severity != "note")
    left_out = (f"left out, as their motion is over too soon: {list_names(short)}",) if short else ()
    doubts = (describe_doubts(chart.doubts),) if chart.doubts else ()
    warnings = (*limits, *left_out, *doubts, *found.warnings)
    faults = (*chart.findings, *found.faults)
    return replace(found, faults=faults, warnings=warnings, modelled=baseline_of(chart))


def _diagnose_clean(robot: Robot, chart: Chart, rng: np.random.Generator, folder: Path | None) -> Diagnosis:
    """The diagnosis of a log that the doctor has repaired; what a fault could be taken for is no candidate."""
    loaded = chart.log
    # The doctor may have turned gravity, or a sensor.
    robot = robot_in_log(robot, loaded.header)
    modelled = baseline_of(chart)
    if modelled != loaded.header.modelled:
        loaded = replace(loaded, header=loaded.header.model_copy(update={"modelled": modelled}))
    if is_walking(loaded):
        return diagnose_walking(robot, loaded)
    if not loaded.header.free_base:
        if loaded.header.torque == "none":
            return diagnose_commands(robot, loaded, rng, folder)
        verb = diagnose_currents if loaded.header.torque == "current" else diagnose_arm
        return verb(robot, loaded, rng, folder)
    return diagnose_floating(loaded, robot, rng, folder)


def baseline_of(chart: Chart) -> tuple[str, ...]:
    """What the baseline has: what the log says, less what the doctor doubts."""
    modelled = _baseline_terms(chart.log.header)
    return in_doubt(modelled, chart.doubts) if chart.doubts else modelled


def _baseline_terms(header: LogHeader) -> tuple[str, ...]:
    """What the log says that the baseline has, else what an identification takes where it says nothing."""
    if "modelled" in header.model_fields_set or header.free_base or header.torque == "none":
        return header.modelled
    usual = (DRIVE_TERMS[name].effects for name in drive_terms(header, ProblemSettings()))
    return (*header.modelled, *(effects[0] for effects in usual if effects))


# What a diagnosis leaves open where the log tells a quantity only about.

_IDENTIFIED, _GIVEN = RIGID_BODY


def in_doubt(modelled: Sequence[str], doubts: AbstractSet[Doubt]) -> tuple[str, ...]:
    """Words of ``modelled`` for a log with doubts.

    Effects that are told by what is in doubt are no candidates. Their rest would be given the name of another effect
    as long as bodies are taken as given, so these are identified along.

    Args:
        modelled: the words that the log has.
        doubts: what it tells only about.

    Returns:
        The words to diagnose by.
    """
    words = dict.fromkeys(modelled)
    if any(doubt.of_bodies for doubt in doubts) and _GIVEN in words:
        words = dict.fromkeys(_IDENTIFIED if word == _GIVEN else word for word in modelled)
    told = [effect.name for effect in EFFECTS.values() if effect.observed_by & doubts]
    told += [effect.name for effect in FLOATING_EFFECTS.values() if effect.observed_by & doubts]
    return tuple(words | dict.fromkeys(told))


def describe_doubts(doubts: AbstractSet[Doubt]) -> str:
    """The same in a sentence."""
    open_ = " and ".join(doubt.value for doubt in Doubt if doubt in doubts)
    bodies = "; bodies are identified along" if any(doubt.of_bodies for doubt in doubts) else ""
    return f"the log tells only about {open_}: effects that are told by it are not tried{bodies}"


# Logs with motor currents: torques once each joint's torque constant is known.


def diagnose_currents(robot: Robot, log: Log, rng: np.random.Generator, out: Path | None = None) -> Diagnosis:
    """Diagnose a log of a fixed-base arm that has motor currents.

    Stated torque constants turn currents to torques. Those that are not stated are estimated with the nominal
    masses for a scale; a gain of such a joint is then no effect that could be found, and no other name is taken
    for it. Where the bodies are given, constants are estimated beside a load and a tilt that nobody knew of.

    Args:
        robot: the nominal model.
        log: the log, with an identification trial.
        rng: of the bootstrap.
        out: folder for the augmented simulator.

    Returns:
        The diagnosis.

    Raises:
        LogError: currents are missing, or a constant is neither stated nor to be had.
    """
    for trial in log.trials:
        if trial.current is None:
            raise LogError(
                "has no currents", source=trial.name, field="i", remedy="log i.* of every joint [A]"
            )
    joints, stated = log.header.joints, log.header.torque_constants
    # Currents that mean nothing are not made torques of.
    known = np.array([1.0 if j in log.header.no_torque else float(stated.get(j, np.nan)) for j in joints])
    inside = log.role("identification")
    signals = {t.name: read_signals(robot, log, replace(t, q_cmd=t.q)) for t in inside}
    currents = {t.name: t.current for t in inside if t.current is not None}
    constants = torque_constants(robot, log, signals, currents, known)
    guessed = [j for j, k in zip(joints, known, strict=True) if np.isnan(k)]
    # Constants are as good as what else was fitted with them: beside given bodies their scale stays open.
    scaled = (SCALED,) if "rigid_body" not in log.header.modelled else ()
    modelled = (*log.header.modelled, *((TorqueGain.name, *scaled) if guessed else ()))
    header = log.header.model_copy(update={"torque": "motor_side", "modelled": modelled})
    trials = tuple(
        replace(t, tau=t.current * constants, current=None) for t in log.trials if t.current is not None
    )
    result = diagnose_arm(robot, replace(log, header=header, trials=trials), rng, out)
    said = "torques are currents times torque constants: a wrong constant is a torque_gain"
    if guessed:
        values = ", ".join(
            f"{j} {k:.3g} N·m/A" for j, k in zip(joints, constants, strict=True) if j in guessed
        )
        hidden = ", and a gap that is the same share of all torques, such as a payload's beside gravity alone, may be "
        said = (
            f"torque constants are not stated and were estimated with the nominal masses for a scale ({values}): "
            f"a torque_gain cannot be seen{'' if scaled else f'{hidden}hidden in them'}"
        )
    gains = estimated_gains(robot, joints, "torque_constant", "N·m/A", constants, np.isnan(known))
    return replace(result, warnings=(*result.warnings, said), absorbed=(*gains, *result.absorbed))
