"""What the columns of a recording are: what a map states, then what names say, then what physics allows."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.base_signals import add_base, add_base_signals, feet_of, tells_contacts
from excite.conversion.columns.clock import clock_column, clock_tick, goes_evenly, rate_by_velocities
from excite.conversion.columns.families import (
    FOLLOWED,
    POSE,
    POSE_AXES,
    TARGETS,
    Family,
    choose_families,
    clues_of,
    command_agreement,
    find_families,
    is_anonymous,
    is_followed,
    is_quaternion,
    quaternion_order,
    without_base_columns,
)
from excite.conversion.columns.joints import BY_NAME, Doubt, Placed
from excite.conversion.columns.scales import Scaling
from excite.conversion.columns.vocabulary import FORCES, OF_WORD, SHARES
from excite.conversion.columns.words import Clue, is_of_joints
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.recording import Machine, Recording, Stream, live_columns, stated_rate
from excite.finding import first_names
from excite.formats.tables import MISFIT
from excite.logs.units import TICKS, TO_SI

# Columns that are named in one line.
_MOST_NAMED = 12
# How servos and drives call the voltage that they are fed with.
_SUPPLY = frozenset("input in supply battery bus dc source".split())
# Front or hind and left or right, in either order, as quadrupeds' joints are called.
_LEG = re.compile(r"(?<![a-z])([frh][lr]|[lr][frh])(?![a-z])")
_PATTERN = re.compile(r"\{(joint|n0?)\}")


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
    unplaced: list[str] = field(default_factory=list)

    @cached_property
    def values(self) -> dict[str, Array]:
        """Numbers of every column by its name, in the file's order."""
        return {column.name: column.values for column in self.recording.columns}

    @cached_property
    def live(self) -> frozenset[str]:
        """Columns that are not the same in every row."""
        return live_columns(self.recording)

    @property
    def used(self) -> set[str]:
        """Columns that something was made of."""
        return {item.source for item in self.found.mapped} | set(self.clocks)


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
        mapping: what a person said; an empty one if nothing.
        because: what says the units of positions in it, where that is no person.

    Returns:
        Channels with their factors and reasons, and the questions that stay.
    """
    found = Guesses(stated_because=because) if because else Guesses()
    joints = mapping.joints or machine.joints
    if wrong := [joint for joint in joints if joint not in machine.joints]:
        found.ask("unknown joints", names=", ".join(wrong), joints=", ".join(machine.joints))
        return found
    state = Guessing(found, recording, machine, mapping, joints)
    for rule in RULES:
        if rule.applies(state):
            rule.change(state)
    return found


# What a map states.


def _read_names(state: Guessing) -> None:
    ignored = [column for column in state.values if state.mapping.ignores(column)]
    state.clues = clues_of(state.recording, state.joints, ignored)


def _take_stated(state: Guessing) -> None:
    """What a map's ``columns`` say, patterns expanded; columns that are not there are asked for."""
    found, names, joints = state.found, list(state.values), state.joints
    for target, pattern in state.mapping.columns.items():
        channel, _, joint = target.partition(".")
        several = not joint and len(joints) > 1 and not _PATTERN.search(pattern)
        if channel in TARGETS.values() and joint not in joints and (joint or several):
            robots = first_names(joints, _MOST_NAMED)
            wrong = (
                f"is one column for {len(joints)} joints"
                if several
                else f"names no joint of the robot, which has {robots}"
            )
            found.ask(
                "wrong target", target=target, pattern=pattern, wrong=wrong, channel=channel, joint=joints[0]
            )
            continue
        missing = []
        for goal, column in expand(target, pattern, joints):
            ends = [name for name in names if name == column] or [
                name for name in names if name.rpartition("/")[2] == column
            ]
            if len(ends) == 1:
                found.mapped.append(Mapped(goal, ends[0], 1.0, "stated in the map", stated=True))
            else:
                missing.append(column)
        if missing:
            found.ask(
                "no such column",
                names=", ".join(missing[:4]),
                recording=state.recording.name,
                there=first_names(names, _MOST_NAMED),
                target=target,
            )
    # Columns of whatever quantity are of the joint that a map states of the same label.
    labels: dict[tuple[str, tuple[int, ...]], str] = {}
    for item in found.mapped:
        said = state.clues.get(item.source)
        if item.channel in TARGETS.values() and said is not None and said.label and item.joint:
            labels.setdefault((said.label, said.numbers), item.joint)
    for name, said in state.clues.items():
        if not said.exact and (said.label, said.numbers) in labels:
            state.clues[name] = replace(said, exact=labels[said.label, said.numbers])


