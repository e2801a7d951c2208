"""What the name of a column says: which quantity, whether commanded, of which joint, in which unit."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache

from excite.conversion.columns.units import trailing_unit, without_brackets, without_compound
from excite.conversion.columns.vocabulary import (
    COMMANDED,
    KNOWN,
    MEASURED,
    NOISE,
    OF_MESSAGE,
    OF_WORD,
    SHARES,
    SURELY_COMMANDED,
)
from excite.logs.units import QUANTITY_OF_UNIT, UNITS, unit_named

# Where a name changes its case: JointPos, PosFR, FRHip; a single capital letter at an end (tauJ, qD) is no word.
_CASE = re.compile(r"(?<=[a-z])(?=[A-Z][a-z]|[A-Z]{2})|(?<=[A-Z]{2})(?=[A-Z][a-z])")


_OF_JOINTS = frozenset({"q", "v", "a", "tau", "i"})


@dataclass(frozen=True)
class Clue:
    """What a name says.

    Attributes:
        quantity: ``q``, ``v``, ``a``, ``tau``, ``i``, ``volt``, ``time``, ``skip``, or empty where it says nothing.
        commanded: whether it is what was asked for rather than what was measured.
        number: the joint's number as written, None for none.
        label: words that are left, for the joint's name; empty for none.
        unit: as written, in this package's spelling; empty for none.
        exact: the robot's joint whose name stands in it; empty for none.
        stem: the name with joint and number taken out: columns of one family share it.
        numbers: all numbers in it, in their order; the last is taken for the joint's unless others differ.
    """

    quantity: str
    commanded: bool
    number: int | None
    label: str
    unit: str
    exact: str
    stem: str
    numbers: tuple[int, ...] = ()


def read_clue(
    name: str, joints: Sequence[str], unit: str = "", letters: frozenset[str] = frozenset()
) -> Clue:
    """What a column's name says of it, beside the names of the robot's joints and the unit that the file states.

    ``letters`` stand for joints where a number follows them, as w of ``w1`` for a wrist.
    """
    return _read_clue(name, tuple(joints), unit, letters)


# Names stand again in every episode of a data set, and are asked about by several rules.
@lru_cache(maxsize=10_000)
def _read_clue(name: str, joints: tuple[str, ...], unit: str, letters: frozenset[str]) -> Clue:
    text, bracketed = without_brackets(name)
    exact, rest = _without_joint(text, joints)
    if not bracketed:
        rest, bracketed = without_compound(rest)
    tokens = name_tokens(rest)
    if len(tokens) > 2 and tokens[0] == "id" and tokens[1].isdigit() and set(tokens[2:]) & set(OF_WORD):
        # A servo's number before its quantity: ID1 Present Position.
        del tokens[0]
    numbers = [int(token) for token in tokens if token.isdigit()]
    words = [token for token in tokens if not token.isdigit()]
    found = unit_named(unit) or bracketed
    # The letter before a number belongs to it: A1 is an axis, no ampere.
    if not found and len(words) > 1 and (not tokens[-1].isdigit() or len(words[-1]) > 1):
        words, found = trailing_unit(words)
    elif not found and exact and len(words) == 1 and len(words[0]) > 1 and words[0] in UNITS.keys() - KNOWN:
        # Nothing but a unit stands beside the joint's name.
        words, found = [], UNITS[words[0]]
    words = _join_words(words)
    axis = _counted_letter(tokens, words, found, letters) if numbers else _axis_letter(words)
    of_joint = bool(exact or numbers or axis) or (len(joints) == 1 and bool(set(words) & SURELY_COMMANDED))
    # Without the last word that is the axis.
    at = len(words) - 1 - words[::-1].index(axis) if axis in words else len(words)
    quantity = _find_quantity(words[:at] + words[at + 1 :], found, of_joint)
    if quantity in _OF_JOINTS and QUANTITY_OF_UNIT.get(found) == "time":
        # A letter of a word: ticks/s, the side of a leg.
        found = ""
    elif quantity == "v" and found in ("rad", "deg") and f"{found}s" in tokens:
        found = f"{found}/s"
    left = [w for w in words if w == axis or (w not in OF_WORD and w not in COMMANDED | MEASURED | NOISE)]
    return Clue(
        quantity=quantity,
        commanded=_is_commanded(words, quantity),
        number=numbers[-1] if numbers else None,
        label="_".join(left),
        unit=found,
        exact=exact,
        stem="_".join(words),
        numbers=tuple(numbers),
    )


def is_of_joints(said: Clue) -> bool:
    """Whether a name says a measured quantity of some joint's."""
    of_joint = bool(said.exact or said.label or said.numbers)
    return said.quantity in ("q", "v", "tau", "i") and not said.commanded and of_joint


