"""Which column of a family belongs to which joint: by words and numbers that their names share, else by order."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import and_

import numpy as np
from scipy.optimize import linear_sum_assignment

from excite.arrays import Array
from excite.conversion.columns.vocabulary import COMMANDED, MEASURED, NOISE, OF_HANDS, OF_WORD
from excite.conversion.columns.words import Clue, name_tokens

# What joints and motors are called whichever they are.
_EMPTY = frozenset("joint joints motor link jnt axis dof".split())
# Why a column is a joint's that is called so, or of whose name it has words.
BY_NAME = "the joint's name"
BY_WORDS = "the words that its name has in common with the joint's"


@dataclass(frozen=True)
class Doubt:
    """Columns of which it cannot be told which of several joints they are."""

    columns: tuple[str, ...]
    joints: tuple[str, ...]


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


@dataclass(frozen=True)
class Name:
    """What a column or a joint is called.

    Attributes:
        name: as it is written.
        words: that may tell which joint it is.
        numbers: in their order, the joint's own last; empty for none.
        whole: of a column the joint whose whole name stands in it, empty for none; of a joint all its words together.
    """

    name: str
    words: tuple[str, ...]
    numbers: tuple[int, ...] = ()
    whole: str = ""


def place_columns(
    columns: Sequence[str],
    clues: dict[str, Clue],
    joints: Sequence[str],
    first: int,
    silent: Collection[str] = (),
) -> Placed:
    """Joints of a family's columns.

    Args:
        columns: names, in the file's order.
        clues: what every name says.
        joints: the robot's joints, or those that a map states, in order.
        first: the number of the first joint in this recording's names, 0 or 1.
        silent: columns that never change, which speak for nothing beside others.
    """
    # Without those of hands, where no joint's name has a word of one and others are there.
    if OF_HANDS.isdisjoint(word for joint in joints for word in name_tokens(joint)):
        columns = [column for column in columns if OF_HANDS.isdisjoint(name_tokens(column))] or columns
    if len(columns) == len(joints) == 1:
        named = clues[columns[0]].exact == joints[0]
        return Placed({joints[0]: columns[0]}, BY_NAME if named else "the robot has one joint", named=named)
    if found := match_columns(_names_of_columns(columns, clues, joints), joints):
        return found
    numbers = {column: n for column in columns if (n := clues[column].number) is not None}
    distinct = len(set(numbers.values())) == len(numbers)
    # One number for each joint; what has none beside them is no joint's.
    one_each = set(numbers.values()) == set(range(first, first + len(joints))) and set(numbers) - set(silent)
    if distinct and (len(numbers) == len(columns) or one_each):
        placed = _place_by_number(numbers, joints, first)
        return replace(placed, left_over=(*placed.left_over, *(c for c in columns if c not in numbers)))
    pairs = zip(columns, own_names(joints), strict=False)
    # Fingers that are called otherwise, each counted as the robot's are.
    if len(columns) == len(joints) and all(
        numbers.get(c) == (own.numbers or (None,))[-1] for c, own in pairs
    ):
        return Placed(dict(zip(joints, columns, strict=True)), "the order of the columns")
    return Placed({}, "", tuple(columns))


def match_labels(labels: Sequence[str], names: Sequence[str]) -> Placed | None:
    """Feet or sensors of labels, as columns' joints; None where no label has a word of one."""
    return match_columns([_split(label, name_tokens(label)) for label in labels], names)


