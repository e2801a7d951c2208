"""What the columns of a recording are: what a map states, then what names say, then what physics allows."""

from __future__ import annotations

from collections.abc import Container, Sequence

import numpy as np

from excite.conversion.base import add_base, feet_of
from excite.conversion.columns.anonymous import Understood, understand_columns
from excite.conversion.columns.axes import axes_as_positions
from excite.conversion.columns.base_signals import add_base_signals
from excite.conversion.columns.choice import choose_families, settle_unmeasured
from excite.conversion.columns.clock import TICKS, clock_column, clock_pace, goes_evenly, rate_by_velocities
from excite.conversion.columns.commands import is_followed, settle_commands
from excite.conversion.columns.contact_forces import without_contact_forces
from excite.conversion.columns.families import (
    Family,
    clues_of,
    find_families,
    is_anonymous,
    with_numbers_for_letters,
)
from excite.conversion.columns.free_base import without_base
from excite.conversion.columns.quantities import convert_units
from excite.conversion.columns.unfilled import live_columns, without_unfilled
from excite.conversion.columns.words import Clue, is_of_joints
from excite.conversion.guesses import RATE_LINE, Guesses, Mapped
from excite.conversion.machine import Machine
from excite.conversion.mapping import Map
from excite.conversion.questions import (
    ask_for_base,
    ask_for_joints,
    ask_for_nameless_torques,
    ask_for_positions,
    ask_for_surplus,
    ask_for_torques,
    ask_for_torques_of_no_joint,
    column_names,
    note_joints_without_position,
    note_order_of_legs,
    note_other_names,
    torques_of_no_joint,
)
from excite.conversion.recording import Recording, Stream, stated_rate
from excite.conversion.stated import (
    add_stated,
    ask_for_stated_positions,
    of_single_joints,
    with_stated_labels,
    without_stated,
)
from excite.conversion.torques.controller import note_controllers_constants

# Of columns without names, those that hold numbers in this share of the rows, where this many rows are whole.
_THERE, _FEWEST = 0.5, 20
# Columns without names are told apart at this rate where none is known.
_ANY_RATE = 100.0


