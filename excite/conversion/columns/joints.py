"""Which column of a family belongs to which joint: by names, by numbers, by names that are alike."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from excite.conversion.columns.words import Clue

# How alike two names have to be, as difflib counts, and by how much more than to any other joint's.
_ALIKE, _CLEARLY = 0.45, 0.02
_SHORT = {"l": "left", "r": "right", "fl": "frontleft", "fr": "frontright", "rl": "rearleft", "rr": "rearright",
          "sh": "shoulder", "el": "elbow", "wr": "wrist", "lf": "left", "rt": "right"}  # fmt: skip


# Why a column is a joint's that is called so.
BY_NAME = "the joint's name"


@dataclass(frozen=True)
class Placed:
    """Columns of a family by joint.

    Attributes:
        columns: name of the column by joint.
        because: what placed them.
        left_over: columns that no joint was found for.
    """

    columns: dict[str, str]
    because: str
    left_over: tuple[str, ...] = ()


def place(columns: Sequence[str], clues: dict[str, Clue], joints: Sequence[str], first: int) -> Placed:
    """Joints of a family's columns.

    Args:
        columns: names, in the file's order.
        clues: what every name says.
        joints: the robot's joints, or those that a map states, in order.
        first: the number of the first joint in this recording's names, 0 or 1.
    """
    exact: dict[str, str] = {}
    for column in columns:
        if clues[column].exact:
            exact.setdefault(clues[column].exact, column)
    if exact and len(exact) >= len(columns) / 2:
        rest = [c for c in columns if c not in set(exact.values())]
        missing = [joint for joint in joints if joint not in exact]
        if (
            len(columns) == len(joints)
            and len(rest) == 1
            and columns.index(rest[0]) == joints.index(missing[0])
        ):
            exact[missing[0]] = rest.pop()
        return Placed(exact, BY_NAME, tuple(rest))
    labels = {c: clues[c].label for c in columns}
    numbers = {c: n for c in columns if (n := clues[c].number) is not None}
    distinct = len(set(labels.values())) == len(columns) and all(labels.values()) and len(columns) > 1
    if len(set(numbers.values())) == len(columns) and not (distinct and _alike_at_all(labels, joints)):
        return _by_number(numbers, joints, first)
    return by_likeness(list(columns), {c: _words_of(c, clues[c]) for c in columns}, joints)


def first_number(clues: Sequence[Clue]) -> int:
    """Whether joints are counted from 0 or from 1 in this recording."""
    numbers = [
        clue.number for clue in clues if clue.number is not None and clue.quantity not in ("time", "skip", "")
    ]
    return 0 if numbers and min(numbers) == 0 else 1


def _by_number(numbers: dict[str, int], joints: Sequence[str], first: int) -> Placed:
    """The k-th joint of the robot for number k; of names that end in numbers, the joint with the same one."""
    own = {joint: int(match[1]) for joint in joints if (match := re.search(r"(\d+)\D*$", joint))}
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


def _words_of(column: str, clue: Clue) -> str:
    return f"{clue.label}_{clue.number}" if clue.number is not None else (clue.label or column)


def _alike_at_all(labels: dict[str, str], joints: Sequence[str]) -> bool:
    scores = [max(_likeness(label, joint) for joint in joints) for label in labels.values()]
    return bool(np.median(scores) > _ALIKE)


def by_likeness(columns: list[str], labels: dict[str, str], joints: Sequence[str]) -> Placed:
    """Columns by the joint whose name their label is most like, each joint once; the rest is left over."""
    if len(columns) == len(joints) == 1:
        return Placed({joints[0]: columns[0]}, "the robot has one joint")
    likeness = np.array([[_likeness(labels[c], joint) for joint in joints] for c in columns])
    if len(columns) == len(joints):
        # Names that fit as well in the robot's order as in any other one are in that order: base, shoulder, elbow …
        known = np.where(likeness >= _ALIKE, likeness, 0.0)
        best = known[linear_sum_assignment(-known)]
        if (best == 0.0).any() and np.trace(known) >= best.sum() - _CLEARLY * len(joints):
            return Placed(dict(zip(joints, columns, strict=True)), "its name and the order of the columns")
    rows, places = linear_sum_assignment(-likeness)
    placed, rest = {}, [c for k, c in enumerate(columns) if k not in set(rows.tolist())]
    for row, at in zip(rows, places, strict=True):
        if likeness[row, at] >= _ALIKE:
            placed[joints[at]] = columns[row]
        else:
            rest.append(columns[row])
    return Placed(placed, "its name is most like the joint's", tuple(rest))


def _likeness(label: str, joint: str) -> float:
    """How alike a label and a joint's name are, 0 … 1, words in any order."""
    ours, theirs = (name_words(text) for text in (label, joint))
    if not ours or not theirs:
        return 0.0
    whole = difflib.SequenceMatcher(None, "".join(ours), "".join(theirs)).ratio()
    shared = 2.0 * len(set(ours) & set(theirs)) / (len(set(ours)) + len(set(theirs)))
    return max(whole, shared)


def name_words(text: str) -> list[str]:
    """Words of a joint's or foot's name, short ones written out; empty ones such as ``joint`` left out."""
    text = re.sub(r"([a-z])([A-Z])", r"\1 \2", text)
    words = [word.lower() for word in re.split(r"[^A-Za-z0-9]+|(?<=[A-Za-z])(?=\d)", text) if word]
    return [_SHORT.get(word, word) for word in words if word not in {"joint", "motor", "link", "jnt"}]
