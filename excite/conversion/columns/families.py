"""Columns of one recording as families, one quantity of all joints each, and which of several a channel is made of."""

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
    match_labels,
    place_columns,
    with_words_of_joints,
)
from excite.conversion.columns.vocabulary import ASIDE, KNOWN, MEASURED, OF_MOTOR, OF_WORD, SURELY_MEASURED
from excite.conversion.columns.words import Clue, read_clue, with_joints_numbers
from excite.conversion.guesses import Guesses
from excite.conversion.recording import Column, Recording, Stream, live_columns
from excite.logs.units import QUANTITY_OF_UNIT, unit_named

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
_QUANTITIES = {target: key for key, target in TARGETS.items()}
POSE_AXES = {"wxyz": ("qw", "qx", "qy", "qz"), "xyzw": ("qx", "qy", "qz", "qw")}
# Numbers of a free base's pose and twist before its joints'.
POSE, _TWIST = 7, 6


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
    unit: str = ""
    stated: bool = False
    stem: str = ""

    @property
    def words(self) -> frozenset[str]:
        """Words that its names have in common."""
        return frozenset(self.stem.split("_"))

    @property
    def first(self) -> str:
        """How it is called in sentences."""
        return f"{self.columns[0]} …"

    @property
    def says_quantity(self) -> bool:
        """Whether format, names or units say what it is: a joint's name alone may be anything's."""
        word = any(OF_WORD.get(word) == self.quantity for word in self.words)
        return self.stated or word or QUANTITY_OF_UNIT.get(self.unit) == self.quantity

    @property
    def side(self) -> tuple[bool, bool, bool]:
        """Whether it says its quantity, that it was measured, and that it is of the links of elastic joints."""
        return self.says_quantity, bool(self.words & SURELY_MEASURED), not self.words & OF_MOTOR

    def also(self, more: Family) -> Family:
        """The family with the columns of another one, of other joints; joints of both are known by their names."""
        because = self.placed.because if self.placed.because == more.placed.because else BY_WORDS
        placed = Placed(
            self.placed.columns | more.placed.columns,
            because,
            self.placed.left_over + more.placed.left_over,
            self.placed.doubts + more.placed.doubts,
            named=True,
        )
        unit = self.unit if self.unit == more.unit else ""
        return replace(self, placed=placed, columns=self.columns + more.columns, unit=unit)

    def is_beside(self, other: Family) -> bool:
        """Whether both are known by joints' names, and none of them is in both."""
        named = self.placed.named and other.placed.named
        return named and not self.placed.columns.keys() & other.placed.columns.keys()

    def line(self, joints: Sequence[str], channel: str = "") -> str:
        """What a map would say under ``columns`` to take it, for its own channel or another one."""
        channel = channel or self.target
        sources = {f"{channel}.{joint}": column for joint, column in self.placed.columns.items()}
        return ", ".join(f'{key}: "{column}"' for key, column in columns_of(channel, sources, joints).items())


def clues_of(recording: Recording, joints: Sequence[str], ignored: Iterable[str] = ()) -> dict[str, Clue]:
    """What the name of every column says, or its format."""
    names = {column.name for column in recording.columns} - set(ignored)
    spelt = (
        {name: name for name in names}
        | {
            name: f"{before}{1 + ascii_lowercase.index(letter)}{after}"
            for (before, after), by_letter in _alike_but_for(
                names, r"(?<![A-Za-z])[A-Za-z](?![A-Za-z0-9])"
            ).items()
            if len(by_letter) > 1 and sorted(by_letter) == list(ascii_lowercase[: len(by_letter)])
            for letter, name in by_letter.items()
        }
        | _name_labels(names, joints)
    )
    found = _clues(recording, joints, spelt, frozenset())
    letters = frozenset(word for said in found.values() for word in said.label.split("_") if len(word) == 1)
    if letters:
        found = _clues(recording, joints, spelt, letters)
    found = with_joints_numbers(with_words_of_joints(found, joints))
    # Of one quantity and joint in units of several quantities each is of its unit's: ang_deg_s beside ang_deg.
    groups: dict[tuple[object, ...], list[str]] = {}
    for name, said in found.items():
        key = (said.quantity, said.label, said.numbers, said.exact, said.commanded)
        groups.setdefault(key, []).append(name)
    for (quantity, *_), alike in groups.items():
        of_units = {name: QUANTITY_OF_UNIT.get(found[name].unit, "") for name in alike}
        # What states no unit is of the quantity that its name says.
        if {quantity, ""} & set(of_units.values()):
            own = {name: of for name, of in of_units.items() if of not in ("", "time")}
            found |= {name: replace(found[name], quantity=of) for name, of in own.items()}
    return found


