"""What the columns of a recording are: what a map states, then what names say, then what physics allows."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.base_signals import add_base, add_base_signals, feet_of
from excite.conversion.columns.choice import (
    Understood,
    choose_families,
    settle_unmeasured,
    understand_columns,
)
from excite.conversion.columns.clock import clock_column, clock_pace, goes_evenly, rate_by_velocities
from excite.conversion.columns.families import (
    TARGETS,
    Family,
    clues_of,
    columns_line,
    find_families,
    is_anonymous,
    with_numbers_for_letters,
    without_base,
)
from excite.conversion.columns.scales import convert_units
from excite.conversion.columns.vocabulary import FORCES, OF_WORD
from excite.conversion.columns.words import Clue, is_of_joints
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import RATE_LINE, Guesses, Mapped
from excite.conversion.questions import (
    MOST_NAMED,
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
from excite.conversion.recording import Machine, Recording, Stream, live_columns, stated_rate
from excite.conversion.torques import note_controllers_constants
from excite.finding import first_names
from excite.logs.units import TICKS

# Of columns without names, those that hold numbers in this share of the rows, where this many rows are whole.
_THERE, _FEWEST = 0.5, 20
# Columns without names are told apart at this rate where none is known.
_ANY_RATE = 100.0


@dataclass(eq=False)
class Guessing:
    """What is known of a recording's columns while rules go over it.

    Attributes:
        found: the guesses so far.
        recording: what was read.
        machine: the robot.
        mapping: what a person said.
        joints: of the robot, in the order in which columns are counted.
        clues: what every column's name or format says.
        clocks: streams by the column of their times.
        left: clues of the columns that nothing is made of yet.
        known: channels that are settled.
        groups: families of the columns that are left.
        chosen: the family of each channel.
        nameless: those of them that physics alone told.
        unplaced: columns of torques of which it is not known whose they are.
    """

    found: Guesses
    recording: Recording
    machine: Machine
    mapping: Map
    joints: Sequence[str]
    clues: dict[str, Clue] = field(default_factory=dict)
    clocks: dict[str, Stream] = field(default_factory=dict)
    left: dict[str, Clue] = field(default_factory=dict)
    known: set[str] = field(default_factory=set)
    groups: list[Family] = field(default_factory=list)
    chosen: dict[str, Family] = field(default_factory=dict)
    nameless: dict[str, Family] = field(default_factory=dict)
    unplaced: list[str] = field(default_factory=list)


class Rule(NamedTuple):
    """One step from columns to channels.

    Attributes:
        name: of the rule.
        finds: what it finds, and what it changes, in words.
        change: what changes the state; a rule that finds nothing leaves it as it is.
        applies: whether there is anything to find.
    """

    name: str
    finds: str
    change: Callable[[Guessing], None]
    applies: Callable[[Guessing], bool] = lambda _: True


def guess_columns(recording: Recording, machine: Machine, mapping: Map, because: str = "") -> Guesses:
    """Understand a recording's columns: the rules of :data:`RULES`, one after the other.

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
    state = Guessing(found, with_numbers_for_letters(recording), machine, mapping, joints)
    for rule in RULES:
        if rule.applies(state):
            rule.change(state)
    return found


def _read_names(state: Guessing) -> None:
    names = column_names(state.recording)
    ignored = [column for column in names if state.mapping.ignores(column)]
    state.clues = clues_of(state.recording, state.joints, ignored)


def _take_base(state: Guessing) -> None:
    taken = {item.source for item in state.found.mapped} | set(state.clocks)
    unknown = [name for name in state.clues if name not in taken]
    add_base_signals(
        state.found, state.recording, unknown, feet_of(state.found, state.machine, state.mapping)
    )


def _group_by_quantity(state: Guessing) -> None:
    taken = {item.source for item in state.found.mapped} | set(state.clocks)
    state.left = {name: said for name, said in state.clues.items() if name not in taken}
    single = of_single_joints(state.found, state.clues, state.mapping, state.joints)
    state.left |= single
    state.known = {item.channel for item in state.found.mapped if item.source not in single}
    state.groups = [
        family
        for family in find_families(state.recording, state.left, state.joints)
        if family.target not in state.known and not is_anonymous(family, state.joints)
    ]


