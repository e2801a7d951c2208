"""Which column of a family belongs to which joint: by names, by words of names, by numbers, by their order."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from excite.conversion.columns.naming.book import Book
from excite.conversion.columns.naming.match import BY_NAME, Doubt, Match, match_columns
from excite.conversion.columns.naming.numbers import Name
from excite.conversion.columns.vocabulary import COMMANDED, MEASURED, NOISE, OF_HANDS, OF_WORD
from excite.conversion.columns.words import Clue, name_tokens


@dataclass(frozen=True)
class Placed:
    """Columns of a family by joint.

    Attributes:
        columns: name of the column by joint.
        because: what placed them.
        left_over: columns that no joint was found for.
        doubts: those of them that may be a joint's.
        named: whether names told the joints, rather than numbers or an order.
    """

    columns: dict[str, str]
    because: str
    left_over: tuple[str, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    named: bool = False


def place_columns(
    columns: Sequence[str], clues: dict[str, Clue], joints: Sequence[str], first: int
) -> Placed:
    """Joints of a family's columns.

    Args:
        columns: names, in the file's order.
        clues: what every name says.
        joints: the robot's joints, or those that a map states, in order.
        first: the number of the first joint in this recording's names, 0 or 1.
    """
    columns = _but_hands(columns, joints)
    if len(columns) == len(joints) == 1:
        named = clues[columns[0]].exact == joints[0]
        return Placed({joints[0]: columns[0]}, BY_NAME if named else "the robot has one joint", named=named)
    if found := match_columns(_joint_names_in(columns, clues, joints), joints):
        return Placed(found.placed, found.because, found.left_over, found.doubts, named=True)
    numbers = {c: n for c in columns if (n := clues[c].number) is not None}
    if len(set(numbers.values())) == len(columns):
        return _by_number(numbers, joints, first)
    if len(columns) == len(joints):
        pairs = dict(zip(joints, columns, strict=True))
        own = Book.of(joints).numbers
        # Fingers that are called otherwise, each counted as the robot's are.
        if all(numbers.get(column) == (own[joint] or (None,))[-1] for joint, column in pairs.items()):
            return Placed(pairs, "the order of the columns")
    return Placed({}, "", tuple(columns))


def _but_hands(columns: Sequence[str], joints: Sequence[str]) -> Sequence[str]:
    """Columns without those of hands, where no joint's name has a word of one and others are there."""
    if not OF_HANDS.isdisjoint(word for joint in joints for word in name_tokens(joint)):
        return columns
    return [column for column in columns if OF_HANDS.isdisjoint(name_tokens(column))] or columns


def first_number(clues: Sequence[Clue]) -> int:
    """Whether joints are counted from 0 or from 1 in this recording."""
    numbers = [
        clue.number for clue in clues if clue.number is not None and clue.quantity not in ("time", "skip", "")
    ]
    return 0 if numbers and min(numbers) == 0 else 1


def with_words_of_joints(clues: dict[str, Clue], joints: Sequence[str]) -> dict[str, Clue]:
    """The clues; a name that has nothing but words of joints' names, as a whole joint's name alone, is its position."""
    book = Book.of(joints)
    found = dict(clues)
    for name, said in clues.items():
        words = said.label.split("_")
        if said.quantity or said.unit or not said.label or said.stem != said.label:
            continue
        fits = frozenset(joints).intersection(*(book.exactly(word) for word in words))
        if fits:
            found[name] = replace(said, quantity="q")
    return found


def match_labels(labels: Sequence[str], names: Sequence[str]) -> Match | None:
    """Feet or sensors of labels, as columns' joints; None where no label has a word of one."""
    said = []
    for label in labels:
        tokens = name_tokens(label)
        words = tuple(token for token in tokens if not token.isdigit())
        said.append(Name(label, words, tuple(int(token) for token in tokens if token.isdigit())))
    return match_columns(said, names)


def _joint_names_in(columns: Sequence[str], clues: dict[str, Clue], joints: Sequence[str]) -> list[Name]:
    """Words and numbers of the columns' names that may be joints'.

    A word that can be a quantity's or a filler (``rotation``, ``arm``) is one where a joint's name has it and not all
    columns do.
    """
    vocabulary = Book.of(joints).vocabulary
    tokens = {column: set(name_tokens(column)) for column in columns}
    counted = Counter(token for own in tokens.values() for token in own)
    common = OF_WORD.keys() | COMMANDED | MEASURED | NOISE
    found = []
    for column in columns:
        said = clues[column]
        told = {t for t in tokens[column] & vocabulary if t not in common or counted[t] < len(columns)}
        words = dict.fromkeys([*(word for word in said.label.split("_") if word), *sorted(told)])
        numbers = () if said.number is None else (*said.numbers[:-1], said.number)
        found.append(
            Name(column, tuple(w for label in words for w in name_tokens(label)), numbers, said.exact)
        )
    return found


def _by_number(numbers: dict[str, int], joints: Sequence[str], first: int) -> Placed:
    """The k-th joint of the robot for number k; of names that end in numbers, the joint with the same one."""
    own = {joint: int(last[1]) for joint in joints if (last := re.search(r"(\d+)\D*$", joint))}
    if len(own) == len(joints) == len(set(own.values())) and set(numbers.values()) <= set(own.values()):
        of_number = {number: joint for joint, number in own.items()}
        columns = {of_number[number]: column for column, number in numbers.items()}
        return Placed(columns, "its number, which ends the joint's name")
    placed, rest = {}, []
    order = sorted(numbers, key=lambda column: numbers[column])
    within = all(first <= number < first + len(joints) for number in numbers.values())
    for k, column in enumerate(order):
        # Numbers such as CAN addresses (11, 12 … 21) count by their order only.
        index = numbers[column] - first if within else k
        if 0 <= index < len(joints):
            placed[joints[index]] = column
        else:
            rest.append(column)
    return Placed(placed, f"its number, counted from {first} in the model's order of joints", tuple(rest))
