"""Which column of a family belongs to which joint: by whole names, words, numbers, or order."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from excite.conversion.columns.vocabulary import COMMANDED, MEASURED, NOISE, OF_HANDS, OF_WORD
from excite.conversion.columns.words import Clue, name_tokens

# Which joints a word or a number in a column's name speaks of.

# What joints and motors are called whichever they are.
_EMPTY = frozenset("joint joints motor link jnt axis dof".split())


@dataclass(frozen=True)
class Book:
    """What tells a robot's joints apart by their names; what all of them have in common is left out.

    Attributes:
        words: by joint, the words of its name that not all have, in their order.
        numbers: by joint, such numbers.
        whole: by joint, all words of its name written together.
    """

    words: dict[str, tuple[str, ...]]
    numbers: dict[str, tuple[int, ...]]
    whole: dict[str, str]

    @classmethod
    def of(cls, joints: Sequence[str]) -> Book:
        """The words and numbers of joints' names, also of feet and sensors."""
        tokens = {joint: [t for t in name_tokens(joint) if t not in _EMPTY] for joint in joints}
        counts = [Counter(own) for own in tokens.values()]
        shared = {} if len(counts) < 2 else {t: min(count[t] for count in counts) for t in counts[0]}
        told = {joint: _drop_shared_tokens(own, shared) for joint, own in tokens.items()}
        return cls(
            {joint: tuple(t for t in own if not t.isdigit()) for joint, own in told.items()},
            {joint: tuple(int(t) for t in own if t.isdigit()) for joint, own in told.items()},
            {joint: "".join(t for t in own if not t.isdigit()) for joint, own in tokens.items()},
        )

    @property
    def vocabulary(self) -> frozenset[str]:
        """All words that tell joints apart."""
        return frozenset(word for words in self.words.values() for word in words)

    def read(self, words: Sequence[str]) -> tuple[str, ...]:
        """Words of a name, two of them as the one that joints have for both: ``front left`` as ``fl``."""
        own = self.vocabulary
        left = list(words)
        for first, second in itertools.combinations(words, 2):
            both = [first[:1] + second[:1], second[:1] + first[:1]]
            one = next((short for short in both if short in own), "")
            if (
                one
                and first in left
                and second in left
                and not {first, second} & own
                and len(first + second) > 2
            ):
                left.remove(second)
                left[left.index(first)] = one
        return tuple(left)

    def exactly(self, word: str) -> frozenset[str]:
        """Joints in whose names a word stands, by itself or as several of their words written together."""
        same = frozenset(joint for joint, words in self.words.items() if word in words)
        return same or frozenset(
            joint for joint, words in self.words.items() if _written_together(word, words)
        )

    def shortly(self, word: str) -> frozenset[str]:
        """Joints of whose names a word is a short form, or the other way round: ``fl``, ``sh``, ``l``, ``flexion``."""
        initials = frozenset(
            j for j, words in self.words.items() if len(word) > 1 and _is_made_of_initials(word, words)
        )
        return initials or frozenset(
            joint
            for joint, words in self.words.items()
            if any(_is_short(word, own) or _is_letter_of(own, word) for own in words)
            or (len(word) > 2 and _is_short(word, self.whole[joint]))
        )

    def says_all(self, joint: str, words: Iterable[str], numbers: Iterable[int]) -> bool:
        """Whether words and numbers leave nothing of a joint's name unsaid."""
        said, counted = list(words), set(numbers)
        return set(self.numbers[joint]) <= counted and all(
            any(own == word or _is_short(word, own) or _is_letter_of(own, word) for word in said)
            for own in self.words[joint]
        )


def _drop_shared_tokens(tokens: list[str], shared: dict[str, int]) -> list[str]:
    """Tokens without the first ones of those that every name has: ``3`` once of ``fr3_joint3``."""
    left, kept = dict(shared), []
    for token in tokens:
        if left.get(token, 0) > 0:
            left[token] -= 1
        else:
            kept.append(token)
    return kept


def _written_together(word: str, words: tuple[str, ...]) -> bool:
    """Whether a word is two or more of others one after the other."""
    return any(
        word == "".join(words[start:end])
        for start in range(len(words))
        for end in range(start + 2, len(words) + 1)
    )