def _leave_base(state: Guessing) -> None:
    state.groups = without_base(state.found, state.groups, state.recording, state.joints)


def _choose(state: Guessing) -> None:
    state.chosen = choose_families(state.groups, state.found, state.recording, state.joints)


def _tell_by_physics(state: Guessing) -> None:
    chosen, left = state.chosen, state.left
    named = {column for family in chosen.values() for column in family.columns}
    named |= {
        column for column, said in left.items() if said.commanded or said.quantity in ("volt", "time", "skip")
    }
    unknown = {column for column in left if column not in named}
    nameless = _without_names(state.found, state.recording, state.machine, state.joints, unknown)
    commanded, positions = chosen.get("q_cmd"), nameless.get("q")
    if commanded and positions and not is_followed(commanded, positions, state.recording):
        return
    state.nameless = nameless
    state.chosen |= {target: family for target, family in nameless.items() if target not in chosen}


def _settle_torques(state: Guessing) -> None:
    state.unplaced = torques_of_no_joint(state.groups, state.chosen, state.recording)
    settle_unmeasured(state.found, state.chosen, state.joints, state.unplaced)


def _note_choice(state: Guessing) -> None:
    found, chosen = state.found, state.chosen
    ask_for_surplus(found, chosen, state.joints)
    ask_for_joints(found, chosen, state.groups)
    by_name = {target: family for target, family in chosen.items() if target not in state.nameless}
    note_other_names(found, by_name)
    note_order_of_legs(found, chosen, state.joints, state.mapping)
    note_controllers_constants(found, chosen, state.groups, state.recording)


def _ask_for_what_lacks(state: Guessing) -> None:
    found, recording, machine, mapping = state.found, state.recording, state.machine, state.mapping
    _ask_for_doubts(found, recording, machine)
    ask_for_positions(found, recording, machine)
    ask_for_stated_positions(found, state.clues, state.joints)
    ask_for_torques(found, state.groups, recording, mapping)
    ask_for_torques_of_no_joint(found, state.unplaced, state.left, state.joints, recording, mapping)
    ask_for_base(found, recording, machine, mapping)


def _convert(state: Guessing) -> None:
    state.found.mapped = convert_units(state.found, state.recording, state.machine, state.mapping)


def _name_unused(state: Guessing) -> None:
    found, live = state.found, live_columns(state.recording)
    note_joints_without_position(found, state.joints)
    used = {item.source for item in found.mapped} | set(state.clocks)
    found.unused = [name for name in column_names(state.recording) if name not in used]
    found.lost = [
        name
        for name in found.unused
        if name in live and name in state.clues and is_of_joints(state.clues[name])
    ]


def _find_clocks(state: Guessing) -> None:
    """A time for every stream; streams that have a time of their own need none."""
    found, clues, mapping = state.found, state.clues, state.mapping
    stated = {item.source for item in found.mapped if item.target == "time"}
    for stream in state.recording.streams:
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
            _without_clock(state, stream)
            continue
        values = next(c.values for c in stream.columns if c.name == name)
        unit = mapping.units.get("time", "") or (clues[name].unit if name in clues else "")
        by_map = mapping.units.get("time")
        paced = clock_pace(values, unit, stated_rate(state.recording.said))
        seconds, why = (TICKS[unit], "stated in the map") if by_map else paced
        scale = mapping.scale.get("time", 1.0)
        if seconds is None and scale == 1.0:
            found.ask(f"the unit of the clock {name} cannot be told ({why})", "units: {time: ms}")
        seconds = scale * (1.0 if seconds is None else seconds)
        why += f", times {scale:.6g} as the map says" if scale != 1.0 else ""
        if here is not None:
            found.mapped = [item for item in found.mapped if item.source != name]
        found.mapped.append(Mapped("time", name, seconds, f"{because}; {why}", stated=here is not None))
        state.clocks[name] = stream


def _without_clock(state: Guessing, stream: Stream) -> None:
    found, clues = state.found, state.clues
    stated = state.mapping.rate_hz
    rate = stated or stated_rate(state.recording.said)
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


