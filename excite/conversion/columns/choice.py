"""Which of several families a channel is made of, and what commands are by their values."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.families import Family
from excite.conversion.columns.vocabulary import ASIDE, MEASURED
from excite.conversion.columns.words import read_clue
from excite.conversion.guesses import Guesses
from excite.conversion.recording import Recording, Stream, live_columns

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
