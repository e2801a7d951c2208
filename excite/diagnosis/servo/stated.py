"""What ``controller`` of a log says about its servo."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.diagnosis.servo.servo import FEEDFORWARDS
from excite.errors import LogError

_REMEDY = "log tau.* or tau_cmd.* with such a controller"
# Words of ``feedforward`` and the three forms that they mean.
_WORDS = {
    "none": "none",
    "off": "none",
    "gravity": "gravity",
    "gravity_compensation": "gravity",
    "inverse_dynamics": "inverse_dynamics",
    "computed_torque": "inverse_dynamics",
    "rigid_body": "inverse_dynamics",
    "rigid_body_dynamics": "inverse_dynamics",
    "rnea": "inverse_dynamics",
    "nominal": "inverse_dynamics",
    "nominal_model": "inverse_dynamics",
    "model": "inverse_dynamics",
    "full": "inverse_dynamics",
}
# Words of ``velocity_reference`` for a servo that brakes all motion, not what differs from the command's.
_NO_REFERENCE = frozenset({"none", "zero", "0", "0.0", "off", "false"})


@dataclass(frozen=True, eq=False)
class Stated:
    """A position servo as far as a log describes it.

    Attributes:
        kp: ``(n_joints,)`` in the log's order [N·m/rad], NaN where it is not stated.
        kd: ``(n_joints,)`` [N·m·s/rad], NaN where it is not stated.
        ki: ``(n_joints,)`` [N·m/(rad·s)], 0 where it is not stated.
        feedforwards: forms that it may have.
        follows: whether damping acts on the velocity's error; both where that is open.
        missing: what is not stated, in words.
        rate_hz: of the servo, None where it is not stated [Hz].
    """

    kp: Array
    kd: Array
    ki: Array
    feedforwards: tuple[str, ...]
    follows: tuple[bool, ...]
    missing: tuple[str, ...]
    rate_hz: float | None = None


def stated_servo(controller: Mapping[str, Any] | None, joints: tuple[str, ...]) -> Stated:
    """Read ``controller``.

    Args:
        controller: of the log's header.
        joints: of the log.

    Returns:
        What it says.

    Raises:
        LogError: it is no position servo; a gain or the rate is no number; ki is stated without kp.
    """
    said = dict(controller or {})
    mode = said.get("mode", "position")
    if mode != "position":
        raise LogError(f"mode {mode!r} is no position servo", field="controller.mode", remedy=_REMEDY)
    kp, kd, ki = (_gains(said.get(name), name, joints) for name in ("kp", "kd", "ki"))
    ki = np.nan_to_num(ki)
    if np.isnan(kp[ki != 0.0]).any():
        raise LogError(
            "an integral part without kp cannot be told from a slow effect",
            field="controller.ki",
            remedy="state controller.kp, or log tau_cmd.*",
        )
    word = str(said.get("feedforward", "")).lower()
    reference = str(said["velocity_reference"]).lower() if "velocity_reference" in said else None
    missing = [
        f"{name} of {joint}"
        for name, gains in (("kp", kp), ("kd", kd))
        for joint, gain in zip(joints, gains, strict=True)
        if np.isnan(gain)
    ]
    if word not in _WORDS:
        missing.append("the feedforward")
    return Stated(
        kp,
        kd,
        ki,
        (_WORDS[word],) if word in _WORDS else FEEDFORWARDS,
        (True, False) if reference is None else (reference not in _NO_REFERENCE,),
        tuple(missing),
        _rate(said.get("rate_hz")),
    )


def _rate(value: Any) -> float | None:
    """The servo's rate [Hz]; None where it is not stated."""
    if value is None:
        return None
    try:
        rate = float(value)
    except (TypeError, ValueError):
        rate = 0.0
    if not 0.0 < rate < np.inf:
        raise LogError(
            f"{value!r} is no rate",
            field="controller.rate_hz",
            remedy="write cycles per second, or leave it out",
        )
    return rate


def _gains(value: Any, name: str, joints: tuple[str, ...]) -> Array:
    """Gains by joint, in the order of the joints, or one for all, ``(n_joints,)``; NaN where there is none."""
    try:
        if isinstance(value, Mapping):
            return np.array([float(value.get(joint, np.nan)) for joint in joints])
        if isinstance(value, Sequence) and not isinstance(value, str) and len(value) == len(joints):
            return np.array([float(gain) for gain in value])
        return np.full(len(joints), np.nan if value is None else float(value))
    except (TypeError, ValueError) as error:
        raise LogError(
            f"{value!r} has a gain that is no number",
            field=f"controller.{name}",
            remedy="write one number, or one for each joint",
        ) from error