def guess_columns(recording: Recording, machine: Machine, mapping: Map, because: str = "") -> Guesses:
    """Understand a recording's columns.

    Args:
        recording: what was read.
        machine: the robot.
        mapping: what a person said; an empty one if nothing.
        because: what says the units of positions in it, where that is no person.

    Returns:
        Channels with their factors and reasons, and the questions that stay.
    """
    found = Guesses(stated_because=because) if because else Guesses()
    joints = mapping.joints or machine.joints
    wrong = [joint for joint in joints if joint not in machine.joints]
    if wrong:
        found.ask(f"the robot has no joint {', '.join(wrong)}", f"joints: [{', '.join(machine.joints)}]")
        return found
    recording = with_numbers_for_letters(recording)
    ignored = [column for column in column_names(recording) if mapping.ignores(column)]
    clues = clues_of(recording, joints, ignored)
    add_stated(found, recording, mapping, joints)
    clues = with_stated_labels(found, clues)
    clocks = _find_clocks(found, recording, clues, mapping)
    taken = {item.source for item in found.mapped} | set(clocks)
    if machine.floating:
        unknown = [name for name in clues if name not in taken]
        add_base_signals(found, recording, unknown, feet_of(found, machine, mapping))
        taken |= {item.source for item in found.mapped}
    left = {name: said for name, said in clues.items() if name not in taken}
    single = of_single_joints(found, clues, mapping, joints)
    left |= single
    known = {item.channel for item in found.mapped if item.source not in single}
    groups = [family for family in find_families(recording, left, joints) if family.target not in known]
    groups = [family for family in groups if not is_anonymous(family, joints)]
    groups = without_stated(found, groups, clues)
    groups = axes_as_positions(found, groups, left, known)
    groups = without_contact_forces(found, without_unfilled(found, groups, recording), machine)
    if machine.floating:
        groups = without_base(found, groups, recording, joints)
    chosen = choose_families(groups, found, recording, joints)
    nameless: dict[str, Family] = {}
    if "q" not in known | set(chosen):
        named = {column for family in chosen.values() for column in family.columns}
        named |= {
            column
            for column, said in left.items()
            if said.commanded or said.quantity in ("volt", "time", "skip")
        }
        nameless = _without_names(found, recording, machine, joints, {c for c in left if c not in named})
        if (
            "q_cmd" in chosen
            and "q" in nameless
            and not is_followed(chosen["q_cmd"], nameless["q"], recording)
        ):
            nameless = {}
        chosen |= {target: family for target, family in nameless.items() if target not in chosen}
    unplaced = torques_of_no_joint(groups, chosen, recording)
    settle_unmeasured(found, chosen, joints, unplaced)
    settle_commands(found, chosen, recording, joints)
    ask_for_surplus(found, chosen, joints)
    ask_for_joints(found, chosen, groups)
    note_other_names(found, {target: family for target, family in chosen.items() if target not in nameless})
    note_order_of_legs(found, chosen, joints, mapping)
    note_controllers_constants(found, chosen, groups, recording)
    _add_channels(found, chosen, nameless)
    _propose_rate(found, recording)
    ask_for_nameless_torques(found, nameless, recording, mapping)
    add_base(found, recording, left, machine, mapping)
    _ask_for_doubts(found, recording, machine)
    ask_for_positions(found, recording, machine)
    ask_for_stated_positions(found, clues, joints)
    ask_for_torques(found, groups, recording, mapping)
    ask_for_torques_of_no_joint(found, unplaced, left, joints, recording, mapping)
    ask_for_base(found, recording, machine, mapping)
    if found.of("q") and not found.questions:
        found.mapped = convert_units(found, recording, machine, mapping)
    note_joints_without_position(found, joints)
    used = {item.source for item in found.mapped} | set(clocks)
    found.unused = [name for name in column_names(recording) if name not in used]
    live = live_columns(recording)
    found.lost = [
        name for name in found.unused if name in live and name in clues and is_of_joints(clues[name])
    ]
    return found


def _find_clocks(
    found: Guesses, recording: Recording, clues: dict[str, Clue], mapping: Map
) -> dict[str, Stream]:
    """A time for every stream; streams that have a time of their own need none."""
    clocks: dict[str, Stream] = {}
    stated = {item.source for item in found.mapped if item.target == "time"}
    for stream in recording.streams:
        here = next((column for column in stream.columns if column.name in stated), None)
        if here is None and stream.time is not None:
            continue
        name, because = (here.name, "stated in the map") if here else (None, "")
        if name is None:
            known = {c.name: clues[c.name] for c in stream.columns if c.name in clues}
            seen = Stream(stream.name, tuple(c for c in stream.columns if c.name in known))
            column = clock_column(seen, known)
            name, because = column if column else (None, "")
        if name is None:
            _without_clock(found, recording, stream, mapping, clues)
            continue
        values = next(c.values for c in stream.columns if c.name == name)
        unit = mapping.units.get("time", "") or (clues[name].unit if name in clues else "")
        by_map = mapping.units.get("time")
        paced = clock_pace(values, unit, stated_rate(recording.said))
        seconds, why = (TICKS[unit], "stated in the map") if by_map else paced
        scale = mapping.scale.get("time", 1.0)
        if seconds is None and scale == 1.0:
            found.ask(f"the unit of the clock {name} cannot be told ({why})", "units: {time: ms}")
        seconds = scale * (1.0 if seconds is None else seconds)
        why += f", times {scale:.6g} as the map says" if scale != 1.0 else ""
        if here is not None:
            found.mapped = [item for item in found.mapped if item.source != name]
        found.mapped.append(Mapped("time", name, seconds, f"{because}; {why}", stated=here is not None))
        clocks[name] = stream
    return clocks