def _alike_but_for(names: Iterable[str], word: str) -> dict[tuple[str, str], dict[str, str]]:
    """Names that differ in nothing but one word, by what stands before and behind it, each by its own, lower case."""
    groups: dict[tuple[str, str], dict[str, str]] = {}
    for name in names:
        for match in re.finditer(word, name):
            groups.setdefault((name[: match.start()], name[match.end() :]), {})[match[0].lower()] = name
    return groups


def _name_labels(names: Iterable[str], joints: Sequence[str]) -> dict[str, str]:
    """Names with the whole joint for a word that would mean something else: ``ang_sp`` beside ``ang_sl``, ``ang_w1``.

    Names that differ in nothing but one word are of a joint each where these words, all of them, tell the joints.
    """
    found = {}
    for (before, after), by_word in _alike_but_for(names, r"[A-Za-z]{2,}\d*|[A-Za-z]\d+").items():
        known = len(by_word.keys() & KNOWN)
        if len(by_word) == len(joints) and 0 < known <= len(by_word) / 2:
            placed = match_labels(list(by_word), joints)
            for joint, word in ({} if placed is None or placed.left_over else placed.columns).items():
                found[by_word[word]] = f"{before}{joint}{after}"
    return found


def _clues(
    recording: Recording, joints: Sequence[str], spelt: Mapping[str, str], letters: frozenset[str]
) -> dict[str, Clue]:
    """What every name or format says as it is spelt, where these letters stand for joints."""
    found: dict[str, Clue] = {}
    for stream in recording.streams:
        for column in stream.columns:
            if column.name not in spelt:
                continue
            name = spelt[column.name].removeprefix(f"{stream.name}/")
            found[column.name] = _column_clue(replace(column, name=name), joints, letters)
            if len(recording.streams) > 1:
                found[column.name] = _of_its_stream(found[column.name], stream, joints)
    return found


def _of_its_stream(said: Clue, stream: Stream, joints: Sequence[str]) -> Clue:
    """What a column is in a topic or file that is called torque (``data[3]``), or after a joint (``/elbow/torque``)."""
    whole, of_joint = read_clue(stream.name, ()), read_clue(stream.name, joints)
    bare = said.number is not None and not _says_a_quantity(said)
    if bare and _says_a_quantity(whole) and whole.quantity != "time":
        stem = f"{whole.stem}_{said.stem}"
        said = replace(said, quantity=whole.quantity, commanded=whole.commanded, stem=stem)
    joint_known = said.exact or said.number is not None or said.quantity in ("time", "skip")
    if not of_joint.exact or joint_known:
        return said
    if said.quantity == "" and _says_a_quantity(of_joint):
        return replace(of_joint, unit=said.unit or of_joint.unit)
    return replace(said, exact=of_joint.exact, label=of_joint.label)


def _column_clue(column: Column, joints: Sequence[str], letters: frozenset[str]) -> Clue:
    """What a column's format says of it, else its name, and of its joint the name that stands beside it."""
    prefix, _, rest = column.name.rpartition("/")[2].partition(".")
    channel, label = column.channel, column.label
    if not channel and rest in joints and prefix in _QUANTITIES:
        channel, label = prefix, rest
    inner = read_clue(label, joints) if label else None
    if channel:
        quantity, commanded = _QUANTITIES.get(channel, (channel, False))
        unit = unit_named(column.unit) or column.unit
        number, exact = None if inner is None else inner.number, label if label in joints else ""
        return Clue(quantity, commanded, number, label, unit, exact, stem=channel)
    said = read_clue(column.name, joints, column.unit, letters)
    if inner is None or not (inner.exact or inner.label or inner.quantity or inner.number is not None):
        return said
    if not _says_a_quantity(said) and _says_a_quantity(inner):
        # Columns of one array, each with a name that says all: time, q1, tau1, elbow_pos, elbow_frc …
        return inner
    return replace(said, exact=inner.exact, label=inner.label, number=inner.number)


