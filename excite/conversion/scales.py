"""What one unit of a motor current, or of a torque of unknown unit, is worth by the weights of the nominal model."""

from __future__ import annotations

import numpy as np

from excite.doctor.reading import Reading
from excite.doctor.torque_samples import torque_samples
from excite.errors import InputError
from excite.logs.log import Log
from excite.robot.robot import Robot

# Share of a current's power that gravity and inertia have to explain before their size says anything of its scale.
_TELLING = 0.5
# Nominal masses are off by some tenths, and a scale is no better than they are.
_AS_STATED = 1.6


def scale_notes(robot: Robot, log: Log) -> list[str]:
    """Torque per ampere of each joint whose current the nominal model explains, and torques of another scale.

    A sentence each; nothing of it is applied, as the nominal model may be what is wrong.

    Args:
        robot: the nominal model.
        log: the log; nothing is said of one without torques and currents.
    """
    if log.header.torque in ("none", None) or log.header.base != "fixed":
        return []
    try:
        samples = torque_samples(robot, log)
    except InputError:
        return []
    if samples is None:
        return []
    gains, shares = samples.gains(Reading.as_stated(log))
    joints = log.header.torque_joints
    known = [k for k in range(len(joints)) if shares[k] > _TELLING and gains[k] != 0.0]
    if log.header.torque == "current" and not log.header.torque_constants:
        said = [f"{joints[k]}: {1.0 / gains[k]:.3g}" for k in known]
        if not said:
            return ["no current follows gravity and inertia closely enough to tell torques per ampere"]
        return [
            "by the nominal masses, N·m per A are {" + ", ".join(said) + "}; "
            "write them under log: {torque_constants: …} in map.yaml if data sheets agree"
        ]
    off = [k for k in known if not 1.0 / _AS_STATED < abs(gains[k]) < _AS_STATED]
    if not off:
        return []
    factor = float(np.median(np.abs(gains[off])))
    names = ", ".join(f"{joints[k]} {gains[k]:.2f}" for k in off)
    return [
        f"torques are not those of the nominal masses ({names} times as large): another side of the gear, a torque "
        f"constant applied twice or not at all, or a load; scale: {{tau: {1.0 / factor:.3g}}} in map.yaml would undo it"
    ]