def _propose_rate(state: Guessing) -> None:
    """The rate that velocities tell, where a rate has to be asked for."""
    found = state.found
    at = next((k for k, question in enumerate(found.questions) if question.line == RATE_LINE), None)
    values = {column.name: column.values for stream in state.recording.streams for column in stream.columns}
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


def _add_channels(state: Guessing) -> None:
    found, chosen, nameless = state.found, state.chosen, state.nameless
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


# Axes that are called by the letter that accelerations have: ``A1`` … ``A6`` of KUKA's and ABB's controllers.

_LETTER = "a"


def _take_axes(state: Guessing) -> None:
    """Take columns of axes for positions where no others are there.

    A recording of accelerations has positions, too; one of axes' positions calls them by their axes alone.
    """
    groups = state.groups
    measured = next((f for f in groups if f.quantity == "a" and f.target == "a" and f.stem == _LETTER), None)
    if measured is None or "q" in state.known or any(family.target == "q" for family in groups):
        return
    state.found.facts.append(
        ("q", f"{measured.columns[0]} …", "axes by their letter: no other positions are there")
    )
    state.groups = [
        replace(family, quantity="q", target=TARGETS["q", state.left[family.columns[0]].commanded])
        if family.quantity == "a" and _LETTER in family.stem.split("_")
        else family
        for family in groups
    ]


# Commands whose names do not say of what: ``ctrl`` and ``action`` may be positions, or torques.

# Median over the joints of the correlation with what was measured. In 60 drawn motions of three arms (3 to 20 s),
# positions that were asked for 10 to 90 ms before correlate by 0.94 or more with those measured, torques with positions
# by 0.00 at the most; robots under weak gains follow worse, so the line is drawn between.
_FOLLOWED = 0.5
# A hobby servo at 50 Hz answers 4 rows after it was asked.
_LATEST_ROWS = 8


def _settle_commands(state: Guessing) -> None:
    """Take commands of no stated quantity for what was measured that follows them.

    Positions go first: what torques are asked for is close to no position. Commands that nothing follows are left out
    where torques were measured, and asked about where none were.
    """
    found, chosen, recording, joints = state.found, state.chosen, state.recording, state.joints
    family = chosen.get("q_cmd")
    if family is None or "q" not in chosen or family.stated or _says_positions(family):
        return
    columns = {c.name: c.values for stream in recording.streams for c in stream.columns}
    agreements = {
        target: _command_agreement(family, chosen[target], columns)
        for target in ("q", "tau")
        if target in chosen
    }
    of_position, of_torque = agreements["q"], agreements.get("tau") or 0.0
    if of_position is None or of_position >= max(_FOLLOWED, of_torque):
        return
    measured = {"tau", "i"} & {*chosen, *(item.channel for item in found.mapped)}
    if not measured and is_followed(family, chosen["q"], recording):
        why = "commands whose name says no quantity: positions, towards which the measured ones move"
        found.facts.append(("q_cmd", f"{family.columns[0]} …", why))
        return
    del chosen["q_cmd"]
    if of_torque >= _FOLLOWED:
        if "tau_cmd" not in chosen:
            chosen["tau_cmd"] = replace(family, target="tau_cmd", quantity="tau")
        return
    if not measured:
        found.ask(
            f"{family.columns[0]} … are commands by their names, and the positions do not follow them: whether they "
            "are positions or torques is not told",
            f"columns: {{{columns_line(family, joints)}}} or columns: {{{columns_line(family, joints, 'tau_cmd')}}}",
        )
        return
    found.facts.append(
        ("nothing", f"{family.columns[0]} …", "commands that no measured position or torque follows")
    )