def expand(target: str, pattern: str, joints: Sequence[str]) -> list[tuple[str, str]]:
    """Channels of single joints with their columns, for a pattern with ``{joint}``, ``{n}`` or ``{n0}``."""
    channel, _, label = target.partition(".")
    if _PATTERN.search(pattern):
        return [
            (
                f"{channel}.{joint}",
                pattern.replace("{joint}", joint).replace("{n0}", str(k)).replace("{n}", str(k + 1)),
            )
            for k, joint in enumerate(joints)
        ]
    alone = not label and channel in TARGETS.values() and len(joints) == 1
    return [(f"{channel}.{joints[0]}" if alone else target, pattern)]


def _group_by_quantity(state: Guessing) -> None:
    """Families of what is left, and of columns that a map states of some joints, beside which others are guessed."""
    state.left = {name: said for name, said in state.clues.items() if name not in state.used}
    single: dict[str, Clue] = {}
    for (quantity, commanded), channel in TARGETS.items():
        stated = [item for item in state.found.of(channel) if item.stated and item.joint]
        if len(stated) < len(state.joints) and channel not in state.mapping.columns:
            for item in stated:
                if said := state.clues.get(item.source):
                    single[item.source] = replace(
                        said, quantity=quantity, commanded=commanded, exact=item.joint
                    )
    state.left |= single
    state.known = {item.channel for item in state.found.mapped if item.source not in single}
    families = find_families(state.recording, state.left, state.joints)
    state.groups = [f for f in families if f.target not in state.known and not is_anonymous(f, state.joints)]


def _leave_stated(state: Guessing) -> None:
    """Leave out columns of joints of which a map states another column for the same channel."""
    clues = state.clues
    stated = {item.target: item.source for item in state.found.mapped if item.stated}
    numbers = {clues[source].numbers for source in stated.values() if source in clues} - {()}
    left = []
    for family in state.groups:
        said = {j: stated[f"{family.target}.{j}"] for j in state.joints if f"{family.target}.{j}" in stated}
        others = {j: column for j, column in family.placed.columns.items() if said.get(j, column) == column}
        doubts = tuple(
            Doubt(columns, free)
            for doubt in family.placed.doubts
            if (free := tuple(joint for joint in doubt.joints if joint not in said))
            if (columns := tuple(c for c in doubt.columns if not (said and clues[c].numbers in numbers)))
        )
        if others or not family.placed.columns:
            left.append(replace(family, placed=replace(family.placed, columns=others, doubts=doubts)))
    state.groups = left


# Clocks.


def _find_clocks(state: Guessing) -> None:
    """A time for every stream; streams that have a time of their own need none."""
    found, clues, mapping = state.found, state.clues, state.mapping
    rate = stated_rate(state.recording.said)
    for stream in state.recording.streams:
        stated = next((i for i in found.of("time") if i.source in {c.name for c in stream.columns}), None)
        if stated is None and stream.time is not None:
            continue
        seen = replace(stream, columns=tuple(column for column in stream.columns if column.name in clues))
        clock = (stated.source, "stated in the map") if stated else clock_column(seen, clues)
        if clock is None:
            _ask_for_rate(state, stream, rate)
            continue
        name, because = clock
        by_map = mapping.units.get("time")
        unit = clues[name].unit if name in clues else ""
        seconds, why = (
            (TICKS[by_map], "stated in the map") if by_map else clock_tick(state.values[name], unit, rate)
        )
        scale = mapping.scale.get("time", 1.0)
        if seconds is None and scale == 1.0:
            found.ask("unit of the clock", column=name, why=why)
        why += f", times {scale:.6g} as the map says" if scale != 1.0 else ""
        found.mapped = [item for item in found.mapped if item is not stated]
        factor = scale * (seconds or 1.0)
        found.mapped.append(Mapped("time", name, factor, f"{because}; {why}", stated=stated is not None))
        state.clocks[name] = stream


