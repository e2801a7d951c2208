"""What is asked where a recording does not tell it: positions, torques, the base."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from excite.conversion.columns.families import Family
from excite.conversion.columns.joints import BY_NAME, Doubt
from excite.conversion.columns.vocabulary import FORCES, SHARES
from excite.conversion.columns.words import Clue
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import Guesses
from excite.conversion.recording import Machine, Recording, live_columns
from excite.finding import first_names
from excite.formats.tables import MISFIT

# Columns that are named in one line.
MOST_NAMED = 12
# Columns that a gripper adds behind an arm's joints.
_HAND = 2
# How servos and drives call the voltage that they are fed with.
_SUPPLY = frozenset("input in supply battery bus dc source".split())
# Front or hind and left or right, in either order, as quadrupeds' joints are called.
_LEG, _LEGS = re.compile(r"(?<![a-z])([frh][lr]|[lr][frh])(?![a-z])"), 4


def column_names(recording: Recording) -> list[str]:
    """Names of the columns of all streams, in their order."""
    return [column.name for stream in recording.streams for column in stream.columns]


def ask_for_torques(found: Guesses, groups: Sequence[Family], recording: Recording, mapping: Map) -> None:
    """Voltages and duty cycles are no torques, and nothing in a recording says how much of one they are."""
    if found.of("tau") or found.of("i") or "torque" in mapping.log:
        return
    for family in groups:
        if family.quantity == "volt" and family.placed.columns and not _is_supply(family, recording):
            name = family.columns[0]
            share = family.unit == "%" or SHARES & set(family.stem.split("_"))
            kind = "a share of a rated torque or current" if share else "a voltage or duty cycle"
            found.ask(
                f"{name} is {kind}, whose torque per unit is not known",
                f'columns: {{tau: "{name}"}} and scale: {{tau: FACTOR}}, or log: {{torque: none}}',
                {f"tau.{joint}": column for joint, column in family.placed.columns.items()},
            )
            return


def ask_for_nameless_torques(
    found: Guesses, nameless: Mapping[str, Family], recording: Recording, mapping: Map
) -> None:
    """Of columns without names of which some were told by their values, which of those that are left are torques."""
    if "q" not in nameless or found.of("tau") or found.of("i") or "torque" in mapping.log:
        return
    used = {item.source for item in found.mapped}
    left = [
        column.name
        for stream in recording.streams
        for column in stream.columns
        if column.name not in used and not mapping.ignores(column.name) and np.nanstd(column.values) > 0.0
    ]
    if not left:
        return
    told = ", ".join(f"{f.columns[0]} … {f.columns[-1]} as {target}" for target, f in nameless.items())
    joint = next(iter(nameless["q"].placed.columns))
    found.ask(
        f"the columns have no names: by their values {told} were told, and {first_names(left, MOST_NAMED)} are left, "
        "of which nothing says whether they are torques",
        f'columns: {{tau.{joint}: "{left[0]}"}} (i.{joint} for currents), or log: {{torque: none}}',
    )


def torques_of_no_joint(
    groups: Sequence[Family], chosen: Mapping[str, Family], recording: Recording
) -> list[str]:
    """Columns that are measured torques by their names and vary, where no torque of any joint was understood.

    Several may be of one joint, as a motor's, a sensor's and an estimate; those of the other joints then hold zeros.
    """
    if {"tau", "i"} & {target for target, family in chosen.items() if family.placed.columns}:
        return []
    live = live_columns(recording)
    return [
        column
        for family in groups
        if family.target == "tau" and not FORCES & set(family.stem.split("_")) and not family.placed.columns
        for column in family.columns
        if column in live
    ]


def ask_for_torques_of_no_joint(
    found: Guesses,
    unplaced: Sequence[str],
    clues: Mapping[str, Clue],
    joints: Sequence[str],
    recording: Recording,
    mapping: Map,
) -> None:
    """Ask which of several torques is the one of a joint, where nothing says whose they are."""
    if not unplaced or found.of("tau") or found.of("i") or "torque" in mapping.log:
        return
    live = live_columns(recording)
    moving = [item.target[2:] for item in found.of("q") if item.source in live] or list(joints)
    numbers = {item.target[2:]: clues[item.source].number for item in found.of("q") if item.source in clues}
    number = clues[unplaced[0]].number
    may_be = [joint for joint, own in numbers.items() if own is not None and own == number] or moving
    found.ask(
        f"{first_names(unplaced, MOST_NAMED)} are torques by their names, and which of them is that of "
        f"{first_names(may_be, MOST_NAMED, by=' or ')} is not told",
        f'columns: {{tau.{may_be[0]}: "{unplaced[0]}"}}, or log: {{torque: none}}',
    )


def _is_supply(family: Family, recording: Recording) -> bool:
    """Whether it is what a drive is fed with: so called, and of one sign, unlike what moves a joint."""
    if not _SUPPLY & set(family.stem.split("_")):
        return False
    values = [c.values for stream in recording.streams for c in stream.columns if c.name in family.columns]
    return all(np.nanmin(one) > 0.0 for one in values)


def ask_for_surplus(found: Guesses, chosen: Mapping[str, Family], joints: Sequence[str]) -> None:
    """Columns of many more joints than the robot has are another machine's, or more than joints."""
    for target in ("q", "tau", "i"):
        family = chosen.get(target)
        if family is None or family.placed.because == BY_NAME:
            continue
        if len(family.placed.left_over) > max(_HAND, len(joints) // 2):
            pairs = ", ".join(f'{target}.{j}: "{c}"' for j, c in zip(joints, family.columns, strict=False))
            found.ask(
                f"{family.columns[0]} … are {len(family.columns)} columns for {len(joints)} joints",
                f"columns: {{{pairs}}}, or joints: [those that the columns begin with]",
            )


def ask_for_joints(found: Guesses, chosen: Mapping[str, Family], groups: Sequence[Family]) -> None:
    """Columns that may be several joints' by their names, of the channels that a log is made of."""
    known = {item.channel for item in found.mapped} | set(chosen)
    asked = False
    for target in ("q", "tau", "i"):
        # What the map then says of positions is true of the others' labels.
        if asked:
            return
        open_ones = [family for family in groups if family.target == target and family.placed.doubts]
        if target in chosen:
            doubts = chosen[target].placed.doubts
        elif target in known or not open_ones or (target == "i" and "tau" in known):
            continue
        else:
            doubts = open_ones[0].placed.doubts
        proposed, asked = _one_each(doubts), bool(doubts)
        for doubt in doubts:
            names = ", ".join(f'"{column}"' for column in doubt.columns)
            columns = first_names(doubt.columns, MOST_NAMED)
            pairs = ", ".join(f'{target}.{proposed[c]}: "{c}"' for c in doubt.columns if c in proposed)
            line = f"ignore: [{names}]"
            found.ask(
                f"which joint {columns} is of cannot be told by its name: it may be "
                f"{first_names(doubt.joints, MOST_NAMED, by=' or ')}"
                if len(doubt.columns) == 1
                else f"which joints {columns} are of cannot be told by their names: they may be "
                f"{first_names(doubt.joints, MOST_NAMED)}",
                f"columns: {{{pairs}}}, or {line}" if pairs else line,
            )


def _one_each(doubts: Sequence[Doubt]) -> dict[str, str]:
    """A joint for each doubtful column as far as there are enough, none of them twice, in their orders."""
    columns = [(column, doubt.joints) for doubt in doubts for column in doubt.columns]
    if not columns:
        return {}
    joints = list(dict.fromkeys(joint for _, may_be in columns for joint in may_be))
    fits = np.array([[joint in may_be for joint in joints] for _, may_be in columns])
    away = np.abs(np.arange(len(columns))[:, None] - np.arange(len(joints)))
    rows, places = linear_sum_assignment(np.where(fits, away, fits.size * (away.max() + 1)))
    return {columns[k][0]: joints[at] for k, at in zip(rows, places, strict=True) if fits[k, at]}


def note_other_names(found: Guesses, chosen: Mapping[str, Family]) -> None:
    """Say which column was taken for which joint, where names or numbers that differ from the joints' told it."""
    said: set[tuple[str, ...]] = set()
    for target in ("q", "tau", "i"):
        family = chosen.get(target)
        if family is None or family.stated or family.placed.because == BY_NAME:
            continue
        pairs = tuple(f"{column} = {joint}" for joint, column in family.placed.columns.items())
        if pairs and pairs not in said:
            said.add(pairs)
            found.facts.append((f"joints of {target}", ", ".join(pairs), family.placed.because))


def note_order_of_legs(
    found: Guesses, chosen: Mapping[str, Family], joints: Sequence[str], mapping: Map
) -> None:
    """Four legs are counted in several orders, by vendors, models and simulators; their motions do not tell which."""
    family = chosen.get("q", chosen.get("tau"))
    legs = {match[0] for joint in joints if (match := _LEG.search(joint.lower()))}
    if (
        family is None
        or mapping.joints
        or len(legs) < _LEGS
        or not family.placed.because.startswith("its number")
    ):
        return
    why = (
        "the model's order, as only numbers stand in the names; Unitree's SDK counts FR, FL, RR, RL, some simulators "
        "all hips first: if yours does, write `joints: [JOINT, …]` in the order of the columns into map.yaml"
    )
    found.facts.append(("order of legs", f"{joints[0]}, {joints[1]} … {joints[-1]}", why))


def ask_for_base(found: Guesses, recording: Recording, machine: Machine, mapping: Map) -> None:
    """How a base that is free was carried, where neither contacts nor the robot's description tell."""
    carried = found.of("contact") or found.of("wrench")
    if not machine.floating or "base" in mapping.log or (carried and (found.of("base") or found.of("imu"))):
        return
    if found.of("base"):
        if (found.of("tau") or found.of("i")) and mapping.log.get("torque") != "none":
            _ask_for_contacts(found, machine)
        return
    line = "log: {base: held}   # a stand or hands hold it; else map its pose: columns: {base.px: NAME …}"
    feet = () if machine.robot is None else machine.robot.feet
    if found.of("imu") and feet:
        line += f'; of a robot that stands, columns: {{contact.{feet[0].name}: "NAME", …}}, 1 where a foot carries'
    if any(column.channel == "imu" for stream in recording.streams for column in stream.columns):
        link = machine.base_link
        line += f"; of a robot that hangs, log: {{base: suspended, base_link: {link}, imu: {{link: {link}}}}}"
    found.ask(f"the base of {machine.name} is free, and no pose of it was recorded", line)


def _ask_for_contacts(found: Guesses, machine: Machine) -> None:
    """A pose alone does not say whether a robot stands on its feet, whose forces are then in its torques, or hangs."""
    robot = machine.robot
    if robot is None or robot.description.base != "floating" or not robot.feet:
        return
    feet = [foot.name for foot in robot.feet]
    found.ask(
        f"a pose of the base of {machine.name} was recorded, and not which of its feet {', '.join(feet)} carry",
        f'columns: {{contact.{feet[0]}: "NAME", …}}   # 1 while it stands; of a robot that hangs, '
        "log: {base: suspended}",
    )


def ask_for_positions(found: Guesses, recording: Recording, machine: Machine) -> None:
    """Ask for columns of joint positions where none was found, with the names of those that are there."""
    if found.of("q"):
        return
    names = column_names(recording)
    there = ", ".join(names[:MOST_NAMED]) + (" …" if len(names) > MOST_NAMED else "")
    there = "; ".join([there, *(note for note in recording.notes if note.startswith(MISFIT))])
    found.ask(
        f"no columns of joint positions were found for {machine.n} joints of {machine.name} among {there}",
        'columns: {q: "NAME{n}"}',
    )


def note_joints_without_position(found: Guesses, joints: Sequence[str]) -> None:
    """Say which joints of the robot the recording knows no position of, where it knows others'."""
    known = {item.target.partition(".")[2] for item in found.of("q")}
    absent = [joint for joint in joints if joint not in known]
    if known and absent:
        why = "no column holds their positions: they are taken to stand still at zero"
        found.facts.append(("joints held still", ", ".join(absent), why))
