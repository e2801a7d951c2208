"""What came of a recording: the log, what was guessed to make it, and what the doctor finds in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import ValidationError

from excite.conversion.columns.base_signals import base_fields
from excite.conversion.columns.families import TARGETS, columns_of
from excite.conversion.columns.scales import USUAL
from excite.conversion.columns.vocabulary import OF_WORD
from excite.conversion.columns.words import name_tokens, read_clue
from excite.conversion.explicit_mapping import SCHEMA, Map
from excite.conversion.guesses import Guesses
from excite.conversion.recording import Machine, Recording
from excite.conversion.trials import Cut
from excite.display import Row, Tabled, count
from excite.doctor.examine import Chart
from excite.errors import LogError
from excite.finding import first_names
from excite.logs.header import check_header
from excite.logs.log import Log, LogHeader

RESULT_SCHEMA = "excite.convert/1"
# Columns without a use that are named in a summary.
_SHOWN = 8


@dataclass(frozen=True, eq=False, repr=False)
class Conversion(Tabled):
    """What came of a recording.

    Attributes:
        folder: the log folder.
        log: its content as read again.
        columns: by channel, the column that it comes from and its factor to SI.
        guesses: what was guessed: channel, source, reason.
        trials: name, role and reason of each trial.
        notes: what was done to the rows, a sentence each.
        chart: what the doctor finds in it; None where it could not be examined.
        unused: columns that nothing was made of.
    """

    folder: Path
    log: Log
    columns: dict[str, tuple[str, float]]
    guesses: tuple[tuple[str, str, str], ...]
    trials: tuple[tuple[str, str, str], ...]
    notes: tuple[str, ...]
    chart: Chart | None
    unused: tuple[str, ...]

    tables = ("guessed", "trials", "columns", "findings")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.display.Tabled`: what was guessed, trials, columns, what the doctor finds."""
        if table == "guessed":
            return [{"what": w, "source": s, "because": b} for w, s, b in self.guesses]
        if table == "trials":
            return [{"trial": n, "role": r, "because": b} for n, r, b in self.trials]
        if table == "columns":
            return [{"channel": t, "column": c, "factor": f} for t, (c, f) in self.columns.items()]
        return [] if self.chart is None else self.chart.rows(table)

    def summary(self) -> str:
        """What was made of the recording, a line each."""
        trials = self.log.trials
        seconds = sum(float(trial.time[-1] - trial.time[0]) for trial in trials)
        joints = count(len(self.log.header.joints), "joint")
        lines = [f"{count(len(trials), 'trial')} of {joints}, {seconds:.0f} s"]
        lines += [f"note: {note}" for note in self.notes]
        if self.unused:
            shown = ", ".join(self.unused[:_SHOWN]) + (" …" if len(self.unused) > _SHOWN else "")
            lines.append(f"note: nothing was made of {shown}")
        if self.chart is not None:
            lines += ["", self.chart.summary(), ""]
        lines.append(
            f"wrote {self.folder}; map.yaml in it repeats this without guessing: correct it and use --map"
        )
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """The document ``excite.convert/1``."""
        return {
            "schema": RESULT_SCHEMA,
            "log": str(self.folder),
            "joints": list(self.log.header.joints),
            "columns": {target: {"column": c, "factor": f} for target, (c, f) in self.columns.items()},
            "guessed": self.rows("guessed"),
            "trials": self.rows("trials"),
            "notes": list(self.notes),
            "unused": list(self.unused),
            "findings": [] if self.chart is None else [f.to_json() for f in self.chart.findings],
        }


# The ``log.yaml`` of a conversion, with what was guessed in it.