def _ask_for_rate(state: Guessing, stream: Stream, stated: float | None) -> None:
    """Rows at the rate that a map or the recording states; else it is asked for."""
    found, clues = state.found, state.clues
    if rate := state.mapping.rate_hz or stated:
        found.rate_hz = float(rate)
        by = "" if state.mapping.rate_hz else ", and the recording states its rate"
        found.note("rate stated", rate=f"{rate:g}", by=by)
        return
    named = [c.name for c in stream.columns if c.name in clues and clues[c.name].quantity == "time"]
    found.ask_of_all("rate", stream.name, but=f" ({named[0]} does not go forward evenly)" if named else "")


def _propose_rate(state: Guessing) -> None:
    """The rate that velocities tell, where a rate has to be asked for."""
    found = state.found

    def numbers(item: Mapped) -> tuple[Array, bool]:
        """Values by the unit that the name states, and whether it states any."""
        said = state.clues.get(item.source)
        size = None if said is None else TO_SI.get(said.unit)
        return state.values[item.source] * (size or 1.0), size is not None

    speeds = {item.joint: numbers(item) for item in found.of("v")}
    both = [(numbers(item), speeds[item.joint]) for item in found.of("q") if item.joint in speeds]
    # Of positions in degrees and velocities of no stated unit, or the other way round, the ratio is no rate.
    pairs = [(q, v) for (q, of_q), (v, of_v) in both if of_q == of_v and len(q) == len(v)]
    if pairs:
        q, v = (np.column_stack(side) for side in zip(*pairs, strict=True))
        whole = np.isfinite(q).all(axis=1) & np.isfinite(v).all(axis=1)
        rate = rate_by_velocities(q[whole], v[whole])
        found.questions = [
            question.with_rate(float(f"{rate:.3g}"), ", as the velocities say")
            if rate and question.key == "rate"
            else question
            for question in found.questions
        ]


# Families: what is left out, what a channel is made of.


def _take_axes(state: Guessing) -> None:
    """Take columns of axes for positions where no others are there: ``A1`` … ``A6`` of KUKA's and ABB's controllers.

    A recording of accelerations has positions, too; one of axes' positions calls them by their axes alone.
    """
    measured = next((f for f in state.groups if f.target == "a" and f.stem == "a"), None)
    if measured is None or "q" in {*state.known, *(family.target for family in state.groups)}:
        return
    state.found.note("axes", columns=measured.first)
    state.groups = [
        replace(f, quantity="q", target=TARGETS["q", state.left[f.columns[0]].commanded])
        if f.quantity == "a" and "a" in f.words
        else f
        for f in state.groups
    ]


def _leave_out(state: Guessing) -> None:
    """Leave out loads and velocities that never change at any joint, and those called forces that are no joints'.

    Drivers without torque sensors leave the efforts of a joint state at zero, and servos that do not measure a load
    report a constant. One dead channel among live ones stays: it is a fault, which the doctor names.

    A column is called a force where something slides, is pressed or stands: some programs call all joints' torques
    forces, too, and then there is one for each joint of which there are positions, all of which turn.
    """
    machine = state.machine
    joints = max((len(f.placed.columns) for f in state.groups if f.quantity == "q"), default=machine.n)
    for family in list(state.groups):
        force = family.quantity == "tau" and not family.stated and bool(family.words & FORCES)
        known = family.placed.named and family.placed.columns and not family.placed.left_over
        slides = any(machine.slides[machine.joints.index(j)] for j in family.placed.columns)
        of_none = family.unit in ("", "N", "kN") and not (known or slides) and len(family.columns) < joints
        # Quantities that change while a robot moves: positions may stand still, and commands too.
        if family.quantity in ("v", "a", "tau", "i", "volt") and state.live.isdisjoint(family.columns):
            name = family.columns[0] if len(family.columns) == 1 else family.first
            state.found.note("unfilled", columns=name)
        elif force and of_none:
            state.found.note("contact forces", columns=family.first)
        else:
            continue
        state.groups.remove(family)


