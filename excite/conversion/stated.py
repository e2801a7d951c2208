"""Columns that a map states: patterns expanded, what is not there asked for, single joints beside guessed ones."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from excite.conversion.columns.families import TARGETS, Family
from excite.conversion.columns.words import Clue
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.mapping import Map
from excite.conversion.questions import MOST_NAMED, column_names
from excite.conversion.recording import Recording
from excite.finding import first_names


def add_stated(found: Guesses, recording: Recording, mapping: Map, joints: Sequence[str]) -> None:
    """What a map's ``columns`` say, patterns expanded; columns that are not there are asked for."""
    names = column_names(recording)
    for target, pattern in mapping.columns.items():
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


def without_stated(found: Guesses, groups: Sequence[Family], clues: Mapping[str, Clue]) -> list[Family]:
    """The families without columns of joints of which a map states another column for the same channel."""
    stated = {item.target: item.source for item in found.mapped if item.stated}
    numbers = {clues[source].numbers for source in stated.values() if source in clues} - {()}
    left = []
    for family in groups:
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
    return left


def with_stated_labels(found: Guesses, clues: dict[str, Clue]) -> dict[str, Clue]:
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