def is_followed(command: Family, position: Family, recording: Recording) -> bool:
    """Whether positions do as a command asks: they resemble it, or move towards it a few rows later.

    A servo that is asked for more than it can do turns towards its target as fast as it can, which is proportional
    to, or has the sign of, what is left to go.
    """
    columns = {c.name: c.values for stream in recording.streams for c in stream.columns}
    alike = _command_agreement(command, position, columns)
    if alike is None or alike >= _FOLLOWED:
        return True
    towards = []
    for joint, name in command.placed.columns.items():
        if joint in position.placed.columns:
            asked, is_at = columns[name], columns[position.placed.columns[joint]]
            left, step = (asked - is_at)[:-1], np.diff(is_at)
            # Up to as many rows late as a few hundredths of a second are at the rates of servos.
            towards.append(
                max(
                    _correlation(left[: len(left) - late], step[late:]) or 0.0 for late in range(_LATEST_ROWS)
                )
            )
    return bool(towards) and float(np.median(towards)) >= _FOLLOWED


def _says_positions(family: Family) -> bool:
    return any(OF_WORD.get(word) == "q" for word in family.stem.split("_"))


def _command_agreement(one: Family, other: Family, columns: Mapping[str, Array]) -> float | None:
    """Median over the joints of the correlation; None where they are of different times."""
    values = []
    for joint, name in one.placed.columns.items():
        if joint not in other.placed.columns:
            continue
        a, b = columns[name], columns[other.placed.columns[joint]]
        if len(a) != len(b):
            return None
        if (value := _correlation(a, b)) is not None:
            values.append(value)
    return float(np.median(values)) if values else None


def _correlation(a: Array, b: Array) -> float | None:
    """Of the rows in which both are numbers; None where one of them stands still."""
    whole = np.isfinite(a) & np.isfinite(b)
    if whole.sum() <= 2 or np.ptp(a[whole]) == 0.0 or np.ptp(b[whole]) == 0.0:
        return None
    return float(np.corrcoef(a[whole], b[whole])[0, 1])


# Quantities that change while a robot moves: positions may stand still, and commands too.
_MOVING = ("v", "a", "tau", "i", "volt")


def _leave_unfilled(state: Guessing) -> None:
    """Leave out velocities, torques, currents and voltages that never change at any joint.

    Drivers without torque sensors leave the efforts of a joint state at zero, and servos that do not measure a load
    report a constant. One dead channel among live ones stays: it is a fault, which the doctor names.
    """
    varying, live = live_columns(state.recording), []
    for family in state.groups:
        if family.quantity in _MOVING and varying.isdisjoint(family.columns):
            why = "the same number in every row at every joint: the field was not filled, and nothing is made of it"
            name = family.columns[0] if len(family.columns) == 1 else f"{family.columns[0]} …"
            state.found.facts.append(("nothing", name, why))
        else:
            live.append(family)
    state.groups = live


# Forces that were measured at feet, tools or load cells: joints that turn are driven by torques, not by
# these.


def _leave_contacts(state: Guessing) -> None:
    """Leave out those called forces that are fewer than the joints, which turn.

    A column is called a force where something slides, is pressed or stands: some programs call all joints' torques
    forces, too, and then there is one for each joint of which there are positions.
    """
    machine = state.machine
    placed = [len(family.placed.columns) for family in state.groups if family.quantity == "q"]
    joints = max(placed, default=machine.n)
    left = []
    for family in state.groups:
        if _is_force(family) and len(family.columns) < joints and not _is_prismatic_family(family, machine):
            why = "forces, fewer than the joints, which turn: of feet, tools or load cells, and no joint's torques"
            state.found.facts.append(("nothing", f"{family.columns[0]} …", why))
        else:
            left.append(family)
    state.groups = left


def _is_force(family: Family) -> bool:
    words = set(family.stem.split("_"))
    return (
        family.quantity == "tau"
        and not family.stated
        and bool(words & FORCES)
        and family.unit in ("", "N", "kN")
        and not (family.placed.named and family.placed.columns and not family.placed.left_over)
    )


def _is_prismatic_family(family: Family, machine: Machine) -> bool:
    places = [machine.joints.index(joint) for joint in family.placed.columns if joint in machine.joints]
    return any(bool(machine.slides[place]) for place in places)


# Columns that a map states: patterns expanded, what is not there asked for, single joints beside guessed
# ones.


