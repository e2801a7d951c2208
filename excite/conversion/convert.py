"""The verb ``convert``: any recording to a log folder, with what was guessed written into it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from excite.arrays import Array
from excite.atomic import write_text
from excite.conversion.capture_sheet import by_sheet, read_capture
from excite.conversion.columns.clock import Table, assemble_streams
from excite.conversion.explicit_mapping import Map, read_map
from excite.conversion.guess import guess_columns
from excite.conversion.guesses import Guesses, UnclearError, message
from excite.conversion.recording import Machine, Recording, at_joints, load_machine, stated_rate
from excite.conversion.recordings import read_recordings
from excite.conversion.repairs import WHOLE_TURNS, whole_rows, within_ranges
from excite.conversion.result import Conversion, log_header, map_text
from excite.conversion.shapes import in_runs
from excite.conversion.torques import (
    ask_for_legs,
    ask_for_scale,
    joint_sided,
    propose_constants,
    settle_by_torques,
    weigh_question,
    with_contacts,
)
from excite.conversion.trials import cut_trials
from excite.display import count
from excite.doctor.examine import Chart, examine
from excite.errors import InputError
from excite.formats.file import PathsLike, as_paths
from excite.logs.columns import read_columns
from excite.logs.files import check_replaceable, header_text, load_log, save_log
from excite.logs.header_blocks import Guess, TrialHeader
from excite.logs.log import Log, LogHeader, Trial
from excite.logs.robot import nominal_robot
from excite.temporary_folder import TemporaryFolder

_UNSEEN = "the doctor could not look at it"


def convert(
    sources: PathsLike,
    robot: str | Path,
    out: str | Path,
    mapping: Map | str | Path | None = None,
    capture: str | Path | None = None,
) -> Conversion:
    """Make a log folder of recordings in any known format.

    What the columns mean is taken from the map, then from their names, then from physics; each guess is written into
    ``log.yaml`` with its reason, and the map that repeats the conversion without guessing as ``map.yaml`` beside it.

    Args:
        sources: a file or folder, or several; a folder of no known format stands for the files in it.
        robot: bundled name, ``robot.yaml``, or URDF.
        out: the log folder, replaced if there is one.
        mapping: what the recording does not tell, or a ``map.yaml`` that says it.
        capture: sheet of ``excite capture`` that the recordings were made by: roles and repeats are its, and what
            differs from it is noted.

    Returns:
        The log folder, and what was guessed to make it.

    Raises:
        UnclearError: something cannot be told; it carries all questions with the lines that would settle them.
        LogError: a source is of no known format, damaged, or does not fit the robot.
    """
    stated = mapping if isinstance(mapping, Map) else (Map() if mapping is None else read_map(Path(mapping)))
    return _convert_recordings(as_paths(sources), robot, Path(out), stated, capture)


def _convert_recordings(
    sources: Sequence[str | Path],
    robot: str | Path,
    out: Path,
    stated: Map,
    capture: str | Path | None,
    *,
    weighs: bool = False,
    because: str = "",
) -> Conversion:
    """As :func:`convert`; where a unit is weighed, torques of any scale are taken.

    ``because`` is what says the units of positions that the map states, where no person did.
    """
    check_replaceable(out)
    machine = load_machine(robot)
    recordings = read_recordings(sources)
    if recordings[0].said.get("linkages") == "joints":
        machine = at_joints(machine)
    found = guess_columns(recordings[0], machine, stated, because)
    if found.questions:
        folder = TemporaryFolder()

        def tried(mapping: Map) -> Conversion:
            return _convert_recordings(sources, robot, folder.path / "log", mapping, None, weighs=True)

        settled = None if weighs else settle_by_torques(found.questions, tried, stated)
        if settled is not None:
            return _convert_recordings(sources, robot, out, settled.mapping, capture, because=settled.because)
        raise UnclearError(weigh_question(found.questions, tried, stated), recordings[0].source)
    sheet = None if capture is None else read_capture(Path(capture))
    # A long recording is not held as read, as joined and as written at once.
    tables: list[Table] = []
    for k in range(len(recordings)):
        tables += _build_tables(recordings[k], found, machine, stated)
        recordings[k] = replace(recordings[k], streams=())
    compared: list[str] = []
    if sheet is None:
        cuts = list(cut_trials(tables, stated.trials))
    else:
        of_sheet, differs = by_sheet(tables, stated.trials, sheet)
        cuts, compared = list(of_sheet), differs or ["as the capture sheet asks"]
    tables = [replace(table, columns={}) for table in tables]
    trials = tuple((cut.name, cut.role, cut.because) for cut in cuts)
    header = log_header(cuts, found, machine, stated, recordings)
    if not weighs:
        ask_for_scale(cuts, header, machine, found, stated, recordings[0])
    text = map_text(found, header, cuts, stated)
    # What is cut is not held as read and as written at once.
    written = [_read_cut(cuts.pop(0).columns, entry, header, machine, out) for entry in header.trials]
    log = Log(header=header, trials=tuple(written), robot_text=machine.text)
    if machine.robot is not None and not weighs:
        ask_for_legs(log, machine.robot, found, recordings[0])
    save_log(log, out)
    (out / "map.yaml").write_text(text, encoding="utf-8")
    read = load_log(out)
    chart, note = _examine_log(read, machine)
    read = _with_findings(read, chart, note, out)
    notes = [n for r in recordings for n in r.notes] + [n for t in tables[:1] for n in t.notes] + note
    notes += _note_losses(found, machine, read)
    notes += [n for t in tables[1:] for n in t.notes if n.startswith(WHOLE_TURNS)] + compared
    return Conversion(
        folder=out,
        log=read,
        columns={item.target: (item.source, item.factor) for item in found.mapped},
        guesses=tuple(found.rows()),
        trials=trials,
        notes=tuple(dict.fromkeys(notes)),
        chart=chart,
        unused=tuple(found.unused),
    )


def _read_cut(
    columns: dict[str, Array], entry: TrialHeader, header: LogHeader, machine: Machine, out: Path
) -> Trial:
    """The trial of these columns; torques tell which feet carry where no flags were recorded."""
    flags = [f"contact.{foot.name}" for foot in header.feet]
    told = set(flags) <= set(columns) or not header.uses_imu or machine.robot is None
    carried = {} if told else dict.fromkeys(flags, np.ones(len(columns["time"])))
    trial = read_columns(columns | carried, entry, header, out / entry.file)
    if told or trial.tau is None or machine.robot is None:
        return trial
    return with_contacts(trial, trial.tau, header, machine.robot)


def _note_losses(found: Guesses, machine: Machine, log: Log) -> list[str]:
    """What the log lacks of the recording: joints that are held, torques, columns that no channel was made of."""
    locked = () if machine.robot is None else machine.robot.description.locked_joints
    held = [joint for joint in locked if any(joint in column for column in found.unused)]
    channel, without = "i" if log.header.torque == "current" else "tau", log.header.no_torque
    notes = [message("held though recorded", "note", joints=", ".join(held))] if held else []
    if without:
        # Without those a robot's heaviest joint may be missing unnoticed.
        notes.append(
            message("no torque", "note", joints=", ".join(without), target=f"{channel}.{without[0]}")
        )
    if found.lost:
        number, are = count(len(found.lost), "column"), "is" if len(found.lost) == 1 else "are"
        notes.append(
            message(
                "lost", "note", count=number, are=are, columns=", ".join(found.lost), column=found.lost[0]
            )
        )
    return notes


def _build_tables(recording: Recording, found: Guesses, machine: Machine, stated: Map) -> list[Table]:
    """The recording's rows, a table for each run of its clock."""
    rate = stated.rate_hz or stated_rate(recording.said)
    joints = stated.joints or machine.joints
    runs = in_runs(assemble_streams(recording, found, rate))
    rows = (whole_rows(joint_sided(run, stated, joints, recording.source), recording.source) for run in runs)
    return [within_ranges(table, machine, stated.offset) for table in rows]