def match_columns(names: Sequence[Name], joints: Sequence[str]) -> Placed | None:
    """Joints of columns by their names: the assignment of most words and numbers in common, as far as it is unique.

    A word counts for the joints that have it, or whose words it is short for where none has it, and against the others;
    so does a number at its place from the end. What that leaves open is told by numbers among the joints of the same
    words, or by the columns' order where there is a column for each joint and all others stand in the robot's order.

    Args:
        names: the columns, in the file's order.
        joints: the robot's joints in its order; feet and sensors are matched alike.

    Returns:
        The match, or None where no name has a word of a joint.
    """
    own = own_names(joints)
    vocabulary = frozenset(word for joint in own for word in joint.words)
    names = [replace(name, words=_join_words(name.words, vocabulary)) for name in names]
    shared = frozenset.intersection(*(frozenset(name.words) for name in names)) if len(names) > 1 else ()
    said = [name.whole for name in names]
    exact = np.array(
        [[1.0 * (joint == name.whole and said.count(joint) == 1) for joint in joints] for name in names]
    )
    words = np.array(
        [sum((_score_word(w, own, w in shared) for w in name.words), 0.0 * exact[0]) for name in names]
    )
    most = max(len(joint.numbers) for joint in own)
    for back in range(2, most + 1):
        words += _score_numbers(names, own, back)
    if not (words.any() or exact.any()):
        return None
    words += 100.0 * (2.0 * exact - exact.any(axis=1, keepdims=True))
    unsaid = np.array([[_count_unsaid(joint, name) for joint in own] for name in names])
    placed = _unique_assignment(words + _score_numbers(names, own, 1) - 0.1 * unsaid)
    pairs = {names[row].name: joints[column] for row, column in placed.items()}
    # Joints for which most speaks; none where nothing speaks for any.
    fits = {
        name.name: frozenset(
            joint for joint, score in zip(joints, row, strict=True) if score == row.max() > 0.0
        )
        for name, row in zip(names, words, strict=True)
    }
    counted = _count_on(names, fits, joints, pairs)
    ordered = {} if counted else _continue_order(names, joints, pairs, fits)
    whole = placed and not (counted or ordered) and all(exact[row, column] for row, column in placed.items())
    because = BY_NAME if whole else BY_WORDS
    because += (
        ", and its number among those" if counted else " and the order of the columns" if ordered else ""
    )
    pairs |= counted | ordered
    columns = {joint: column for joint in joints for column, at in pairs.items() if at == joint}
    rest = [name.name for name in names if name.name not in pairs]
    return Placed(columns, because, tuple(rest), _list_doubts(rest, fits, joints, columns), named=True)


def own_names(joints: Sequence[str]) -> list[Name]:
    """Words and numbers that tell joints apart, without those that all names have: ``3`` once of ``fr3_joint3``."""
    tokens = [[token for token in name_tokens(joint) if token not in _EMPTY] for joint in joints]
    shared = reduce(and_, map(Counter, tokens)) if len(joints) > 1 else Counter[str]()
    found = []
    for joint, own in zip(joints, tokens, strict=True):
        kept, left = [], Counter(shared)
        for token in own:
            left[token] -= 1
            kept += [token] if left[token] < 0 else []
        found.append(replace(_split(joint, kept), whole="".join(t for t in own if not t.isdigit())))
    return found


def _split(name: str, tokens: Sequence[str]) -> Name:
    numbers = tuple(int(token) for token in tokens if token.isdigit())
    return Name(name, tuple(token for token in tokens if not token.isdigit()), numbers)


def _join_words(words: tuple[str, ...], vocabulary: frozenset[str]) -> tuple[str, ...]:
    """Words of a name, two of them as the one that joints have for both: ``front left`` as ``fl``."""
    for first, second in itertools.combinations(words, 2):
        both = {first[:1] + second[:1], second[:1] + first[:1]} & vocabulary
        if both and len(first + second) > 2 and not {first, second} & vocabulary:
            return _join_words(
                tuple(min(both) if w == first else w for w in words if w != second), vocabulary
            )
    return words


def _score_word(word: str, joints: Sequence[Name], shared: bool) -> Array:
    """How much a word speaks for each joint: for those that are called most alike, and against the others."""
    like = np.array([_likeness(word, joint) for joint in joints])
    best = like.max()
    # A word that all columns have (follower) is short for no joint's.
    return np.where(like == best, best, -best) if best == 1.0 or not shared else np.zeros(len(joints))


