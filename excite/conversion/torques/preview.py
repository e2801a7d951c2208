"""Whether a recording's torques can be newton metres at all, asked before anything is written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError

from excite.conversion.guesses import Guesses, Question, UnclearError
from excite.conversion.machine import Machine
from excite.conversion.mapping import Map
from excite.conversion.recording import Recording
from excite.conversion.torques.scales import unknown_scale
from excite.conversion.trials import Cut
from excite.errors import InputError
from excite.logs.columns import read_columns
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, LogHeader
from excite.logs.robot import nominal_robot
from excite.temporary_folder import TemporaryFolder

# Two minutes at 1 kHz tell a scale, and are held beside the recording.
_MOST_ROWS = 120_000


def ask_for_scale(
    cuts: Sequence[Cut],
    header: LogHeader,
    machine: Machine,
    found: Guesses,
    stated: Map,
    recording: Recording,
) -> None:
    """Raise UnclearError where torques of no stated unit look like shares of limits, or currents, by the nominal model.

    Nothing is asked where a name, the format or the map states the torques' unit or scale.

    Args:
        cuts: the trials.
        header: header of the log that is to be written.
        machine: the robot.
        found: how the columns were understood.
        stated: the map.
        recording: the first of the recordings.
    """
    torques = found.of("tau")
    known = any(key.partition(".")[0] == "tau" for key in (*stated.units, *stated.scale))
    if not torques or known or "torque" in stated.log or any(item.unit for item in torques):
        return
    looks = _looked_at(cuts, header, machine)
    if looks is None:
        return
    cause, scale = looks
    joint = torques[0].target.partition(".")[2]
    line = f"scale: {scale}   # N·m per unit by the nominal model; or units: {{tau: N·m}} if they are N·m after all"
    what = f"{torques[0].source} … are no newton metres of the nominal masses ({joint} and others): {cause}"
    raise UnclearError([Question(what, line)], recording.source)


def _looked_at(cuts: Sequence[Cut], header: LogHeader, machine: Machine) -> tuple[str, str] | None:
    """What the first rows of the longest motion that is for identification say of the scale."""
    pairs = [
        (cut, entry) for cut, entry in zip(cuts, header.trials, strict=True) if entry.role == "identification"
    ]
    if not pairs or header.base not in ("fixed", "held"):
        return None
    cut, entry = max(pairs, key=lambda pair: len(pair[0].columns["time"]))
    columns = {name: values[:_MOST_ROWS] for name, values in cut.columns.items()}
    entry = entry.model_copy(update={"repeats": None})
    alone = header.model_copy(update={"trials": (entry,)})
    try:
        folder = TemporaryFolder()
        trial = read_columns(columns, entry, alone, Path(entry.file))
        save_log(Log(header=alone, trials=(trial,), robot_text=machine.text), folder.path / "log")
        log = load_log(folder.path / "log")
        return unknown_scale(nominal_robot(log), log)
    except (InputError, ValidationError):
        return None
