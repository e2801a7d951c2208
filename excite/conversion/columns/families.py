"""Columns of one recording as families: one quantity of all joints, measured or commanded."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from string import ascii_lowercase

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.joints import (
    BY_WORDS,
    Placed,
    first_number,
    place_columns,
    with_words_of_joints,
)
from excite.conversion.columns.vocabulary import OF_MOTOR, OF_WORD, SURELY_MEASURED
from excite.conversion.columns.words import Clue, read_clue, with_joints_numbers
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.recording import Column, Recording, live_columns
from excite.logs.units import QUANTITY_OF_UNIT, unit_named

# Columns of one recording as families: a quantity of all joints, measured or commanded.

# What a log folder has a channel for, by quantity and whether it was commanded.
TARGETS = {
    ("q", False): "q",
    ("q", True): "q_cmd",
    ("v", False): "v",
    ("a", False): "a",
    ("tau", False): "tau",
    ("tau", True): "tau_cmd",
    ("i", False): "i",
}
# Stream, quantity, whether commanded, stem.
_Group = tuple[str, str, bool, str]
_STATED = {"q_cmd": ("q", True), "tau_cmd": ("tau", True)}


@dataclass(frozen=True)
class Family:
    """Columns that hold one quantity.

    Attributes:
        target: channel of the log, empty for what a log has no channel for.
        quantity: ``q``, ``v``, ``a``, ``tau``, ``i``, ``volt``.
        placed: its columns by joint.
        columns: all its columns.
        unit: as its names state it, empty for none.
        stated: whether the format says what it is.
        stem: what its names have in common.
    """

    target: str
    quantity: str
    placed: Placed
    columns: tuple[str, ...]
    unit: str
    stated: bool
    stem: str


def clues_of(recording: Recording, joints: Sequence[str], ignored: Iterable[str] = ()) -> dict[str, Clue]:
    """What the name of every column says, or its format."""
    left_out = set(ignored)
    plain = _clues(recording, joints, left_out, frozenset())
    letters = frozenset(word for said in plain.values() for word in said.label.split("_") if len(word) == 1)
    found = _clues(recording, joints, left_out, letters) if letters else plain
    return _by_units(with_joints_numbers(with_words_of_joints(found, joints)))


def _clues(
    recording: Recording, joints: Sequence[str], left_out: Container[str], letters: frozenset[str]
) -> dict[str, Clue]:
    """What every name or format says, where these letters stand for joints."""
    found: dict[str, Clue] = {}
    for stream in recording.streams:
        of_stream = read_clue(stream.name, ()) if len(recording.streams) > 1 else None
        of_joint = read_clue(stream.name, joints) if len(recording.streams) > 1 else None
        for column in stream.columns:
            if column.name not in left_out:
                said = _column_clue(
                    replace(column, name=column.said_as.removeprefix(f"{stream.name}/")), joints, letters
                )
                said = said if of_stream is None else _as_its_stream(said, of_stream)
                found[column.name] = said if of_joint is None else _of_its_joint(said, of_joint)
    return found


def with_numbers_for_letters(recording: Recording) -> Recording:
    """The recording, letters that count columns read as numbers: ``torque_a`` … ``torque_f`` as ``torque_1`` …

    They are letters where names differ in nothing but one that stands alone, and go from the first one of the alphabet.
    """
    names = [column.name for stream in recording.streams for column in stream.columns]
    groups: dict[str, dict[str, tuple[str, str]]] = {}
    for name in names:
        for match in re.finditer(r"(?<![A-Za-z])[A-Za-z](?![A-Za-z0-9])", name):
            rest = f"{name[: match.start()]}\0{name[match.end() :]}"
            number = f"{name[: match.start()]}{ord(match[0].lower()) - ord('a') + 1}{name[match.end() :]}"
            groups.setdefault(rest, {})[match[0].lower()] = (name, number)
    said: dict[str, str] = {}
    for by_letter in groups.values():
        if len(by_letter) > 1 and sorted(by_letter) == list(ascii_lowercase[: len(by_letter)]):
            said |= dict(by_letter.values())
    if not said:
        return recording
    streams = [
        replace(s, columns=tuple(replace(c, spelt=said.get(c.name, "")) for c in s.columns))
        for s in recording.streams
    ]
    return replace(recording, streams=tuple(streams))


def _by_units(clues: dict[str, Clue]) -> dict[str, Clue]:
    """The clues; of columns of one quantity and joint whose units are of several quantities, each of its unit's.

    ``ang_deg_s`` beside ``ang_deg`` is the angle's rate.
    """
    groups: dict[tuple[object, ...], list[str]] = {}
    for name, said in clues.items():
        key = (said.quantity, said.label, said.numbers, said.exact, said.commanded)
        groups.setdefault(key, []).append(name)
    found = dict(clues)
    for (quantity, *_), names in groups.items():
        of_units = {name: QUANTITY_OF_UNIT.get(clues[name].unit, "") for name in names}
        # What states no unit is of the quantity that its name says.
        if quantity in of_units.values() or "" in of_units.values():
            found |= {
                n: replace(clues[n], quantity=of) for n, of in of_units.items() if of not in ("", "time")
            }
    return found


def find_families(recording: Recording, clues: dict[str, Clue], joints: Sequence[str]) -> list[Family]:
    """Families among the columns, those of more joints first."""
    groups: dict[_Group, list[Column]] = {}
    for stream in recording.streams:
        for column in stream.columns:
            said = clues.get(column.name)
            if said is None or said.quantity in ("", "time", "skip", "base", "wrench", "imu", "contact"):
                continue
            # Labels of joints differ within a family; the stem is what is left of the quantity's own words.
            stem = _family_stem(said)
            groups.setdefault((stream.name, said.quantity, said.commanded, stem), []).append(column)
    first, live = first_number(list(clues.values())), live_columns(recording)
    found = []
    for (_, quantity, commanded, stem), columns in _one_machine_each(groups, clues, joints, first):
        names = [column.name for column in columns]
        units = [clues[name].unit for name in names]
        found.append(
            Family(
                target=TARGETS.get((quantity, commanded), ""),
                quantity=quantity,
                placed=place_columns(names, clues, joints, first, frozenset(names) - live),
                columns=tuple(names),
                unit=units[0] if len(set(units)) == 1 else "",
                stated=all(column.channel for column in columns),
                stem=stem,
            )
        )
    return sorted(
        _across_streams(found),
        key=lambda family: (
            -len(family.placed.columns),
            not family.stated,
            not says_quantity(family),
            not is_measured(family),
            of_motor(family),
            len(family.stem),
        ),
    )


def _across_streams(found: Sequence[Family]) -> list[Family]:
    """The families, those of other joints put together: a topic or file a joint, or one for the arm and one for a hand.

    Joints have to be known by their names: numbers begin anew in each stream. What a lift's force is called, and its
    unit, differ from the torques beside it; which column has which unit is told one by one.
    """
    merged: dict[tuple[str, str, str, bool], Family] = {}
    others: list[Family] = []
    for family in found:
        key = (family.target, family.quantity, family.stem, family.stated)
        before = merged.get(key)
        by_name = family.placed.named and family.target != ""
        if before is None and by_name:
            merged[key] = family
        elif before is None or not by_name or before.placed.columns.keys() & family.placed.columns.keys():
            others.append(family)
        else:
            merged[key] = with_others(before, family)
    return [*merged.values(), *others]


def with_others(family: Family, more: Family) -> Family:
    """A family with the columns of another one, of other joints; joints of both are known by their names."""
    both = family.placed.columns | more.placed.columns
    left = family.placed.left_over + more.placed.left_over
    because = family.placed.because if family.placed.because == more.placed.because else BY_WORDS
    return replace(
        family,
        placed=Placed(both, because, left, family.placed.doubts + more.placed.doubts, named=True),
        columns=family.columns + more.columns,
        unit=family.unit if family.unit == more.unit else "",
    )


def _one_machine_each(
    groups: dict[_Group, list[Column]], clues: dict[str, Clue], joints: Sequence[str], first: int
) -> Iterable[tuple[_Group, list[Column]]]:
    """The groups, apart by words beside the joints' names or numbers where these stand twice, as of two arms, and the
    robot's joints have no such words."""
    for key, columns in groups.items():
        said = [clues[column.name] for column in columns]
        numbers = (
            [one.exact for one in said] if all(one.exact for one in said) else [one.number for one in said]
        )
        sizes = set(Counter(one.label for one in said).values())
        once = len(set(numbers)) == len(numbers) or None in numbers
        names = [column.name for column in columns]
        alone = once or len(sizes) > 1 or min(sizes) < 2
        if alone or not place_columns(names, clues, joints, first).left_over:
            yield key, columns
            continue
        machines: dict[str, list[Column]] = {}
        for column in columns:
            machines.setdefault(clues[column.name].label, []).append(column)
        for members in machines.values():
            yield key, members