def _is_made_of_initials(word: str, words: tuple[str, ...]) -> bool:
    """Whether a word is made of the first letters of neighbours among words, in either order: ``lf``, ``fl``."""
    count = len(word)
    return any(
        sorted(word) == sorted(own[0] for own in words[start : start + count])
        for start in range(len(words) - count + 1)
    )


def _is_letter_of(short: str, word: str) -> bool:
    """Whether a joint's word is short for one of a column's; two letters are two words' (``fr`` is not for front)."""
    return len(short) != 2 and _is_short(short, word)


def _is_short(short: str, long: str) -> bool:
    """Whether a word is another one with letters left out behind the first."""
    if not short or len(short) >= len(long) or short[0] != long[0]:
        return False
    letters = iter(long)
    return all(letter in letters for letter in short)


# Columns and joints one to one, by what their names have in common; what that leaves open is said, not
# guessed.

# Why a column is a joint's that is called so, or of whose name it has words.
BY_NAME = "the joint's name"
BY_WORDS = "the words that its name has in common with the joint's"


@dataclass(frozen=True)
class Doubt:
    """Columns of which it cannot be told which of several joints they are."""

    columns: tuple[str, ...]
    joints: tuple[str, ...]


@dataclass(frozen=True)
class Match:
    """Columns by joint.

    Attributes:
        placed: name of the column by joint.
        because: what placed them.
        left_over: columns without a joint.
        doubts: those among them that may be a joint's.
    """

    placed: dict[str, str]
    because: str
    left_over: tuple[str, ...]
    doubts: tuple[Doubt, ...]


def match_columns(names: Sequence[Name], joints: Sequence[str]) -> Match | None:
    """Joints of columns by their names.

    Each word of a name that stands in joints' names, or is short for one, leaves the joints that have it; words that
    no joint has say nothing. Joints that are left in that way by the same words are told apart by their numbers, then
    by each joint having one column. What is open then is taken from the columns' order only where there is a column
    for each joint and all others stand in the robot's order.

    Args:
        names: the columns, in the file's order.
        joints: the robot's joints in its order; feet and sensors are matched alike.

    Returns:
        The match, or None where no name has a word of a joint.
    """
    book = Book.of(joints)
    names = [replace(name, words=book.read(name.words)) for name in names]
    exact = _match_exact_names(names)
    known = _by_words(names, book, joints)
    for column, joint in exact.items():
        known[column] = frozenset((joint,))
    if not known:
        return None
    free = {column: fits if column in exact else fits - set(exact.values()) for column, fits in known.items()}
    counted = by_numbers([name for name in names if name.column not in exact], free, book, joints)
    free |= counted
    placed = _one_each(_wholly_said(names, free, book))
    rest = [name for name in names if name.column not in placed]
    ordered = _in_order(names, joints, placed, known) if rest else {}
    ordered_by = " and the order of the columns"
    if rest and not ordered:
        ordered_by = ", and the numbers of the joints that are left"
        unnamed = [name for name in rest if name.column not in known]
        spare = [joint for joint in joints if joint not in placed.values()]
        ordered = rest_by_number(unnamed, spare, book)
    placed |= ordered
    because = BY_NAME if set(exact) == set(placed) else BY_WORDS
    numbers = {name.column: name.numbers for name in names}
    if any(numbers[column][-1:] != book.numbers[joint][-1:] for column, (joint,) in counted.items()):
        because += ", and its number among those"
    because += ordered_by if ordered else ""
    rest = [name for name in names if name.column not in placed]
    return Match(
        {joint: column for joint in joints for column, at in placed.items() if at == joint},
        because,
        tuple(name.column for name in rest),
        _list_doubts(rest, known, joints, set(placed.values())),
    )


def _match_exact_names(names: Sequence[Name]) -> dict[str, str]:
    """Joints by the column in which their whole name stands; one that stands in several tells nothing."""
    said = [name.exact for name in names]
    return {name.column: name.exact for name in names if name.exact and said.count(name.exact) == 1}


