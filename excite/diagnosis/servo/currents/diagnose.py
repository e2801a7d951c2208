"""Logs with motor currents: torques once each joint's torque constant is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.diagnosis.answer.absorbed import estimated_gains
from excite.diagnosis.answer.result import Diagnosis
from excite.diagnosis.arm.diagnose import diagnose_arm
from excite.diagnosis.effects.readings.torque_gain import TorqueGain
from excite.diagnosis.equations.own_columns import SCALED
from excite.diagnosis.servo.gains import torque_constants
from excite.diagnosis.servo.servo import read_signals
from excite.errors import LogError
from excite.logs.log import Log
from excite.robot.robot import Robot


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