def _without_clock(
    found: Guesses, recording: Recording, stream: Stream, mapping: Map, clues: dict[str, Clue]
) -> None:
    stated = mapping.rate_hz
    rate = stated or stated_rate(recording.said)
    if rate:
        found.rate_hz = float(rate)
        why = (
            "no column holds a time"
            if stated
            else "no column holds a time, and the recording states its rate"
        )
        fact = ("time", f"rows at {float(rate):g} Hz", why)
        found.facts += [] if fact in found.facts else [fact]
    else:
        named = [c.name for c in stream.columns if c.name in clues and clues[c.name].quantity == "time"]
        but = f" ({named[0]} does not go forward evenly)" if named else ""
        found.ask_of_all(stream.name, f"no column of times{but}", RATE_LINE)


def _propose_rate(found: Guesses, recording: Recording) -> None:
    """The rate that velocities tell, where a rate has to be asked for."""
    at = next((k for k, question in enumerate(found.questions) if question.line == RATE_LINE), None)
    values = {column.name: column.values for stream in recording.streams for column in stream.columns}
    speeds = {item.target[2:]: values[item.source] for item in found.of("v")}
    pairs = [
        (values[item.source], speeds[item.target[2:]])
        for item in found.of("q")
        if item.target[2:] in speeds and len(values[item.source]) == len(speeds[item.target[2:]])
    ]
    if at is None or not pairs:
        return
    q, v = (np.column_stack(side) for side in zip(*pairs, strict=True))
    whole = np.isfinite(q).all(axis=1) & np.isfinite(v).all(axis=1)
    rate = rate_by_velocities(q[whole], v[whole])
    if rate is not None:
        found.questions[at] = found.questions[at].with_rate(float(f"{rate:.3g}"), ", as the velocities say")


def _add_channels(found: Guesses, chosen: dict[str, Family], nameless: Container[str]) -> None:
    joints = set(chosen["q"].placed.columns) if "q" in chosen else {i.target[2:] for i in found.of("q")}
    known = {item.target for item in found.mapped}
    for target, family in chosen.items():
        columns = {joint: column for joint, column in family.placed.columns.items() if joint in joints}
        partial = target not in ("q", "tau", "i") and set(columns) != joints
        if partial or not columns:
            if columns:
                found.facts.append((target, family.columns[0], "left out: not of every joint"))
            continue
        said = "the format says so" if family.stated else "its values" if target in nameless else "its name"
        because = f"{said}; joint by {family.placed.because}"
        found.mapped += [
            Mapped(f"{target}.{joint}", column, 1.0, because)
            for joint, column in columns.items()
            if f"{target}.{joint}" not in known
        ]


def _without_names(
    found: Guesses, recording: Recording, machine: Machine, joints: Sequence[str], unknown: set[str]
) -> dict[str, Family]:
    """Channels by physics alone, for columns whose names say nothing."""
    stream = max(recording.streams, key=lambda s: sum(c.name in unknown for c in s.columns))
    columns = [c for c in stream.columns if c.name in unknown and np.isfinite(c.values).mean() > _THERE]
    # Second clocks and counters of rows are smoother than any joint.
    columns = [c for c in columns if not goes_evenly(c.values)]
    stamps = found.times(stream)
    time = np.arange(stream.n_rows) / _ANY_RATE if stamps is None else stamps
    if len(columns) < len(joints):
        return {}
    values = np.column_stack([column.values for column in columns])
    whole = np.isfinite(values).all(axis=1) & np.isfinite(time)
    if whole.sum() < _FEWEST:
        return {}
    understood: Understood | None = understand_columns(
        values[whole], time[whole], machine, tuple(joints), [column.name for column in columns]
    )
    # How smooth columns are says little where nobody knows for how long.
    if understood is None or (stamps is None and "v" not in understood.channels):
        return {}
    return understood.families([column.name for column in columns])


def _ask_for_doubts(found: Guesses, recording: Recording, machine: Machine) -> None:
    """What the format says of columns that do not hold what their place says, unless a map states them or the robot has
    such motors."""
    guessed = {
        item.source
        for item in found.mapped
        if not item.stated and item.target.partition(".")[2] not in machine.motors
    }
    for doubt in recording.said.get("doubts", ()):
        if guessed & set(doubt.columns):
            found.ask(doubt.what, doubt.line)