def _by_words(names: Sequence[Name], book: Book, joints: Sequence[str]) -> Candidates:
    """Joints that the words of a name leave; columns without such a word are not in it."""
    whole = frozenset(joints)
    shared = frozenset.intersection(*(frozenset(name.words) for name in names))
    found: Candidates = {}
    for name in names:
        left = whole
        for word in name.words:
            left &= book.exactly(word) or whole
        left &= by_places(name, names, book) or whole
        shorter = left
        for word in name.words:
            if word not in shared and not book.exactly(word):
                shorter &= book.shortly(word) or whole
        found[name.column] = shorter or left
    # A word that all columns have (follower) is no joint's unless it leaves each of them one.
    for word in shared:
        few = {column: fits & (book.shortly(word) or whole) for column, fits in found.items()}
        if not book.exactly(word) and len(names) <= len(frozenset.union(*few.values())) and all(few.values()):
            found = few
    return {column: fits for column, fits in found.items() if fits != whole}


def _wholly_said(names: Sequence[Name], known: Candidates, book: Book) -> Candidates:
    """The candidates; of several the one of whose name nothing is unsaid, where there is one such."""
    found = dict(known)
    for name in names:
        fits = known.get(name.column, frozenset())
        said = [joint for joint in fits if book.says_all(joint, name.words, name.numbers)]
        if len(fits) > 1 and len(said) == 1:
            found[name.column] = frozenset(said)
    return found


def _one_each(known: Mapping[str, frozenset[str]]) -> dict[str, str]:
    """Joints by column where one is left, none of them twice, until no more follow from that."""
    placed: dict[str, str] = {}
    while True:
        taken = set(placed.values())
        only = {
            column: fits - taken
            for column, fits in known.items()
            if column not in placed and len(fits - taken) == 1
        }
        claimed = [joint for (joint,) in only.values()]
        new = {column: joint for column, (joint,) in only.items() if claimed.count(joint) == 1}
        if not new:
            return placed
        placed |= new


def _in_order(
    names: Sequence[Name], joints: Sequence[str], placed: Mapping[str, str], known: Candidates
) -> dict[str, str]:
    """Joints of the columns that are left, by their order, where all that is known of them agrees with it."""
    if len(names) != len(joints):
        return {}
    pairs = {name.column: joint for name, joint in zip(names, joints, strict=True)}
    agrees = all(pairs[column] == joint for column, joint in placed.items()) and all(
        joint in known.get(column, (joint,)) for column, joint in pairs.items()
    )
    return {column: joint for column, joint in pairs.items() if column not in placed} if agrees else {}


def _list_doubts(
    rest: Sequence[Name], known: Candidates, joints: Sequence[str], taken: set[str]
) -> tuple[Doubt, ...]:
    """Columns that are left with the joints that they may be, those that may be the same ones together."""
    groups: dict[tuple[str, ...], list[str]] = {}
    for name in rest:
        free = tuple(joint for joint in joints if joint not in taken)
        fits = known.get(name.column, frozenset())
        may = tuple(joint for joint in free if joint in fits) or (
            tuple(joint for joint in joints if joint in fits) or free
        )
        if may:
            groups.setdefault(may, []).append(name.column)
    return tuple(Doubt(tuple(columns), may) for may, columns in groups.items())


# Which joints the numbers in columns' names speak of.

# By column, the joints that it may be.
Candidates = dict[str, frozenset[str]]


@dataclass(frozen=True)
class Name:
    """What a column is called.

    Attributes:
        column: its name.
        words: words that may be a joint's.
        numbers: numbers in it, the joint's own last; empty for none.
        exact: the joint whose whole name stands in it; empty for none.
    """

    column: str
    words: tuple[str, ...]
    numbers: tuple[int, ...] = ()
    exact: str = ""


def by_places(name: Name, names: Sequence[Name], book: Book) -> frozenset[str]:
    """Joints that numbers before the last one leave: an arm's in ``arm2_q3``; all where they tell nothing."""
    left = frozenset(book.numbers)
    for back in range(2, max((len(own) for own in book.numbers.values()), default=0) + 1):
        if len(name.numbers) >= back and (meant := _joint_numbers(names, book, back)):
            number = meant.get(name.numbers[-back])
            left &= {j for j, own in book.numbers.items() if len(own) >= back and own[-back] == number}
    return left