def _says_a_quantity(said: Clue) -> bool:
    return said.quantity != "" and any(OF_WORD.get(word) for word in said.stem.split("_"))


def find_families(recording: Recording, clues: dict[str, Clue], joints: Sequence[str]) -> list[Family]:
    """Families among the columns, those of more joints first."""
    groups: dict[tuple[str, str, bool, str], list[Column]] = {}
    for stream in recording.streams:
        for column in stream.columns:
            said = clues.get(column.name)
            if (
                said is not None
                and said.quantity in OF_WORD.values()
                and said.quantity not in ("time", "skip")
            ):
                # Labels of joints differ within a family; the stem is what is left of the quantity's own words.
                stem = "_".join(w for w in said.stem.split("_") if w not in said.label.split("_"))
                groups.setdefault((stream.name, said.quantity, said.commanded, stem), []).append(column)
    first, live = first_number(list(clues.values())), live_columns(recording)
    found: list[Family] = []
    for (_, quantity, commanded, stem), several in groups.items():
        for columns in _by_machine(several, clues, joints, first):
            names = [column.name for column in columns]
            units = {clues[name].unit for name in names}
            placed = place_columns(names, clues, joints, first, frozenset(names) - live)
            target, stated = TARGETS.get((quantity, commanded), ""), all(column.channel for column in columns)
            unit = units.pop() if len(units) == 1 else ""
            family = Family(target, quantity, placed, tuple(names), unit, stated, stem)
            # A topic or file a joint, or one for the arm and one for a hand: joints have to be known by their names,
            # as numbers begin anew in each stream.
            key = (family.target, family.quantity, family.stem, family.stated)
            at = next(
                (k for k, f in enumerate(found) if (f.target, f.quantity, f.stem, f.stated) == key), None
            )
            if at is not None and target and family.is_beside(found[at]):
                found[at] = found[at].also(family)
            else:
                found.append(family)
    return sorted(
        found, key=lambda f: (-len(f.placed.columns), not f.stated, *(not s for s in f.side), len(f.stem))
    )


def _by_machine(
    columns: list[Column], clues: dict[str, Clue], joints: Sequence[str], first: int
) -> list[list[Column]]:
    """Columns apart by words beside the joints' names or numbers where these stand twice, as of two arms or copies of
    some, and the robot's joints have no such words."""
    said = [clues[column.name] for column in columns]
    numbers = [one.exact for one in said] if all(one.exact for one in said) else [one.number for one in said]
    sizes = set(Counter(one.label for one in said).values())
    once = len(set(numbers)) == len(numbers) or None in numbers
    apart = len(joints) in sizes or (len(sizes) == 1 and min(sizes) > 1)
    if (
        once
        or not apart
        or not place_columns([column.name for column in columns], clues, joints, first).left_over
    ):
        return [columns]
    machines: dict[str, list[Column]] = {}
    for column, one in zip(columns, said, strict=True):
        machines.setdefault(one.label, []).append(column)
    return list(machines.values())


def is_anonymous(family: Family, joints: Sequence[str]) -> bool:
    """Whether nothing but a number says that these are positions, as of ``state[3]``, and there are not one a joint."""
    named = family.stated or any(OF_WORD.get(word) for word in family.words)
    numbered = family.placed.because.startswith("its number")
    return family.quantity == "q" and numbered and not named and len(family.columns) > len(joints)


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
    numbers = {"{n}": 1, "{n0}": 0}
    for mark in ("{joint}", *numbers):
        words = {
            joint: str(k + numbers[mark]) if mark in numbers else joint for k, joint in enumerate(joints)
        }
        column = by_joint[joints[0]]
        for match in re.finditer(re.escape(words[joints[0]]), column):
            pattern = column[: match.start()] + mark + column[match.end() :]
            if all(by_joint[joint] == pattern.replace(mark, word) for joint, word in words.items()):
                return {channel: pattern}
    return dict(sources)


def is_quaternion(values: Array) -> bool:
    """Whether four columns hold a quaternion in every row that has numbers; ``(n, 4)``."""
    norms = np.linalg.norm(values, axis=1)
    return bool(np.isfinite(norms).any() and np.allclose(norms[np.isfinite(norms)], 1.0, atol=1e-2))


