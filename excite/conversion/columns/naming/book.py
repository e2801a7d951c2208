"""Which joints a word or a number in a column's name speaks of."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from excite.conversion.columns.words import name_tokens

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