def is_measured(family: Family) -> bool:
    """Whether its names say that it was measured."""
    return bool(set(family.stem.split("_")) & SURELY_MEASURED)


def says_quantity(family: Family) -> bool:
    """Whether format, names or units say what it is: a joint's name alone may be anything's."""
    word = any(OF_WORD.get(word) == family.quantity for word in family.stem.split("_"))
    return family.stated or word or QUANTITY_OF_UNIT.get(family.unit) == family.quantity


def of_motor(family: Family) -> bool:
    """Whether its names are those of the motors' side of elastic joints."""
    return bool(set(family.stem.split("_")) & OF_MOTOR)


def is_anonymous(family: Family, joints: Sequence[str]) -> bool:
    """Whether nothing but a number says that these are positions, as of ``state[3]``, and there are not one a joint."""
    named = {word for word in family.stem.split("_") if OF_WORD.get(word)}
    numbered = family.placed.because.startswith("its number")
    return (
        family.quantity == "q"
        and numbered
        and not named
        and not family.stated
        and len(family.columns) > len(joints)
    )


def columns_of(channel: str, sources: Mapping[str, str], joints: Sequence[str]) -> dict[str, str]:
    """What a map's ``columns`` say of a channel: one pattern where its columns follow one, else a column a joint.

    Args:
        channel: such as ``q``.
        sources: the column of each target, as ``q.elbow``.
        joints: in the order in which patterns count them.
    """
    by_joint = {target.partition(".")[2]: source for target, source in sources.items()}
    if len(sources) < 2 or set(by_joint) != set(joints):
        return dict(sources)
    for mark, first in (("{joint}", None), ("{n}", 1), ("{n0}", 0)):
        words = {joint: joint if first is None else str(k + first) for k, joint in enumerate(joints)}
        column = by_joint[joints[0]]
        for match in re.finditer(re.escape(words[joints[0]]), column):
            pattern = column[: match.start()] + mark + column[match.end() :]
            if all(by_joint[joint] == pattern.replace(mark, word) for joint, word in words.items()):
                return {channel: pattern}
    return dict(sources)