def _take_stated(state: Guessing) -> None:
    """What a map's ``columns`` say, patterns expanded; columns that are not there are asked for."""
    found, recording, joints = state.found, state.recording, state.joints
    names = column_names(recording)
    for target, pattern in state.mapping.columns.items():
        if unlike := _no_target(target, pattern, joints):
            found.ask(*unlike)
            continue
        missing = []
        for goal, column in expand(target, pattern, joints):
            source = column if column in names else _same_but_for_stream(column, names)
            if source is None:
                missing.append(column)
            else:
                found.mapped.append(Mapped(goal, source, 1.0, "stated in the map", stated=True))
        if missing:
            there = ", ".join(names[:MOST_NAMED]) + (" …" if len(names) > MOST_NAMED else "")
            found.ask(
                f"no column {', '.join(missing[:4])} in {recording.name}, which has {there}",
                f'columns: {{{target}: "NAME"}}',
            )
    state.clues = _with_stated_labels(found, state.clues)


def _no_target(target: str, pattern: str, joints: Sequence[str]) -> tuple[str, str] | None:
    """What is wrong with a target of ``columns`` that names no joint of the robot, and the line to correct it."""
    channel, _, joint = target.partition(".")
    if channel not in TARGETS.values() or joint in joints:
        return None
    if not joint and (len(joints) == 1 or re.search(r"\{(joint|n0?)\}", pattern)):
        return None
    names = first_names(joints, MOST_NAMED)
    wrong = (
        f"is one column for {len(joints)} joints"
        if not joint
        else f"names no joint of the robot, which has {names}"
    )
    return (
        f"{target}: {pattern} {wrong}",
        f'columns: {{{channel}.{joints[0]}: "{pattern}"}} (or another joint)',
    )


def _leave_stated(state: Guessing) -> None:
    """Leave out columns of joints of which a map states another column for the same channel."""
    clues = state.clues
    stated = {item.target: item.source for item in state.found.mapped if item.stated}
    numbers = {clues[source].numbers for source in stated.values() if source in clues} - {()}
    left = []
    for family in state.groups:
        taken = {joint for joint in family.placed.columns if f"{family.target}.{joint}" in stated}
        taken = {j for j in taken if stated[f"{family.target}.{j}"] != family.placed.columns[j]}
        said = {target.partition(".")[2] for target in stated if target.startswith(f"{family.target}.")}
        doubts = tuple(
            replace(doubt, joints=free, columns=columns)
            for doubt in family.placed.doubts
            if (free := tuple(joint for joint in doubt.joints if joint not in said))
            if (columns := tuple(c for c in doubt.columns if not (said and clues[c].numbers in numbers)))
        )
        others = {joint: column for joint, column in family.placed.columns.items() if joint not in taken}
        if others or not taken:
            left.append(replace(family, placed=replace(family.placed, columns=others, doubts=doubts)))
    state.groups = left


def _with_stated_labels(found: Guesses, clues: dict[str, Clue]) -> dict[str, Clue]:
    """The clues, columns of whatever quantity being of the joint that a map states of the same label."""
    labels: dict[tuple[str, tuple[int, ...]], str] = {}
    for item in found.mapped:
        said, joint = clues.get(item.source), item.target.partition(".")[2]
        if item.channel in TARGETS.values() and said is not None and said.label and joint:
            labels.setdefault((said.label, said.numbers), joint)
    return {
        name: replace(said, exact=labels[said.label, said.numbers])
        if not said.exact and (said.label, said.numbers) in labels
        else said
        for name, said in clues.items()
    }


def ask_for_stated_positions(found: Guesses, clues: dict[str, Clue], joints: Sequence[str]) -> None:
    """Ask for the positions of joints of which a map states something else, and nothing tells them."""
    known = {item.target.partition(".")[2] for item in found.of("q")}
    lacking = [
        (item.target, joint)
        for item in found.mapped
        if item.stated and item.channel in TARGETS.values() and (joint := item.target.partition(".")[2])
        if joint in joints and joint not in known
    ]
    if known and lacking:
        target, joint = lacking[0]
        found.ask(
            f"{target} is stated, and no position of {joint} was found",
            f'columns: {{q.{joint}: "NAME"}}',
        )


