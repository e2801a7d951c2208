"""Torque constants as a controller has them: the torques and the currents that it asks for, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.families import Family
from excite.conversion.guesses import Guesses
from excite.conversion.recording import Recording

# What is asked of a motor is a joint's torque and its friction. In six runs of a UR10e, whose constants nobody has
# published, joints that these explain so well have slopes that agree from run to run within 3 % (12.0, 9.8 and
# 10.6 N·m/A); those of the others, which hardly carry anything, are anything from 5 to 12.
_EXPLAINED = 0.98
# Velocity over which friction changes sign, as share of the joint's fastest.
_WIDTH = 0.02


def note_controllers_constants(
    found: Guesses, chosen: Mapping[str, Family], groups: Sequence[Family], recording: Recording
) -> None:
    """Say what N·m per A the controller itself reckons with, where a recording of currents has its targets of both.

    ``target_moment`` and ``target_current`` of Universal Robots are such: torque = constant × current − friction.
    """
    torque, speed = chosen.get("tau_cmd"), chosen.get("v")
    asked = next((one for one in groups if one.quantity == "i" and not one.target), None)
    if asked is None or torque is None or speed is None or "i" not in chosen or "tau" in chosen:
        return
    columns = {c.name: c.values for stream in recording.streams for c in stream.columns}
    constants = {}
    for joint, name in asked.placed.columns.items():
        if joint in torque.placed.columns and joint in speed.placed.columns:
            parts = (columns[family.placed.columns[joint]] for family in (torque, speed))
            constant = _constant(columns[name], *parts)
            if constant is not None:
                constants[joint] = constant
    if constants:
        said = ", ".join(f"{joint}: {constant:.3g}" for joint, constant in constants.items())
        found.facts.append(
            (
                "N·m per A",
                f"{torque.columns[0]} … over {asked.columns[0]} …",
                f"so the controller reckons: {{{said}}}; log: {{torque_constants: …}} in map.yaml takes them, with "
                "those of the other joints from data sheets",
            )
        )


def _constant(current: Array, torque: Array, speed: Array) -> float | None:
    """Slope of the torque over the current beside friction; None where they do not follow each other closely."""
    if not len(current) == len(torque) == len(speed):
        return None
    whole = np.isfinite(current) & np.isfinite(torque) & np.isfinite(speed)
    fastest = float(np.abs(speed[whole]).max(initial=0.0))
    if whole.sum() < 20 or fastest == 0.0 or torque[whole].std() == 0.0 or current[whole].std() == 0.0:
        return None
    v = speed[whole]
    rows = np.column_stack([current[whole], np.ones(len(v)), np.tanh(v / (_WIDTH * fastest)), v])
    answer = np.linalg.lstsq(rows, torque[whole], rcond=None)[0]
    left = torque[whole] - rows @ answer
    explained = 1.0 - float(left.var() / torque[whole].var())
    return abs(float(answer[0])) if explained > _EXPLAINED else None