def _joint_numbers(names: Sequence[Name], book: Book, back: int) -> dict[int, int]:
    """The joints' numbers for those that columns have at one place from the end; empty where that cannot be told.

    Counted from 0 where the joints are from 1, or the other way round, they are one less or more; and of another count
    altogether they are those of the joints in their order where there are as many.
    """
    own = sorted({numbers[-back] for numbers in book.numbers.values() if len(numbers) >= back})
    written = sorted({name.numbers[-back] for name in names if len(name.numbers) >= back})
    from_zero = any(0 in name.numbers for name in names)
    if not own or not written:
        return {}
    if len(own) == len(written):
        return dict(zip(written, own, strict=True))
    if set(written) <= set(own) and not (from_zero and own[0] == 1):
        return {number: number for number in written}
    shift = 1 if 0 in written else -1
    moved = {number: number + shift for number in written}
    return moved if set(moved.values()) <= set(own) and (shift < 0) != (0 in written) else {}


def by_numbers(names: Sequence[Name], known: Candidates, book: Book, joints: Sequence[str]) -> Candidates:
    """Joints of columns whose words leave the same ones, by number: the joints' own, else counted in their order."""
    groups: dict[frozenset[str], dict[str, int]] = {}
    for name in names:
        fits = known.get(name.column, frozenset())
        if name.numbers and len(fits) > 1:
            groups.setdefault(fits, {})[name.column] = name.numbers[-1]
    found: Candidates = {}
    meant = _joint_numbers(names, book, 1)
    for fits, numbers in groups.items():
        if len(set(numbers.values())) < len(numbers):
            continue
        there = [joint for joint in joints if joint in fits]
        own = _own_numbers(there, book)
        if own is not None and {meant.get(number) for number in numbers.values()} <= set(own):
            found |= {column: frozenset((own[meant[number]],)) for column, number in numbers.items()}
        elif len(numbers) == len(there):
            order = sorted(numbers, key=lambda column: numbers[column])
            found |= {column: frozenset((joint,)) for column, joint in zip(order, there, strict=True)}
    return found


def _own_numbers(joints: Sequence[str], book: Book) -> dict[int, str] | None:
    """Joints by the last number in their names; None where two have the same."""
    own = [(book.numbers[joint][-1], joint) for joint in joints if book.numbers[joint]]
    return dict(own) if len(dict(own)) == len(own) else None


def rest_by_number(names: Sequence[Name], joints: Sequence[str], book: Book) -> dict[str, str]:
    """Joints of columns that have nothing but a number, where the joints that are left have the same ones."""
    own = _own_numbers(joints, book)
    numbers = {name.column: name.numbers[-1] for name in names if name.numbers}
    distinct = len(set(numbers.values())) == len(numbers) == len(names)
    if own is None or len(own) != len(joints) or not distinct or not set(numbers.values()) <= set(own):
        return {}
    return {column: own[number] for column, number in numbers.items()}


# Which column of a family belongs to which joint: by names, by words of names, by numbers, by their order.


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
    columns = _but_hands(columns, joints)
    if len(columns) == len(joints) == 1:
        named = clues[columns[0]].exact == joints[0]
        return Placed({joints[0]: columns[0]}, BY_NAME if named else "the robot has one joint", named=named)
    if found := match_columns(_joint_names_in(columns, clues, joints), joints):
        return Placed(found.placed, found.because, found.left_over, found.doubts, named=True)
    numbers = {c: n for c in columns if (n := clues[c].number) is not None}
    # One number for each joint; what has none beside them is no joint's.
    one_each = len(set(numbers.values())) == len(numbers) == len(joints)
    if (
        one_each
        and not numbers.keys() <= set(silent)
        and set(numbers.values()) == set(range(first, first + len(joints)))
    ):
        placed = _by_number(numbers, joints, first)
        return replace(placed, left_over=(*placed.left_over, *(c for c in columns if c not in numbers)))
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
