"""Logs of arms on a fixed base, made in memory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from excite.logs.log import Log, LogHeader, Trial

FRICTION = ("viscous_friction", "coulomb_friction")


def made_log(
    trials: Iterable[Trial], joints: Sequence[str], rate_hz: float, urdf: str | None = None, /, **header: Any
) -> Log:
    """A log of these trials: torques at the motors, bodies and friction modelled, unless the header differs."""
    made = tuple(trials)
    said = {
        "schema": "excite.log/1",
        "robot": "robot.urdf",
        "base": "fixed",
        "rate_hz": rate_hz,
        "joints": list(joints),
        "torque": "motor_side",
        "modelled": ["rigid_body", *FRICTION],
        "trials": [{"file": f"{trial.name}.parquet", "role": trial.role} for trial in made],
    }
    return Log(LogHeader.model_validate(said | header), made, robot_text=urdf)