def with_joints_numbers(clues: dict[str, Clue]) -> dict[str, Clue]:
    """The clues, each with the number in which columns of one quantity differ where their last ones are all the same.

    A trace of KUKA's controller writes the robot's number last: ``AxisPos_A1_IPO_R1``.
    """
    groups: dict[tuple[str, bool, str, int], list[str]] = {}
    for name, said in clues.items():
        if len(said.numbers) > 1:
            groups.setdefault((said.quantity, said.commanded, said.stem, len(said.numbers)), []).append(name)
    found = dict(clues)
    for names in groups.values():
        table = list(zip(*(clues[name].numbers for name in names), strict=True))
        differing = [row for row in table if len(set(row)) == len(names)]
        if len(names) > 1 and len(set(table[-1])) == 1 and len(differing) == 1:
            for name, number in zip(names, differing[0], strict=True):
                found[name] = replace(clues[name], number=number)
    return found


def _without_joint(name: str, joints: Sequence[str]) -> tuple[str, str]:
    """The robot's joint that is named, the longest that is, and the name without it."""
    low = name.lower()
    for joint in sorted(joints, key=len, reverse=True):
        key = joint.lower()
        if len(key) < 2:
            continue
        match = re.search(rf"(?<![a-z0-9]){_joint_pattern(key)}(?![0-9])", low)
        if match:
            return joint, f"{name[: match.start()]} {name[match.end() :]}"
    return "", name


@cache
def _joint_pattern(joint: str) -> str:
    """A pattern of a joint's name with its words parted in any way: ``Shoulder Pitch``, ``ShoulderPitch``.

    Numbers stay as they are written: another program's may be counted from another one.
    """
    return re.sub(r"(?<=[a-z])(?:[_ ]|\\-)(?=[a-z])", "[-_ ]?", re.escape(joint).replace("\\ ", " "))


def name_tokens(text: str) -> list[str]:
    """Words and numbers of a name, lower case; a change of case or from letters to digits parts them."""
    found = []
    for word in re.split(r"[^A-Za-z0-9µ°]+", text):
        # Units are written so, too: mNm is no m of Nm.
        whole = word if word.lower() in UNITS or word.lower() in KNOWN else _CASE.sub(" ", word)
        found += re.sub(r"(?<=[A-Za-zµ°])(?=\d)|(?<=\d)(?=[A-Za-zµ°])", " ", whole).split()
    return [token.lower() for token in found]


def _join_words(words: list[str]) -> list[str]:
    """Words that mean something only together: ``q dot`` is a velocity, ``d q`` too."""
    found: list[str] = []
    for word in [part for whole in words for part in _split_word(whole)]:
        before = found[-1] if found else ""
        if before in {"q", "theta", "pos", "joint"} and word in {"dot", "ddot"}:
            found[-1:] = ["qdot" if word == "dot" else "qddot"]
        elif word == "q" and before in {"d", "dd"}:
            found[-1:] = ["dq" if before == "d" else "ddq"]
        else:
            found.append(word)
    return found


def _axis_letter(words: list[str]) -> str:
    """The letter that names an axis, as ``S-axis … T-axis`` of Yaskawa's arms; empty for none.

    So are a motor's q-axis current and no position; d is left, which asks for something elsewhere, and A, which is what
    controllers call each axis.
    """
    pairs = itertools.pairwise(words)
    return next(
        (one for one, after in pairs if len(one) == 1 and one not in "ad" and after in ("axis", "achse")), ""
    )