def log_header(
    cuts: Sequence[Cut], found: Guesses, machine: Machine, stated: Map, recordings: Sequence[Recording]
) -> LogHeader:
    """Header of a converted log: from what the map states, else from what the recordings hold.

    Args:
        cuts: the trials, columns by channel in SI units.
        found: what was guessed; what is settled here is added to its facts.
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
        found.note("gains", gains=", ".join(name for name in gains if name != "mode"))
    if "modelled" not in stated.log:
        found.note("usual model", model=", ".join(content["modelled"]))
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
    if zero := [joint for joint, constant in header.torque_constants.items() if not constant]:
        raise LogError(
            f"a torque constant of 0 leaves nothing of a current: {', '.join(zero)}",
            source="map.yaml",
            field="log.torque_constants",
            remedy="write N·m per A, or list the joint under no_torque",
        )
    return header


def _torque_word(present: set[str], found: Guesses) -> str:
    channels = {name.partition(".")[0] for name in present}
    key, word = (
        ("torque of a side", "motor_side")
        if "tau" in channels
        else ("currents alone", "current")
        if "i" in channels
        else ("no loads", "none")
    )
    # Torques by a word of their names, which another one takes back: external ones, of a model, of an observer.
    said = {name: read_clue(name, ()).quantity == "skip" for name in found.unused}
    others = [name for name in said if said[name] and any(OF_WORD.get(w) == "tau" for w in name_tokens(name))]
    if word == "none" and others:
        found.note("no measured loads", columns=first_names(others, _SHOWN), column=others[0])
    else:
        found.note(key)
    return word


def _stated_gains(recordings: Sequence[Recording], joints: Sequence[str], found: Guesses) -> dict[str, Any]:
    """Gains that the recording states for every joint, in a list or by the names that it gives them."""
    said = recordings[0].said
    gains: dict[str, Any] = {}
    labels = {item.joint: item.source.partition(".")[2] for item in found.of("q_cmd")}
    for name, by_label in said.get("gains", {}).items():
        if joints and all(labels.get(joint) in by_label for joint in joints):
            gains[name] = {joint: by_label[labels[joint]] for joint in joints}
    for name in ("kp", "kd"):
        values = said.get(name)
        if isinstance(values, list) and len(values) == len(joints):
            gains[name] = {joint: float(value) for joint, value in zip(joints, values, strict=True)}
    return {"mode": "position", **gains} if gains else {}


# The ``map.yaml`` that repeats a conversion without guessing, as patterns where columns have one.


def map_text(found: Guesses, header: LogHeader, cuts: Sequence[Cut], stated: Map) -> str:
    """Text of a ``map.yaml``, a line a field."""
    joints = stated.joints or header.joints
    columns: dict[str, str] = {}
    scale: dict[str, float] = {}
    offset: dict[str, float] = {}
    for channel in dict.fromkeys(item.channel for item in found.mapped):
        items = found.of(channel)
        columns |= columns_of(channel, {item.target: item.source for item in items}, joints)
        factors = {item.factor for item in items}
        if len(factors) == 1 and factors != {1.0}:
            scale[channel] = factors.pop()
        elif len(factors) > 1:
            scale |= {item.target: item.factor for item in items}
        offset |= {item.target: item.offset for item in items if item.offset}
    names = {cut.name for cut in cuts}
    # The last part of a single recording is cut off again by itself.
    validation = [
        cut.name
        for cut in cuts
        if cut.role == "validation" and cut.name.removesuffix("_validation") not in names - {cut.name}
    ]
    rules = {"validation": validation} if validation else {}
    fields = {
        "joints": list(joints),
        "columns": columns,
        # Of these ``scale`` is one: the factors are all written there.
        "units": {
            name: USUAL[name.partition("_")[0]] for name in (*TARGETS.values(), "time") if found.of(name)
        },
        "scale": scale,
        "offset": offset,
        "motors": [list(row) for row in stated.motors],
        "ignore": list(stated.ignore),
        "trials": rules | stated.trials.model_dump(mode="json", exclude_defaults=True),
        "log": {"torque": header.torque, "modelled": list(header.modelled)} | stated.log,
    }
    style: dict[str, Any] = {"default_flow_style": True, "sort_keys": False, "allow_unicode": True}
    lines = [
        f"{name}: {yaml.safe_dump(of, width=10_000, **style).strip()}" for name, of in fields.items() if of
    ]
    return "\n".join([f"schema: {SCHEMA}", *lines]) + "\n"