def _likeness(word: str, joint: Name) -> float:
    """1 for a joint's word or several written together, 0.6 for their initials, 0.5 for what is short for one."""
    own, spans = joint.words, range(len(joint.words) + 1)
    if any(word == "".join(own[start:end]) for start, end in itertools.combinations(spans, 2)):
        return 1.0
    initials = (sorted(one[0] for one in own[start : start + len(word)]) for start in spans)
    if len(word) > 1 and sorted(word) in initials:
        return 0.6
    short = any(_are_short(word, one) for one in own)
    return 0.5 * (short or (len(word) > 2 and _is_short(word, joint.whole)))


def _is_short(short: str, long: str) -> bool:
    """Whether a word is another one with letters left out behind the first."""
    letters = iter(long)
    return short[:1] == long[:1] and len(short) < len(long) and all(letter in letters for letter in short)


def _are_short(word: str, one: str) -> bool:
    """Whether one of two words is short for the other; two letters of a joint's name are two words'."""
    return _is_short(word, one) or (len(one) != 2 and _is_short(one, word))


def _count_unsaid(joint: Name, name: Name) -> int:
    """Words and numbers of a joint's name that a column's does not have, in full or short."""
    said = (any(one in word or _are_short(word, one) for word in name.words) for one in joint.words)
    return sum(not there for there in said) + len(set(joint.numbers) - set(name.numbers))


def _score_numbers(names: Sequence[Name], joints: Sequence[Name], back: int) -> Array:
    """How much numbers at a place from the end speak for joints, as far as columns count as the joints do."""
    own = sorted({joint.numbers[-back] for joint in joints if len(joint.numbers) >= back})
    written = sorted({name.numbers[-back] for name in names if len(name.numbers) >= back})
    from_zero = any(0 in name.numbers for name in names)
    meant: dict[int, int] = {}
    if len(own) == len(written):
        meant = dict(zip(written, own, strict=True))
    elif set(written) <= set(own) and not (from_zero and own[0] == 1):
        meant = {number: number for number in written}
    elif written and {number + (0 in written) for number in written} <= {*own, *(n - 1 for n in own)}:
        # Counted from 0 where the joints are from 1, or the other way round.
        shift = 1 if 0 in written else -1
        meant = {number: number + shift for number in written if number + shift in own}
    scores = np.zeros((len(names), len(joints)))
    for row, column in itertools.product(range(len(names)), range(len(joints))) if meant else ():
        number, joint = names[row].numbers[-back : len(names[row].numbers) - back + 1], joints[column].numbers
        if number and len(joint) >= back:
            scores[row, column] = 1.0 if meant.get(number[0]) == joint[-back] else -1.0
    return scores


def _unique_assignment(scores: Array) -> dict[int, int]:
    """Column by row of the pairs that every best assignment has; what speaks against a pair is no worse than none."""
    scores = np.maximum(scores, 0.0)
    rows, columns = linear_sum_assignment(-scores)
    best, found = scores[rows, columns].sum(), {}
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        other = scores.copy()
        other[row, column] = 0.0
        if best - other[linear_sum_assignment(-other)].sum() > 0.05:
            found[row] = column
    return found


def _count_on(
    names: Sequence[Name],
    fits: Mapping[str, frozenset[str]],
    joints: Sequence[str],
    placed: Mapping[str, str],
) -> dict[str, str]:
    """Joints of columns whose words leave the same ones, counted in the joints' order where there are as many."""
    groups: dict[frozenset[str], dict[str, int]] = {}
    for name in names:
        if name.numbers and name.name not in placed:
            groups.setdefault(fits[name.name] - set(placed.values()), {})[name.name] = name.numbers[-1]
    found: dict[str, str] = {}
    for free, numbers in groups.items():
        if len(set(numbers.values())) == len(numbers) == len(free):
            order = sorted(numbers, key=lambda column: numbers[column])
            found |= dict(zip(order, (joint for joint in joints if joint in free), strict=True))
    return found