def _counted_letter(tokens: Sequence[str], words: Sequence[str], unit: str, known: frozenset[str]) -> str:
    """The letter before a number, where longer words or the unit say the quantity; empty for none.

    Of ``angle_w1`` it is the wrist's, and so it is of ``w1_Nm``.
    """
    pairs = itertools.pairwise(tokens)
    found = {
        one for one, after in pairs if after.isdigit() and OF_WORD.get(one) in _OF_JOINTS and len(one) == 1
    }
    if len(found) != 1 or not found <= set(words):
        return ""
    (letter,) = found
    said = any(len(word) > 1 and OF_WORD.get(word) in _OF_JOINTS for word in words)
    other = QUANTITY_OF_UNIT.get(unit, "") in ("tau", "i") and OF_WORD[letter] not in ("tau", "i")
    return letter if said or other or letter in known else ""


def _split_word(word: str) -> list[str]:
    """A word that is written together (``qdes``, ``jointtorque``, ``cmdpos``) taken apart; as it is where it is one."""
    if word in KNOWN:
        return [word]
    for at in range(len(word) - 1, 0, -1):
        first, rest = word[:at], word[at:]
        # Both have to mean something, and together more than two single letters do.
        if first in KNOWN and rest in KNOWN and len(word) > 2:
            return [first, rest]
    for at in range(len(word) - 2, 2, -1):
        if word[:at] in KNOWN and len(others := _split_word(word[at:])) > 1:
            return [word[:at], *others]
    return ["q", "m"] if word == "qm" else [word]


def _is_commanded(words: list[str], quantity: str) -> bool:
    measured = set(words) & MEASURED - {"sensor", "est"}
    commanded = set(words) & (COMMANDED - {"d", "in", "input", "nominal"})
    if measured <= OF_MESSAGE and "d" in words[1:] and words[words.index("d", 1) - 1] not in OF_MESSAGE:
        commanded.add("d")
    if measured and not commanded:
        return False
    return bool(set(words) & COMMANDED) and quantity != ""


def _find_quantity(words: list[str], unit: str, of_joint: bool) -> str:
    # Controllers call axes A1, A2 …
    letters = {"a"} if set(words) & {"axis", "ax", "axes"} else set()
    if of_joint and "a" in words and {OF_WORD.get(word) for word in words} & {"q", "v", "tau", "i"}:
        # Pos act A1, A1 torque: another word says the quantity.
        letters = {"a"}
    words = [word for word in words if word not in letters]
    if (unit == "%" or set(words) & SHARES) and {OF_WORD.get(word) for word in words} & {"tau", "i", "volt"}:
        return "volt"
    said = [OF_WORD[word] for word in words if word in OF_WORD]
    if set(said) == {"volt"} and unit in QUANTITY_OF_UNIT:
        # A letter of a word in another script.
        return QUANTITY_OF_UNIT[unit]
    if not of_joint and words[:1] == ["t"] and set(said[1:]) & {"q", "v", "a", "tau", "i"}:
        # t_q, t_tau: the times of those.
        return "time"
    if of_joint and "t" in words:
        # No joint has a clock of its own: t1, t2 … are torques.
        said = ["tau" if word == "time" else word for word in said]
    # ``current`` before another quantity means what is now, not an electric current.
    if "i" in said and "current" in words and set(said) & {"q", "v", "a", "tau"}:
        said = [word for word in said if word != "i"]
    for quantity in ("skip", "time", "a", "v", "tau", "i", "volt", "q"):
        if quantity in said and not (quantity == "time" and len(set(said)) > 1):
            return quantity
    if unit:
        return QUANTITY_OF_UNIT.get(unit, "")
    # A joint's name alone is its position.
    return "q" if of_joint and (not words or set(words) <= NOISE | MEASURED | COMMANDED) else ""
