"""The ``log.yaml`` of a conversion, with what was guessed in it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from excite.conversion.base import base_fields
from excite.conversion.guesses import Guesses
from excite.conversion.machine import Machine
from excite.conversion.mapping import Map
from excite.conversion.recording import Recording
from excite.conversion.trials import Cut
from excite.errors import LogError
from excite.logs.header import check_header
from excite.logs.log import LogHeader


def log_header(
    cuts: Sequence[Cut], found: Guesses, machine: Machine, stated: Map, recordings: Sequence[Recording]
) -> LogHeader:
    """Header of a converted log: from what the map states, else from what the recordings hold.

    Args:
        cuts: the trials, columns by channel in SI units.
        found: what was guessed; what is settled here is added to its facts.
        machine: the robot.
        stated: the map, whose ``log`` entries hold.
        recordings: what the trials are cut from.

    Raises:
        LogError: what the map states makes no header of a log.
    """
    present = {name for cut in cuts for name in cut.columns}
    joints = [joint for joint in machine.joints if f"q.{joint}" in present]
    torque = str(stated.log.get("torque") or _torque_word(present, found))
    channel = "i" if torque == "current" else "tau"
    without = [joint for joint in joints if f"{channel}.{joint}" not in present] if torque != "none" else []
    steps = np.concatenate([np.diff(cut.columns["time"]) for cut in cuts])
    rate = 1.0 / float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 1.0
    content: dict[str, Any] = {
        "schema": "excite.log/1",
        "robot": machine.file,
        "base": "fixed",
        "gravity": list(machine.gravity),
        "rate_hz": float(f"{rate:.5g}"),
        "joints": joints,
        "torque": torque,
        "no_torque": without,
        "modelled": ["rigid_body", "viscous_friction", "coulomb_friction"]
        + (["armature"] if torque != "link_side" else []),
    }
    content |= base_fields(present, found, machine, stated.log)
    gains = _stated_gains(recordings, joints, found)
    if gains:
        content["controller"] = gains
        found.facts.append(
            ("controller", ", ".join(name for name in gains if name != "mode"), "the recording states them")
        )
    if "modelled" not in stated.log:
        usual = "what joints of this kind have at least"
        found.facts.append(("modelled", ", ".join(content["modelled"]), usual))
    content |= stated.log
    if torque == "none":
        content.pop("no_torque", None)
    content["guessed"] = [
        {"what": what, "source": source, "because": because} for what, source, because in found.rows()
    ]
    content["trials"] = [
        {"file": f"{cut.name}.parquet", "role": cut.role}
        | ({"repeats": f"{cut.repeats}.parquet"} if cut.repeats else {})
        for cut in cuts
    ]
    try:
        header = LogHeader.model_validate(content)
    except ValidationError as error:
        faults = [f"{'.'.join(str(p) for p in e['loc'])} ({e['msg'].lower()})" for e in error.errors()]
        raise LogError(
            "cannot be written: " + "; ".join(faults[:10]), field="log", remedy="correct log: in map.yaml"
        ) from error
    check_header(header, Path("map.yaml"))
    return header


def _torque_word(present: set[str], found: Guesses) -> str:
    if any(name.startswith("tau.") for name in present):
        found.facts.append(
            (
                "torque",
                "motor_side",
                "torques of unknown side are taken to contain the joint's friction and rotor",
            )
        )
        return "motor_side"
    if any(name.startswith("i.") for name in present):
        found.facts.append(("torque", "current", "currents, and no torques, were recorded"))
        return "current"
    found.facts.append(("torque", "none", "neither torques nor currents were recorded"))
    return "none"


def _stated_gains(recordings: Sequence[Recording], joints: Sequence[str], found: Guesses) -> dict[str, Any]:
    """Gains that the recording states for every joint, in a list or by the names that it gives them."""
    said = recordings[0].said
    gains: dict[str, Any] = {}
    labels = {item.target.partition(".")[2]: item.source.partition(".")[2] for item in found.of("q_cmd")}
    for name, by_label in said.get("gains", {}).items():
        if joints and all(labels.get(joint) in by_label for joint in joints):
            gains[name] = {joint: by_label[labels[joint]] for joint in joints}
    for name in ("kp", "kd"):
        values = said.get(name)
        if isinstance(values, list) and len(values) == len(joints):
            gains[name] = {joint: float(value) for joint, value in zip(joints, values, strict=True)}
    return {"mode": "position", **gains} if gains else {}