def _leave_base(state: Guessing) -> None:
    """Take the base's part out of families that begin with it: seven columns more than joints, four a quaternion."""
    found, joints = state.found, state.joints
    posed = next((f for f in state.groups if f.target == "q" and len(f.columns) == POSE + len(joints)), None)
    if posed is None:
        return
    quaternion = np.column_stack([state.values[name] for name in posed.columns[3:POSE]])
    if not is_quaternion(quaternion):
        return
    order = quaternion_order(quaternion)
    if order is None:
        w, x = posed.columns[3:5]
        found.ask("order of quaternion", column=f"{posed.columns[0]} … begins with a pose; {w}", w=w, x=x)
        return
    if not found.of("base"):
        because = f"seven columns more than joints, four of them a quaternion, {order}"
        axes = zip(("px", "py", "pz", *POSE_AXES[order]), posed.columns[:POSE], strict=True)
        found.mapped += [Mapped(f"base.{axis}", name, 1.0, because) for axis, name in axes]
    state.groups = [without_base_columns(family, joints) for family in state.groups]


def _find_followers(state: Guessing) -> None:
    """Positions among columns whose names say nothing: as many as joints, which follow their commands."""
    named = {column for family in state.chosen.values() for column in family.columns}
    # Second clocks and counters of rows are smoother than any joint.
    silent = [
        name
        for name, said in state.left.items()
        if name in state.live - named and not said.commanded and said.quantity not in ("volt", "time", "skip")
        if not goes_evenly(state.values[name])
    ]
    if len(silent) == len(state.joints) and (state.clocks or state.found.rate_hz):
        pairs = dict(zip(state.joints, silent, strict=True))
        placed = Placed(pairs, "the columns' order (they follow commands)")
        followed = Family("q", "q", placed, (*pairs.values(),))
        if is_followed(state.chosen["q_cmd"], followed, state.values):
            state.chosen["q"] = followed


def _settle_torques(state: Guessing) -> None:
    """Torques of no joint, and what was asked of the joints where nothing measured is there."""
    found, chosen, joints = state.found, state.chosen, state.joints
    placed = {target for target, family in chosen.items() if family.placed.columns}
    if not {"tau", "i"} & placed:
        state.unplaced = [
            column
            for family in state.groups
            if family.target == "tau" and not FORCES & family.words and not family.placed.columns
            for column in family.columns
            if column in state.live
        ]
    known = {*chosen, *found.channels, *(["tau"] if state.unplaced else [])}
    if not {"q", "tau", "i"} & known and {"q_cmd", "tau_cmd"} <= set(chosen):
        # The torques that a controller asks for are its own model's: identified, they would only give that back.
        q, tau = chosen.pop("q_cmd"), chosen.pop("tau_cmd")
        positions, torques = q.line(joints, "q"), tau.line(joints, "tau")
        found.ask("nothing measured", q=q.first, tau=tau.first, positions=positions, loads=torques)
    if "q_cmd" in chosen and "q" not in {*chosen, *found.channels}:
        q = chosen["q"] = replace(chosen.pop("q_cmd"), target="q")
        # Columns whose names say nothing may be what was measured.
        rest = [column for column, said in state.left.items() if not said.quantity and column in state.live]
        if {"tau", "i"} & set(chosen) or len(rest) >= len(joints):
            found.ask("no measured positions", q=q.first, line=q.line(joints))
        else:
            # A motion that was planned and has no measured twin.
            found.note("planned positions", columns=q.columns[0])
    if "tau_cmd" in chosen and not known & {"tau", "i"}:
        chosen["tau"] = replace(chosen.pop("tau_cmd"), target="tau")
        found.note("commanded torques", columns=chosen["tau"].columns[0])


