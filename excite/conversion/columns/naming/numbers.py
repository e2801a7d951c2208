"""Which joints the numbers in columns' names speak of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from excite.conversion.columns.naming.book import Book

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