def quaternion_order(quaternion: Array) -> str | None:
    """``wxyz`` or ``xyzw`` by which end is larger, as of a robot that is turned about one axis; None for neither."""
    first, last = (float(np.nanmedian(np.abs(quaternion[:, k]))) for k in (0, 3))
    # A robot that stands or walks is turned about one axis, up: the cosine of half that angle is the larger by far.
    return "wxyz" if first > 2.0 * last else "xyzw" if last > 2.0 * first else None


def without_base_columns(family: Family, joints: Sequence[str]) -> Family:
    """A family without its base's columns where it has as many more as a base has."""
    base = POSE if family.quantity == "q" else _TWIST
    if len(family.columns) - len(joints) != base or family.quantity not in ("q", "v", "a", "tau"):
        return family
    columns = family.columns[base:]
    placed = Placed(dict(zip(joints, columns, strict=True)), "the columns' order, after the base's")
    return replace(family, columns=columns, placed=placed)


# Rivals that differ by less than this share of what they vary by are one signal, logged twice: positions of an arm at
# 100 Hz whose two topics are stamped 5 ms apart differ by 1.4 % at the most, a motor's and a link's torques by 10 %.
_SAME = 0.02
# Median over the joints of the correlation with what was measured. In 60 drawn motions of three arms (3 to 20 s),
# positions that were asked for 10 to 90 ms before correlate by 0.94 or more with those measured, torques with positions
# by 0.00 at the most; robots under weak gains follow worse, so the line is drawn between.
FOLLOWED = 0.5


def choose_families(
    groups: Sequence[Family], found: Guesses, recording: Recording, joints: Sequence[str]
) -> dict[str, Family]:
    """The family for each channel: of several the one with the most joints; rivals as good are asked about.

    Rivals are none where one's topic or table is called by what is no measurement (external, desired …), or where
    both hold the same values. Of torques and currents those columns count that are not the same in every row.
    """
    parts: dict[str, list[Family]] = {}
    chosen: dict[str, Family] = {}
    live = live_columns(recording)
    for family in sorted(groups, key=lambda one: _is_aside(one, recording)):
        target = family.target
        if not target or not family.placed.columns:
            continue
        if target not in chosen:
            chosen[target], parts[target] = family, [family]
            continue
        other = chosen[target]
        if family.is_beside(other) and family.side[1:] == other.side[1:]:
            # A gantry's slides have forces, and its turning axis a torque.
            chosen[target] = other.also(family)
            parts[target].append(family)
            continue
        # What stands beside other joints' columns is a rival of what is chosen of the same joints.
        of_joints = _joints(family, live)
        rival = next((one for one in parts[target] if _joints(one, live) == of_joints), other)
        # No word says which was measured of columns that are called after a joint alone: act may be an action.
        silent = not (family.says_quantity or rival.says_quantity)
        alike = len(of_joints) == len(_joints(rival, live)) and (silent or family.side == rival.side)
        if (
            not alike
            or target not in ("q", "tau", "i")
            or _is_aside(family, recording) != _is_aside(rival, recording)
        ):
            continue
        if _are_same(family, rival, recording):
            found.note("same values", channel=target, columns=rival.first, others=family.first)
        elif not _told_by_a_word(found, chosen, family, rival):
            _ask_which(found, rival, family, joints)
    return chosen


def _ask_which(found: Guesses, first: Family, other: Family, joints: Sequence[str]) -> None:
    """Which of two families a channel is, or which of more."""
    before = next((q for q in found.questions if q.key == "rivals" and first.line(joints) in q.line), None)
    if before is None:
        found.ask(
            "rivals", channel=first.target, columns=first.first, others=other.first, line=first.line(joints)
        )
    else:
        what = f"{before.what} or {other.first}"
        found.questions[found.questions.index(before)] = replace(before, what=what)