def _settle_commands(state: Guessing) -> None:
    """Take commands of no stated quantity (``ctrl``, ``action``) for what was measured that follows them.

    Positions go first: what torques are asked for is close to no position. Commands that nothing follows are left out
    where torques were measured, and asked about where none were.
    """
    found, chosen, values = state.found, state.chosen, state.values
    command = chosen.get("q_cmd")
    said = command is not None and (command.stated or any(OF_WORD.get(word) == "q" for word in command.words))
    if command is None or said or "q" not in chosen:
        return
    of_position = command_agreement(command, chosen["q"], values)
    of_torque = (command_agreement(command, chosen["tau"], values) or 0.0) if "tau" in chosen else 0.0
    if of_position is None or of_position >= max(FOLLOWED, of_torque):
        return
    measured = {"tau", "i"} & {*chosen, *found.channels}
    if not measured and is_followed(command, chosen["q"], values):
        found.note("followed commands", columns=command.first)
        return
    del chosen["q_cmd"]
    if of_torque >= FOLLOWED:
        chosen.setdefault("tau_cmd", replace(command, target="tau_cmd", quantity="tau"))
    elif measured:
        found.note("commands without effect", columns=command.first)
    else:
        lines = {key: command.line(state.joints, key) for key in ("q_cmd", "tau_cmd")}
        found.ask("unfollowed commands", columns=command.first, **lines)


