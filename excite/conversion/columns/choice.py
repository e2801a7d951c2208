"""Which of several families of columns a channel is made of."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np

from excite.conversion.columns.families import (
    Family,
    columns_line,
    is_measured,
    of_motor,
    says_quantity,
    with_others,
)
from excite.conversion.columns.vocabulary import ASIDE, MEASURED
from excite.conversion.columns.words import read_clue
from excite.conversion.guesses import Guesses
from excite.conversion.recording import Recording, Stream, live_columns

# Rivals that differ by less than this share of what they vary by are one signal, logged twice: positions of an arm at
# 100 Hz whose two topics are stamped 5 ms apart differ by 1.4 % at the most, a motor's and a link's torques by 10 %.
_SAME = 0.02


def choose_families(
    groups: Sequence[Family], found: Guesses, recording: Recording, joints: Sequence[str]
) -> dict[str, Family]:
    """The family for each channel: of several the one with the most joints; rivals as good are asked about.

    Rivals are none where one's topic or table is called by what is no measurement (external, desired …), or where
    both hold the same values. Of torques and currents those columns count that are not the same in every row.
    """
    chosen: dict[str, Family] = {}
    live = live_columns(recording)
    parts: dict[str, list[Family]] = {}
    for family in sorted(groups, key=lambda one: _is_aside(one, recording)):
        if not family.target or not family.placed.columns:
            continue
        if family.target not in chosen:
            chosen[family.target] = family
            parts[family.target] = [family]
            continue
        other = chosen[family.target]
        if _of_other_joints(family, other):
            chosen[family.target] = with_others(other, family)
            parts[family.target].append(family)
            continue
        # What stands beside other joints' columns is a rival of what is chosen of the same joints.
        of_joints = _joints(family, live)
        rival = next((one for one in parts[family.target] if _joints(one, live) == of_joints), other)
        alike = len(of_joints) == len(_joints(rival, live))
        other = rival
        side = of_motor(family) == of_motor(other) and is_measured(family) == is_measured(other)
        side = side and says_quantity(family) == says_quantity(other)
        told = _is_aside(family, recording) != _is_aside(other, recording)
        if not (alike and side and family.target in ("q", "tau", "i")) or told:
            continue
        if _are_same(family, other, recording):
            why = f"{family.columns[0]} … hold the same values"
            found.facts.append((family.target, f"{other.columns[0]} …", why))
            continue
        if _told_by_a_word(found, chosen, family, other):
            continue
        _ask_which(found, rival, family, joints)
    return chosen


def settle_unmeasured(
    found: Guesses, chosen: dict[str, Family], joints: Sequence[str], unplaced: Sequence[str]
) -> None:
    """Take what was asked of the joints for what was measured, or ask for that, where nothing measured is there.

    Args:
        found: questions and facts are added.
        chosen: families by channel, changed.
        joints: the robot's.
        unplaced: measured torques of which nothing says whose they are.
    """
    known = set(chosen) | {item.channel for item in found.mapped} | ({"tau"} if unplaced else set())
    _ask_for_measured(found, chosen, known, joints)
    _ask_for_set_points(found, chosen, joints)
    if "q_cmd" in chosen and not known & {"q", "tau", "i"}:
        # A motion that was planned and has no measured twin.
        chosen["q"] = replace(chosen.pop("q_cmd"), target="q")
        found.facts.append(("q", chosen["q"].columns[0], "planned positions: no measured ones are there"))
    if "tau_cmd" in chosen and not known & {"tau", "i"}:
        chosen["tau"] = replace(chosen.pop("tau_cmd"), target="tau")
        found.facts.append(("tau", chosen["tau"].columns[0], "commanded torques: no measured ones are there"))


def _ask_which(found: Guesses, first: Family, other: Family, joints: Sequence[str]) -> None:
    """Which of two families a channel is, or which of more."""
    line = f"columns: {{{columns_line(first, joints)}}}"
    more = f"or {other.columns[0]} …"
    for k, question in enumerate(found.questions):
        if question.line == line:
            found.questions[k] = replace(question, what=f"{question.what} {more}")
            return
    found.ask(f"{first.target} may be {first.columns[0]} … {more}", line)


def _ask_for_measured(
    found: Guesses, chosen: dict[str, Family], known: set[str], joints: Sequence[str]
) -> None:
    """Ask for measured channels where all that is there, and all that a map states, was asked of the joints."""
    unmeasured = not {"q", "tau", "i"} & known
    if unmeasured and {"q_cmd", "tau_cmd"} <= set(chosen):
        # The torques that a controller asks for are its own model's: identified, they would only give that back.
        q, tau = chosen.pop("q_cmd"), chosen.pop("tau_cmd")
        found.ask(
            f"{q.columns[0]} … and {tau.columns[0]} … are what was asked of the joints, and nothing that was measured "
            "is there: record measured positions and torques or currents",
            f"columns: {{{columns_line(q, joints, 'q')}}} and log: {{torque: none}}, or columns: "
            f"{{{columns_line(q, joints, 'q')}, {columns_line(tau, joints, 'tau')}}} to take them for measured",
        )


def _joints(family: Family, live: Container[str]) -> set[str]:
    """Joints of which a family holds something: of torques and currents what is not the same in every row."""
    return {
        joint
        for joint, column in family.placed.columns.items()
        if family.target not in ("tau", "i") or column in live
    }


def _of_other_joints(family: Family, other: Family) -> bool:
    """Whether a family holds what another one does, of joints that it lacks, all called by their names.

    A gantry's slides have forces, and its turning axis a torque.
    """
    named = family.placed.named and other.placed.named
    disjoint = not family.placed.columns.keys() & other.placed.columns.keys()
    side = of_motor(family) == of_motor(other) and is_measured(family) == is_measured(other)
    return named and disjoint and side and family.quantity == other.quantity


def _ask_for_set_points(found: Guesses, chosen: dict[str, Family], joints: Sequence[str]) -> None:
    """Ask whether positions that were asked for are to stand for measured ones, beside torques that were measured."""
    if found.of("q") or "q" in chosen or "q_cmd" not in chosen or not {"tau", "i"} & set(chosen):
        return
    q = chosen.pop("q_cmd")
    chosen["q"] = replace(q, target="q")
    found.ask(
        f"{q.columns[0]} … are what was asked of the joints, and where they were is not there beside their torques: "
        "record measured positions",
        f"columns: {{{columns_line(q, joints, 'q')}}}   # takes them for measured",
    )


def _told_by_a_word(found: Guesses, chosen: dict[str, Family], one: Family, other: Family) -> bool:
    """Whether one of two rivals is none by its name; the other one is chosen then.

    ``q_current`` beside a position is an electric current; ``joint_actual_position`` stands beside the tool's
    ``actual_position``, and ``joint_torque`` beside ``motor_torque``.
    """
    if _ends_as_current(one) != _ends_as_current(other):
        left, taken = (one, other) if _ends_as_current(one) else (other, one)
        chosen.setdefault("i", replace(left, target="i", quantity="i"))
        why = f"{left.columns[0]} … are electric currents"
    elif _of_joints(one) != _of_joints(other):
        left, taken = (other, one) if _of_joints(one) else (one, other)
        why = f"{left.columns[0]} … are not said to be of joints"
    else:
        return False
    chosen[taken.target] = taken
    found.facts.append((taken.target, f"{taken.columns[0]} …", why))
    return True


def _ends_as_current(family: Family) -> bool:
    """Whether ``current`` is the noun, as in q_current, an electric one; in current_position it says when."""
    return family.quantity == "q" and family.stem.split("_")[-1] == "current"


def _of_joints(family: Family) -> bool:
    return bool({"joint", "joints", "jnt", "axis", "axes"} & set(family.stem.split("_")))


def _is_aside(family: Family, recording: Recording) -> bool:
    """Whether the stream of a family is called by what is no measurement of the joints, where there are others."""
    if len(recording.streams) < 2:
        return False
    stream = _stream_of(family, recording)
    said = read_clue(stream.name, ())
    words = set(said.stem.split("_"))
    return bool(words & ASIDE) or (said.commanded and not words & MEASURED)


def _stream_of(family: Family, recording: Recording) -> Stream:
    return next(s for s in recording.streams if any(c.name == family.columns[0] for c in s.columns))


def _are_same(one: Family, other: Family, recording: Recording) -> bool:
    """Whether two families hold the same values of every joint, at the times that their streams have in common."""
    first, second = _stream_of(one, recording), _stream_of(other, recording)
    if set(one.placed.columns) != set(other.placed.columns):
        return False
    for family, stream in ((one, first), (other, second)):
        if not set(family.placed.columns.values()) <= {column.name for column in stream.columns}:
            return False
    for joint, name in one.placed.columns.items():
        a = next(c.values for c in first.columns if c.name == name)
        b = next(c.values for c in second.columns if c.name == other.placed.columns[joint])
        if first is not second:
            if first.time is None or second.time is None:
                return False
            there = np.isfinite(b)
            if not there.any():
                return False
            order = np.argsort(second.time[there], kind="stable")
            b = np.interp(first.time, second.time[there][order], b[there][order], left=np.nan, right=np.nan)
        whole = np.isfinite(a) & np.isfinite(b)
        if whole.sum() < len(a) / 2:
            return False
        if np.sqrt(np.mean((a[whole] - b[whole]) ** 2)) > _SAME * np.std(a[whole]):
            return False
    return True