def columns_line(family: Family, joints: Sequence[str], channel: str = "") -> str:
    """What a map would say under ``columns`` to take a family, for its own channel or another one."""
    channel = channel or family.target
    sources = {f"{channel}.{joint}": column for joint, column in family.placed.columns.items()}
    return ", ".join(f'{key}: "{column}"' for key, column in columns_of(channel, sources, joints).items())


def _as_its_stream(said: Clue, stream: Clue) -> Clue:
    """What a column is whose own name says nothing but a number, such as ``data[3]``, in a topic called torque."""
    if (
        _says_a_quantity(said)
        or not _says_a_quantity(stream)
        or said.number is None
        or stream.quantity == "time"
    ):
        return said
    return replace(
        said, quantity=stream.quantity, commanded=stream.commanded, stem=f"{stream.stem}_{said.stem}"
    )


def _of_its_joint(said: Clue, stream: Clue) -> Clue:
    """What a column is that names no joint, in a topic or file that is called after one: ``/elbow/torque``."""
    if not stream.exact or said.exact or said.number is not None or said.quantity in ("time", "skip"):
        return said
    if said.quantity == "" and _says_a_quantity(stream):
        return replace(stream, unit=said.unit or stream.unit)
    return replace(said, exact=stream.exact, label=stream.label)


def _says_a_quantity(said: Clue) -> bool:
    return said.quantity != "" and any(OF_WORD.get(word) for word in said.stem.split("_"))


def _family_stem(said: Clue) -> str:
    words = said.stem.split("_")
    labels = set(said.label.split("_"))
    return "_".join(word for word in words if word not in labels)