def _continue_order(
    names: Sequence[Name],
    joints: Sequence[str],
    placed: Mapping[str, str],
    fits: Mapping[str, frozenset[str]],
) -> dict[str, str]:
    """Joints of the columns that are left, by their order, where all that is known of them agrees with it."""
    if len(names) != len(joints) or len(placed) == len(names):
        return {}
    pairs = {name.name: joint for name, joint in zip(names, joints, strict=True)}
    agrees = all(
        placed.get(c, joint) == joint and joint in (fits[c] or {joint}) for c, joint in pairs.items()
    )
    return {column: joint for column, joint in pairs.items() if column not in placed} if agrees else {}


def _list_doubts(
    rest: Sequence[str], fits: Mapping[str, frozenset[str]], joints: Sequence[str], taken: Collection[str]
) -> tuple[Doubt, ...]:
    """Columns that are left with the joints that they may be, those that may be the same ones together."""
    free = frozenset(joints) - set(taken)
    groups: dict[frozenset[str], list[str]] = {}
    for column in rest:
        if may := fits[column] & free or fits[column] or free:
            groups.setdefault(may, []).append(column)
    return tuple(
        Doubt(tuple(columns), tuple(j for j in joints if j in may)) for may, columns in groups.items()
    )


def first_number(clues: Sequence[Clue]) -> int:
    """Whether joints are counted from 0 or from 1 in this recording."""
    numbers = [
        clue.number for clue in clues if clue.number is not None and clue.quantity not in ("time", "skip", "")
    ]
    return 0 if numbers and min(numbers) == 0 else 1


def with_words_of_joints(clues: dict[str, Clue], joints: Sequence[str]) -> dict[str, Clue]:
    """The clues; a name that has nothing but words of joints' names, as a whole joint's name alone, is its position."""
    own = own_names(joints)
    return {
        name: replace(said, quantity="q")
        if said.label
        and said.stem == said.label
        and not (said.quantity or said.unit)
        and any(all(_likeness(word, joint) == 1.0 for word in said.label.split("_")) for joint in own)
        else said
        for name, said in clues.items()
    }


def _names_of_columns(columns: Sequence[str], clues: dict[str, Clue], joints: Sequence[str]) -> list[Name]:
    """Words and numbers of the columns' names that may be joints'.

    A word that can be a quantity's or a filler (``rotation``, ``arm``) is one where a joint's name has it and not all
    columns do.
    """
    vocabulary = {word for joint in own_names(joints) for word in joint.words}
    tokens = {column: set(name_tokens(column)) for column in columns}
    counted = Counter(token for own in tokens.values() for token in own)
    common = OF_WORD.keys() | COMMANDED | MEASURED | NOISE
    found = []
    for column in columns:
        said = clues[column]
        told = {t for t in tokens[column] & vocabulary if t not in common or counted[t] < len(columns)}
        words = dict.fromkeys([*said.label.split("_"), *sorted(told)])
        numbers = () if said.number is None else (*said.numbers[:-1], said.number)
        found.append(Name(column, tuple(t for word in words for t in name_tokens(word)), numbers, said.exact))
    return found


def _place_by_number(numbers: dict[str, int], joints: Sequence[str], first: int) -> Placed:
    """The k-th joint of the robot for number k; of names that end in numbers, the joint with the same one."""
    own = {int(last[1]): joint for joint in joints if (last := re.search(r"(\d+)\D*$", joint))}
    if len(own) == len(joints) and set(numbers.values()) <= set(own):
        columns = {own[number]: column for column, number in numbers.items()}
        return Placed(columns, "its number, which ends the joint's name")
    order = sorted(numbers, key=lambda column: numbers[column])
    # Numbers such as CAN addresses (11, 12 … 21) count by their order only.
    within = all(first <= number < first + len(joints) for number in numbers.values())
    places = {column: numbers[column] - first if within else k for k, column in enumerate(order)}
    placed = {joints[place]: column for column, place in places.items() if place < len(joints)}
    rest = tuple(column for column, place in places.items() if place >= len(joints))
    return Placed(placed, f"its number, counted from {first} in the model's order of joints", rest)
