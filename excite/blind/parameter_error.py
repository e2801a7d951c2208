"""How far a stated parameter is from the hidden one, for effects whose size is one number."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from excite.blind.arm import N_TRIALS, N_VALIDATION, PAUSE_S, TRIAL_S
from excite.blind.hidden import HiddenEffect

_SESSION_S = (N_TRIALS + N_VALIDATION + 1) * (TRIAL_S + PAUSE_S) - PAUSE_S

_ONE_NUMBER = {
    "viscous_friction": "coefficient",
    "coulomb_friction": "level",
    "torque_bias": "bias",
    "coulomb_asymmetry": "bias",
    "stribeck": "excess",
    "load_dependent_friction": "coefficient",
    "armature": "inertia",
    "backlash": "width",
    "joint_elasticity": "stiffness",
    "joint_spring": "stiffness",
    "torque_gain": "gain",
    "encoder_offset": "offset",
    "time_delay": "delay",
    "payload": "mass",
    "base_tilt": "angle",
}


def parameter_error(hidden: HiddenEffect, said: Mapping[str, Any]) -> float | None:
    """Relative error of an effect's main parameter.

    Args:
        hidden: the hidden effect.
        said: an effect of the same name in a diagnosis (``excite.diagnosis/1``).

    Returns:
        The error relative to the hidden value; None where the hidden size is no single number, or the form of the
        effect has parameters that the textbook's has not.
    """
    parameters = said.get("parameters", {}).items()
    values = {name: item["value"] for name, item in parameters if item["value"] is not None}
    compared = _COMPARED.get(hidden.effect)
    pair = None if compared is None else compared(hidden, values)
    if pair is None or pair[1] is None or not pair[0]:
        return None
    return abs(pair[1] - pair[0]) / abs(pair[0])


_Pair = tuple[float, float | None]


def _plain_pair(hidden: HiddenEffect, values: Mapping[str, float]) -> _Pair | None:
    # A spring or a gear that hardens has another stiffness at every stretch.
    if hidden.form in {"hardening", "rubbing"}:
        return None
    return hidden.value, values.get(_ONE_NUMBER[hidden.effect])


def _drift_pair(hidden: HiddenEffect, values: Mapping[str, float]) -> _Pair | None:
    """What has changed at the session's end; heat that the joint makes itself is not known from the answer."""
    if hidden.form != "plain" or not hidden.details.get("time_constant"):
        return None
    grown = -math.expm1(-_SESSION_S / hidden.details["time_constant"])
    return hidden.value * grown, values.get("relative_change")


def _lag_pair(hidden: HiddenEffect, values: Mapping[str, float]) -> _Pair:
    """Two equal lags in series have twice the time constant of either."""
    return hidden.value * (2.0 if hidden.form == "second_order" else 1.0), values.get("time_constant")


def _ripple_pair(hidden: HiddenEffect, values: Mapping[str, float]) -> _Pair | None:
    if hidden.form != "plain" or not {"cosine", "sine"} <= set(values):
        return None
    return hidden.value, math.hypot(values["cosine"], values["sine"])


def _length_pair(hidden: HiddenEffect, values: Mapping[str, float]) -> _Pair | None:
    shift = [values[name] for name in ("shift_x", "shift_y", "shift_z") if name in values]
    return (hidden.value, math.hypot(*shift)) if len(shift) == 3 else None


_COMPARED: dict[str, Callable[[HiddenEffect, Mapping[str, float]], _Pair | None]] = {
    **dict.fromkeys(_ONE_NUMBER, _plain_pair),
    "friction_drift": _drift_pair,
    "actuator_lag": _lag_pair,
    "torque_ripple": _ripple_pair,
    "link_length_error": _length_pair,
}