def _column_clue(column: Column, joints: Sequence[str], letters: frozenset[str] = frozenset()) -> Clue:
    prefix, _, rest = column.name.rpartition("/")[2].partition(".")
    channel, label = column.channel, column.label
    if not channel and rest in joints and (prefix, False) in TARGETS | {(key, False): "" for key in _STATED}:
        channel, label = prefix, rest
    if not channel:
        return _with_label(read_clue(column.name, joints, column.unit, letters), label, joints)
    quantity, commanded = _STATED.get(channel, (channel, False))
    inner = read_clue(label, joints)
    return Clue(
        quantity=quantity,
        commanded=commanded,
        number=inner.number,
        label=label,
        unit=unit_named(column.unit) or column.unit,
        exact=label if label in joints else "",
        stem=channel,
    )


def _with_label(said: Clue, label: str, joints: Sequence[str]) -> Clue:
    """What a column's name says, of the joint that the recording names beside it."""
    inner = read_clue(label, joints) if label else None
    if inner is None or not (inner.exact or inner.label or inner.quantity or inner.number is not None):
        return said
    if not _says_a_quantity(said) and _says_a_quantity(inner):
        # Columns of one array, each with a name that says all: time, q1, tau1, elbow_pos, elbow_frc …
        return inner
    return replace(said, exact=inner.exact, label=inner.label, number=inner.number)


# Positions and velocities of a free base before its joints': seven numbers of a pose, or six of a twist.

_POSE, _TWIST = 7, 6
_UNIT = 1e-2
# A robot that stands or walks is turned about one axis, up: the cosine of half that angle is the larger by far.
_LIKELY = 2.0
POSE_AXES = {"wxyz": ("qw", "qx", "qy", "qz"), "xyzw": ("qx", "qy", "qz", "qw")}


def without_base(
    found: Guesses, groups: Sequence[Family], recording: Recording, joints: Sequence[str]
) -> list[Family]:
    """Families with the base's part taken out of those that begin with it; the pose is added to what was found.

    A family does where it is numbered, has seven columns more than there are joints, and the last four of these are a
    quaternion in every row. ``wxyz`` (MuJoCo) and ``xyzw`` (pinocchio) are told apart by which end is larger.
    """
    posed = next((f for f in groups if f.target == "q" and len(f.columns) == _POSE + len(joints)), None)
    if posed is None:
        return list(groups)
    values = {c.name: c.values for stream in recording.streams for c in stream.columns}
    quaternion = np.column_stack([values[name] for name in posed.columns[3:_POSE]])
    if not unit_quaternions(quaternion):
        return list(groups)
    order = quaternion_order(quaternion)
    if order is None:
        found.ask(
            f"{posed.columns[0]} … begins with a pose, and which end of its quaternion is w cannot be told",
            f'columns: {{base.qw: "{posed.columns[3]}", base.qx: "{posed.columns[4]}", …}}',
        )
        return list(groups)
    axes = ("px", "py", "pz", *POSE_AXES[order])
    because = f"seven columns more than joints, four of them a quaternion, {order}"
    if not found.of("base"):
        found.mapped += [
            Mapped(f"base.{axis}", name, 1.0, because)
            for axis, name in zip(axes, posed.columns[:_POSE], strict=True)
        ]
    return [_without_base_columns(family, joints) for family in groups]


def unit_quaternions(values: Array) -> bool:
    """Whether four columns hold a quaternion in every row that has numbers; ``(n, 4)``."""
    norms = np.linalg.norm(values, axis=1)
    return bool(np.isfinite(norms).any() and np.allclose(norms[np.isfinite(norms)], 1.0, atol=_UNIT))


def quaternion_order(quaternion: Array) -> str | None:
    """``wxyz`` or ``xyzw`` by which end is larger, as of a robot that is turned about one axis; None for neither."""
    first, last = (float(np.nanmedian(np.abs(quaternion[:, k]))) for k in (0, 3))
    if first > _LIKELY * last:
        return "wxyz"
    return "xyzw" if last > _LIKELY * first else None


def _without_base_columns(family: Family, joints: Sequence[str]) -> Family:
    """A family without its base's columns where it has as many more as a base has."""
    more = len(family.columns) - len(joints)
    base = _POSE if family.quantity == "q" else _TWIST
    if more != base or family.quantity not in ("q", "v", "a", "tau"):
        return family
    columns = family.columns[base:]
    placed = Placed(dict(zip(joints, columns, strict=True)), "the columns' order, after the base's")
    return replace(family, columns=columns, placed=placed)