def of_single_joints(
    found: Guesses, clues: dict[str, Clue], mapping: Map, joints: Sequence[str]
) -> dict[str, Clue]:
    """What columns say that a map states of some joints of a channel: the others' are guessed beside them."""
    stated: dict[str, dict[str, str]] = {}
    for item in found.mapped:
        channel, _, joint = item.target.partition(".")
        if item.stated and (channel in TARGETS.values()) and joint:
            stated.setdefault(channel, {})[joint] = item.source
    said: dict[str, Clue] = {}
    for (quantity, commanded), channel in TARGETS.items():
        columns = stated.get(channel, {})
        if len(columns) < len(joints) and not any(key == channel for key in mapping.columns):
            said |= {
                column: replace(clues[column], quantity=quantity, commanded=commanded, exact=joint)
                for joint, column in columns.items()
                if column in clues
            }
    return said


def expand(target: str, pattern: str, joints: Sequence[str]) -> list[tuple[str, str]]:
    """Channels of single joints with their columns, for a pattern with ``{joint}``, ``{n}`` or ``{n0}``."""
    channel, _, label = target.partition(".")
    if not re.search(r"\{(joint|n0?)\}", pattern):
        if label or channel in {"time", "base", "wrench", "imu", "contact"} or len(joints) != 1:
            return [(target, pattern)]
        return [(f"{channel}.{joints[0]}", pattern)]
    found = []
    for k, joint in enumerate(joints):
        column = pattern.replace("{joint}", joint).replace("{n0}", str(k)).replace("{n}", str(k + 1))
        found.append((f"{channel}.{joint}", column))
    return found


def _same_but_for_stream(column: str, names: list[str]) -> str | None:
    found = [name for name in names if name.rpartition("/")[2] == column]
    return found[0] if len(found) == 1 else None


RULES = (
    Rule("names", "what every column's name or format says: clues", _read_names),
    Rule("map", "columns that a map states: channels, and joints of the labels they share", _take_stated),
    Rule("clock", "the times of every stream and their unit; a rate is asked for", _find_clocks),
    Rule(
        "base", "pose, wrenches and contacts of what moves freely", _take_base, lambda s: s.machine.floating
    ),
    Rule("families", "columns of one quantity of all joints", _group_by_quantity),
    Rule("stated joints", "joints of which the map states another column", _leave_stated),
    Rule("axes", "axes that are called by the letter of accelerations: positions", _take_axes),
    Rule("unfilled", "fields that nobody filled: left out", _leave_unfilled),
    Rule("contacts", "forces of feet, tools and load cells: left out", _leave_contacts),
    Rule(
        "own base",
        "angles of the base among the joints': left out",
        _leave_base,
        lambda s: s.machine.floating,
    ),
    Rule("choice", "the family of each channel", _choose),
    Rule(
        "physics",
        "positions, velocities and torques among columns whose names say nothing",
        _tell_by_physics,
        lambda s: "q" not in s.known | set(s.chosen),
    ),
    Rule("torques", "which torques were measured, and of which joints", _settle_torques),
    Rule(
        "commands",
        "of what the commands are that state no quantity: positions or torques",
        _settle_commands,
    ),
    Rule("doubtful choice", "surplus columns and joints that are not told: questions", _note_choice),
    Rule("channels", "channels of the chosen families", _add_channels),
    Rule("rate", "the rate that velocities tell", _propose_rate),
    Rule(
        "nameless torques",
        "torques that nothing but physics tells: a question",
        lambda s: ask_for_nameless_torques(s.found, s.nameless, s.recording, s.mapping),
    ),
    Rule(
        "base by words",
        "what is left of the base: its channels",
        lambda s: add_base(s.found, s.recording, s.left, s.machine, s.mapping),
    ),
    Rule("lacking", "what no column holds: questions", _ask_for_what_lacks),
    Rule(
        "units",
        "factors to SI units, zeros and signs",
        _convert,
        lambda s: bool(s.found.of("q")) and not s.found.questions,
    ),
    Rule("unused", "columns that nothing was made of", _name_unused),
)
"""What :func:`guess_columns` does, in its order."""