def _with_findings(log: Log, chart: Chart | None, notes: Sequence[str], folder: Path) -> Log:
    """The log with what the doctor says of it in its header, on disk too: nobody who opens it has to ask again."""
    found = [] if chart is None else [f for f in chart.findings if f.repaired or f.severity != "note"]
    rows = [
        Guess(
            what=f"{f.kind} ({f.where})",
            source="the doctor",
            because=f"{f.text}; {f.remedy}" if f.remedy else f.text,
        )
        for f in found
    ]
    rows += [
        Guess(what="torque constants", source="the nominal masses", because=note)
        for note in notes
        if not note.startswith(_UNSEEN)
    ]
    if not rows:
        return log
    header = log.header.model_copy(update={"guessed": (*log.header.guessed, *rows)})
    write_text(folder / "log.yaml", header_text(header))
    return replace(log, header=header)


def _examine_log(log: Log, machine: Machine) -> tuple[Chart | None, list[str]]:
    """What the doctor says; a log that it cannot look at is written all the same."""
    try:
        robot = nominal_robot(log)
        chart = examine(robot, log)
        # Positions in another unit would look like torques in one.
        turned = any(f.kind in ("degrees", "revolutions") and f.repaired for f in chart.findings)
        return chart, propose_constants(robot, chart.log if turned else log)
    except InputError as error:
        return None, [f"{_UNSEEN}: {error}"]
    except ValidationError:
        return None, [f"{_UNSEEN}: a base that moves needs contact wrenches (sensors in map.yaml)"]