def _told_by_a_word(found: Guesses, chosen: dict[str, Family], one: Family, other: Family) -> bool:
    """Whether one of two rivals is none by its name; the other one is chosen then.

    ``q_current`` beside a position is an electric current, where ``current_position`` says when; and
    ``joint_actual_position`` stands beside the tool's ``actual_position``.
    """
    current = [f.quantity == "q" and f.stem.split("_")[-1] == "current" for f in (one, other)]
    of_joint = [bool({"joint", "joints", "jnt", "axis", "axes"} & f.words) for f in (one, other)]
    if current[0] != current[1]:
        left, taken = (one, other) if current[0] else (other, one)
        chosen.setdefault("i", replace(left, target="i", quantity="i"))
        found.note("electric current", channel=taken.target, columns=taken.first, others=left.first)
    elif of_joint[0] != of_joint[1]:
        left, taken = (other, one) if of_joint[0] else (one, other)
        found.note("not of joints", channel=taken.target, columns=taken.first, others=left.first)
    else:
        return False
    chosen[taken.target] = taken
    return True


def _joints(family: Family, live: Container[str]) -> set[str]:
    """Joints of which a family holds something: of torques and currents what is not the same in every row."""
    loads = family.target in ("tau", "i")
    return {joint for joint, column in family.placed.columns.items() if not loads or column in live}


def _stream_of(family: Family, recording: Recording) -> Stream:
    return next(s for s in recording.streams if any(c.name == family.columns[0] for c in s.columns))


def _is_aside(family: Family, recording: Recording) -> bool:
    """Whether the stream of a family is called by what is no measurement of the joints, where there are others."""
    if len(recording.streams) < 2:
        return False
    said = read_clue(_stream_of(family, recording).name, ())
    words = set(said.stem.split("_"))
    return bool(words & ASIDE) or (said.commanded and not words & MEASURED)


def _are_same(one: Family, other: Family, recording: Recording) -> bool:
    """Whether two families hold the same values of every joint, at the times that their streams have in common."""
    first, second = _stream_of(one, recording), _stream_of(other, recording)
    a_of, b_of = ({c.name: c.values for c in stream.columns} for stream in (first, second))
    if one.placed.columns.keys() != other.placed.columns.keys():
        return False
    for joint, name in one.placed.columns.items():
        a, b = a_of.get(name), b_of.get(other.placed.columns[joint])
        if a is None or b is None:
            return False
        if first is not second:
            there = np.isfinite(b)
            if first.time is None or second.time is None or not there.any():
                return False
            order = np.argsort(second.time[there], kind="stable")
            b = np.interp(first.time, second.time[there][order], b[there][order], left=np.nan, right=np.nan)
        whole = np.isfinite(a) & np.isfinite(b)
        if whole.sum() < len(a) / 2 or np.sqrt(np.mean((a - b)[whole] ** 2)) > _SAME * np.std(a[whole]):
            return False
    return True


def command_agreement(one: Family, other: Family, columns: Mapping[str, Array]) -> float | None:
    """Median over the joints of the correlation; None where they are of different times, or stand still."""
    joints = one.placed.columns.keys() & other.placed.columns.keys()
    pairs = [(columns[one.placed.columns[j]], columns[other.placed.columns[j]]) for j in joints]
    if any(len(a) != len(b) for a, b in pairs):
        return None
    values = [value for a, b in pairs if (value := _correlation(a, b)) is not None]
    return float(np.median(values)) if values else None


def is_followed(command: Family, position: Family, columns: Mapping[str, Array]) -> bool:
    """Whether positions do as a command asks: they resemble it, or move towards it a few rows later.

    A servo that is asked for more than it can do turns towards its target as fast as it can, which is proportional
    to, or has the sign of, what is left to go.
    """
    alike = command_agreement(command, position, columns)
    if alike is None or alike >= FOLLOWED:
        return True
    towards = []
    for joint in command.placed.columns.keys() & position.placed.columns.keys():
        asked, is_at = columns[command.placed.columns[joint]], columns[position.placed.columns[joint]]
        left, step = (asked - is_at)[:-1], np.diff(is_at)
        # A hobby servo at 50 Hz answers 4 rows after it was asked.
        late = (_correlation(left[: len(left) - rows], step[rows:]) or 0.0 for rows in range(8))
        towards.append(max(late))
    return bool(towards) and float(np.median(towards)) >= FOLLOWED


def _correlation(a: Array, b: Array) -> float | None:
    """Of the rows in which both are numbers; None where one of them stands still."""
    whole = np.isfinite(a) & np.isfinite(b)
    if whole.sum() <= 2 or np.ptp(a[whole]) == 0.0 or np.ptp(b[whole]) == 0.0:
        return None
    return float(np.corrcoef(a[whole], b[whole])[0, 1])