def _note_choice(state: Guessing) -> None:
    """Say which column was taken for which joint, where names or numbers that differ from the joints' told it, and ask
    where there are many more columns than joints: another machine's."""
    found, joints, said = state.found, state.joints, set()
    for target in ("q", "tau", "i"):
        family = state.chosen.get(target)
        if family is None or family.placed.because == BY_NAME:
            continue
        if len(family.placed.left_over) > max(2, len(joints) // 2):
            pairs = ", ".join(f'{target}.{j}: "{c}"' for j, c in zip(joints, family.columns, strict=False))
            found.ask(
                "surplus", columns=family.first, count=len(family.columns), joints=len(joints), pairs=pairs
            )
        text = ", ".join(f"{column} = {joint}" for joint, column in family.placed.columns.items())
        if text and text not in said and not family.stated:
            said.add(text)
            found.note("joints by names", channel=target, pairs=text, because=family.placed.because)
    _ask_for_joints(state)
    # Four legs are counted in several orders, by vendors, models and simulators; their motions do not tell which.
    family = state.chosen.get("q", state.chosen.get("tau"))
    legs = {match[0] for joint in joints if (match := _LEG.search(joint.lower()))}
    counted = family is not None and family.placed.because.startswith("its number")
    if counted and not state.mapping.joints and len(legs) >= 4:
        found.note("order of legs", first=joints[0], second=joints[1], last=joints[-1])


def _ask_for_joints(state: Guessing) -> None:
    """Columns that may be several joints' by their names, of the channels that a log is made of."""
    known = state.found.channels | set(state.chosen)
    for target in ("q", "tau", "i"):
        open_ones = [f for f in state.groups if f.target == target and f.placed.doubts]
        if target not in state.chosen and (target in known or (target == "i" and "tau" in known)):
            continue
        family = state.chosen.get(target, open_ones[0] if open_ones else None)
        doubts = () if family is None else family.placed.doubts
        taken: set[str] = set()
        for doubt in doubts:
            # A joint for each as far as there are enough, none of them twice.
            free = [joint for joint in doubt.joints if joint not in taken]
            taken |= set(free[: len(doubt.columns)])
            pairs = ", ".join(f'{target}.{j}: "{c}"' for c, j in zip(doubt.columns, free, strict=False))
            ignore = "ignore: [" + ", ".join(f'"{column}"' for column in doubt.columns) + "]"
            alone = len(doubt.columns) == 1
            state.found.ask(
                "which joint" if alone else "which joints",
                columns=first_names(doubt.columns, _MOST_NAMED),
                joints=first_names(doubt.joints, _MOST_NAMED, by=" or " if alone else ", "),
                line=f"columns: {{{pairs}}}, or {ignore}" if pairs else ignore,
            )
        # What the map then says of positions is true of the others' labels.
        if doubts:
            return


def _add_channels(state: Guessing) -> None:
    found, chosen = state.found, state.chosen
    joints = set(chosen["q"].placed.columns) if "q" in chosen else {item.joint for item in found.of("q")}
    known = {item.target for item in found.mapped}
    for target, family in chosen.items():
        columns = {joint: column for joint, column in family.placed.columns.items() if joint in joints}
        if columns and target not in ("q", "tau", "i") and set(columns) != joints:
            found.note("not of every joint", channel=target, column=family.columns[0])
            continue
        said = "the format says so" if family.stated else "its name"
        because = f"{said}; joint by {family.placed.because}"
        found.mapped += [
            Mapped(f"{target}.{joint}", column, 1.0, because)
            for joint, column in columns.items()
            if f"{target}.{joint}" not in known
        ]


def _ask_for_motion(state: Guessing) -> None:
    """Positions that are not there, and what the format says of columns that do not hold what their place says."""
    found, machine = state.found, state.machine
    guessed = {i.source for i in found.mapped if not i.stated and i.joint not in machine.motors}
    for doubt in state.recording.said.get("doubts", ()):
        if guessed & set(doubt.columns):
            found.ask("linkages", motors=", ".join(doubt.motors), marks=doubt.marks)
    known = {item.joint for item in found.of("q")}
    if not known:
        there = first_names(list(state.values), _MOST_NAMED)
        there = "; ".join([there, *(note for note in state.recording.notes if note.startswith(MISFIT))])
        found.ask(
            "no positions",
            joints=machine.n,
            robot=machine.name,
            there=there,
            joint=next(iter(state.joints), "JOINT"),
        )
    stated = {
        i.joint: i.source
        for i in found.mapped
        if i.stated and i.channel in TARGETS.values() and i.joint in state.joints
    }
    forces = {
        joint: column
        for target in ("tau", "i")
        if target in state.chosen
        for joint, column in state.chosen[target].placed.columns.items()
        if column in state.live
    }
    lacking = (
        next((one for one in {**stated, **forces}.items() if one[0] not in known), None) if known else None
    )
    if lacking is not None:
        found.ask("no position of a joint", joint=lacking[0], column=lacking[1])


def _ask_for_torques(state: Guessing) -> None:
    """Which columns are torques, where nothing says it: of voltages, several of one joint."""
    found, clues = state.found, state.left
    for family in state.groups:
        supply = family.words & _SUPPLY and all(np.nanmin(state.values[c]) > 0.0 for c in family.columns)
        if family.quantity == "volt" and family.placed.columns and not supply:
            share = family.unit == "%" or SHARES & family.words
            kind = "a share of a rated torque or current" if share else "a voltage or duty cycle"
            torques = {f"tau.{joint}": column for joint, column in family.placed.columns.items()}
            found.ask("no torques", {"torques": torques}, column=family.columns[0], kind=kind)
            break
    if state.unplaced:
        of = {i.joint: clues[i.source].number if i.source in clues else None for i in found.of("q")}
        first = clues[state.unplaced[0]]
        may_be = [first.exact] if first.exact in state.joints else []
        may_be = may_be or [joint for joint, own in of.items() if own is not None and own == first.number]
        may_be = may_be or [i.joint for i in found.of("q") if i.source in state.live] or list(state.joints)
        found.ask(
            "torques of no joint",
            names=first_names(state.unplaced, _MOST_NAMED),
            joints=first_names(may_be, _MOST_NAMED, by=" or "),
            joint=may_be[0],
            column=state.unplaced[0],
        )


def _ask_for_base(state: Guessing) -> None:
    """How a base that is free was carried, where neither contacts nor the robot's description tell."""
    found, machine, robot = state.found, state.machine, state.machine.robot
    carried = found.of("contact") or found.of("wrench")
    if "base" in state.mapping.log or (carried and (found.of("base") or found.of("imu"))):
        return
    if tells_contacts(found.channels, machine, state.mapping.log):
        return
    feet = [] if robot is None else [foot.name for foot in robot.feet]
    if found.of("base"):
        loads = {"tau", "i"} & found.channels and state.mapping.log.get("torque") != "none"
        # A pose alone does not say whether a robot stands on its feet, whose forces are then in its torques, or hangs.
        if loads and feet and robot is not None and robot.description.base == "floating":
            found.ask("contacts", robot=machine.name, feet=", ".join(feet), foot=feet[0])
        return
    stands = [
        f'; of a robot that stands, columns: {{contact.{foot}: "NAME", …}}, 1 where a foot carries'
        for foot in feet
    ]
    imu = any(column.channel == "imu" for column in state.recording.columns)
    link = machine.base_link
    hangs = f"; of a robot that hangs, log: {{base: suspended, base_link: {link}, imu: {{link: {link}}}}}"
    found.ask(
        "base",
        robot=machine.name,
        stands=stands[0] if stands and found.of("imu") else "",
        hangs=hangs if imu else "",
    )


def _convert(state: Guessing) -> None:
    scaling = Scaling(state.found, state.recording, state.machine, state.mapping, state.clues, state.values)
    state.found.mapped = scaling.convert()


def _name_unused(state: Guessing) -> None:
    found, clues = state.found, state.clues
    known = {item.joint for item in found.of("q")}
    absent = [joint for joint in state.joints if joint not in known]
    if known and absent:
        found.note("joints without positions", joints=", ".join(absent))
    found.unused = [name for name in state.values if name not in state.used]
    found.lost = [c for c in found.unused if c in state.live and c in clues and is_of_joints(clues[c])]


RULES = (
    Rule("names", "what every column's name or format says: clues", _read_names),
    Rule("map", "columns that a map states: channels, and joints of the labels they share", _take_stated),
    Rule("clock", "the times of every stream and their unit; a rate is asked for", _find_clocks),
    Rule(
        "base",
        "pose, IMU and contacts of what moves freely, by their names",
        lambda s: add_base_signals(
            s.found,
            s.recording,
            [name for name in s.clues if name not in s.used],
            feet_of(s.found, s.machine, s.mapping),
        ),
        lambda s: s.machine.floating,
    ),
    Rule("families", "columns of one quantity of all joints", _group_by_quantity),
    Rule("stated joints", "joints of which the map states another column", _leave_stated),
    Rule("axes", "axes that are called by the letter of accelerations: positions", _take_axes),
    Rule("no measurements", "unfilled fields, forces of feet, tools and load cells: left out", _leave_out),
    Rule(
        "own base", "the base's part of arrays of joints: its pose", _leave_base, lambda s: s.machine.floating
    ),
    Rule(
        "choice",
        "the family of each channel",
        lambda s: s.chosen.update(choose_families(s.groups, s.found, s.recording, s.joints)),
    ),
    Rule(
        "followers",
        "positions without names that follow commands",
        _find_followers,
        lambda s: "q_cmd" in s.chosen and "q" not in s.known | set(s.chosen),
    ),
    Rule("torques", "which torques were measured, and of which joints", _settle_torques),
    Rule("commands", "commands that state no quantity: positions or torques", _settle_commands),
    Rule("doubtful choice", "surplus columns and joints that are not told: questions", _note_choice),
    Rule("channels", "channels of the chosen families", _add_channels),
    Rule(
        "rate",
        "the rate that velocities tell",
        _propose_rate,
        lambda s: any(question.key == "rate" for question in s.found.questions),
    ),
    Rule(
        "base by format",
        "what a format says of the base and of contact wrenches: channels",
        lambda s: add_base(s.found, s.recording, s.left, s.machine, s.mapping),
    ),
    Rule("lacking motion", "positions that no column holds: questions", _ask_for_motion),
    Rule(
        "lacking torques",
        "torques that nothing tells: questions",
        _ask_for_torques,
        # Torques or currents are there, or a map says that there are none.
        lambda s: not ({"tau", "i"} & s.found.channels or "torque" in s.mapping.log),
    ),
    Rule("lacking base", "how the base was carried: a question", _ask_for_base, lambda s: s.machine.floating),
    Rule(
        "units",
        "factors to SI units, zeros and signs",
        _convert,
        lambda s: bool(s.found.of("q")) and not s.found.questions,
    ),
    Rule("unused", "columns that nothing was made of", _name_unused),
)
"""What :func:`guess_columns` does, in its order."""
