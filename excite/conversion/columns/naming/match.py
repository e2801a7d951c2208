"""Columns and joints one to one, by what their names have in common; what that leaves open is said, not guessed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from excite.conversion.columns.naming.book import Book
from excite.conversion.columns.naming.numbers import Candidates, Name, by_numbers, by_places, rest_by_number

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
