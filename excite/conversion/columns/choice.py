"""Which columns stand for what where several might, or where none has a name: told by shape, order and physics."""

from __future__ import annotations

import re
from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from excite.arrays import Array
from excite.conversion.columns.families import (
    Family,
    columns_line,
    is_measured,
    of_motor,
    says_quantity,
    with_others,
)
from excite.conversion.columns.joints import Placed
from excite.conversion.columns.vocabulary import ASIDE, MEASURED
from excite.conversion.columns.words import read_clue
from excite.conversion.guesses import Guesses
from excite.conversion.recording import Machine, Recording, Stream, live_columns

# Which of several families of columns a channel is made of.

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


# Columns whose names say nothing, told apart by physics: derivatives of each other, commands, torques.

# Samples that the comparison uses.
_MOST_ROWS = 20_000
# Correlations of smoothed signals: a command and its position, a derivative and its velocity.
_TWIN, _DERIVATIVE = 0.98, 0.9
# By how much more a later one of twins has to resemble a derivative.
_LATER = 0.01
# Of 40 drawn motions of three arms (8 to 30 s, noise of up to a fifth of the torques), the fit explained 71 % of the
# torques or more, 9 % of noise and 40 % of regular ripple at the most. Warming motors it explains up to whole in the
# shortest, but temperatures are of one sign.
_LIKE_TORQUES = 0.55
# Rows that it takes, some hundred a regressor are plenty; no joint turns so far in radians.
_FIT_ROWS, _IN_DEGREES = 4000, 4.0 * np.pi


@dataclass(frozen=True)
class Understood:
    """Columns by channel, as indices in the order of the joints.

    Attributes:
        joints: names.
        channels: ``q``, ``v``, ``tau``, ``q_cmd`` with their columns' indices.
        reasons: why, by channel.
    """

    joints: tuple[str, ...]
    channels: dict[str, list[int]]
    reasons: dict[str, str]

    def families(self, names: list[str]) -> dict[str, Family]:
        """As families of columns with these names."""
        return {
            channel: Family(
                target=channel,
                quantity=channel.partition("_")[0],
                placed=Placed(
                    {joint: names[k] for joint, k in zip(self.joints, columns, strict=True)},
                    f"the columns' order ({self.reasons[channel]})",
                ),
                columns=tuple(names[k] for k in columns),
                unit="",
                stated=False,
                stem="",
            )
            for channel, columns in self.channels.items()
        }


def understand_columns(
    values: Array, time: Array, machine: Machine, joints: tuple[str, ...], names: Sequence[str] = ()
) -> Understood | None:
    """Tell positions, velocities, commands and torques apart; None where that does not come out even.

    Args:
        values: ``(n, m)`` columns in any units.
        time: ``(n,)`` [s].
        machine: the robot.
        joints: those that the recording should have, in the columns' order.
        names: of the columns; those of one block differ in their numbers alone.
    """
    n = len(joints)
    forward = np.diff(time)
    dt = float(np.median(forward[forward > 0.0]))
    part = values[:_MOST_ROWS]
    moving = [k for k in range(values.shape[1]) if np.ptp(part[:, k]) > 0.0]
    smooth, rate = _smooth_columns(part, dt)
    twins = _twin_groups(smooth, moving)
    heads = [group[0] for group in twins]
    positions = _find_positions(heads, _derivative_correlations(smooth, rate, heads), smooth, dt, n)
    if positions is None:
        return None
    velocity = _find_velocities(smooth, rate, positions, twins)
    derived = len(velocity) == n
    channels = {"q": positions}
    reasons = {"q": "the smoothest columns" if not derived else "other columns are their derivatives"}
    if derived:
        channels["v"] = velocity
        reasons["v"] = "derivatives of the positions"
        left = [k for k in moving if k not in positions and k not in velocity]
        accelerations = _find_accelerations(smooth, rate, channels["v"], left)
        # Torques of what gravity does not turn look like accelerations, where nothing else is left.
        if accelerations and len(left) >= 2 * n:
            channels["a"], reasons["a"] = accelerations, "derivatives of the velocities"
    used = {k for columns in channels.values() for k in columns}
    groups = {k: group for group in twins for k in group}
    commands = [[k for k in groups[p] if k != p] for p in positions]
    if all(commands):
        channels["q"], channels["q_cmd"] = _measured_first(positions, [c[0] for c in commands], part, dt)
        reasons["q_cmd"] = "twins of the positions, which follow them"
    used |= {k for p in positions for k in groups[p]} | {
        k for v in channels.get("v", []) for k in groups.get(v, [])
    }
    rest = [k for k in range(values.shape[1]) if k not in used]
    if len(rest) == n:
        channels["tau"], reasons["tau"] = rest, "the columns that are left"
    elif len(rest) > n:
        blocks = _torque_blocks([k for k in rest if k in moving], names, n)
        # Gravity may keep a joint's torque on one side, not those of a whole arm.
        signed = [
            b for b in blocks if (part[:, b].min(axis=0) < 0.0).any() and (part[:, b].max(axis=0) > 0.0).any()
        ]
        blocks = signed or blocks
        if blocks:
            explained = [_explained_share(part, positions, block, dt) for block in blocks]
            best = int(np.argmax(explained))
            if derived or explained[best] > _LIKE_TORQUES:
                channels["tau"] = blocks[best]
                reasons["tau"] = (
                    f"postures and motions make {100 * min(explained[best], 1.0):.0f} % of them, as of torques"
                )
    return Understood(joints, channels, reasons)


def _torque_blocks(columns: list[int], names: Sequence[str], n: int) -> list[list[int]]:
    """Blocks of ``n`` columns that may be torques: those called alike but for a number, else one after the other."""
    called: dict[str, list[int]] = {}
    for k in columns:
        called.setdefault(re.sub(r"\d+", "", names[k]) if names else "", []).append(k)
    alike = [block for block in called.values() if len(block) == n]
    return alike or [columns[k : k + n] for k in range(0, len(columns) - n + 1, n)]


def _explained_share(values: Array, positions: list[int], block: list[int], dt: float) -> float:
    """Share of a block's power about its mean that postures, velocities and accelerations make, by least squares.

    Sines and cosines of the joints' angles and of what neighbours add up to are what gravity is made of; a torque
    without the arm's model is so explained for the most part, and what is no torque hardly.
    """
    q = values[:, positions]
    angle = np.radians(q) if np.ptp(q, axis=0).max() > _IN_DEGREES else q
    v = np.gradient(angle, dt, axis=0)
    sums = [np.cumsum(angle[:, k:], axis=1) for k in range(angle.shape[1])]
    turns = np.column_stack([angle, *sums])
    rows = np.column_stack(
        [np.sin(turns), np.cos(turns), v, np.sign(v), np.gradient(v, dt, axis=0), np.ones(len(q))]
    )
    step = max(1, len(rows) // _FIT_ROWS)
    rows, found = rows[::step], values[::step][:, block]
    rest = found - rows @ np.linalg.lstsq(rows, found, rcond=None)[0]
    return float(np.median(1.0 - rest.var(axis=0) / np.maximum(found.var(axis=0), 1e-300)))


def _smooth_columns(values: Array, dt: float) -> tuple[Array, Array]:
    """Columns over some hundredths of a second, scaled to power one, and their derivatives."""
    window = max(3, int(0.04 / dt))
    kernel = np.ones(window) / window
    smooth = np.column_stack([np.convolve(column, kernel, mode="valid") for column in values.T])
    rate = np.gradient(smooth, dt, axis=0)
    return smooth - smooth.mean(axis=0), rate - rate.mean(axis=0)


def _correlate_columns(a: Array, b: Array) -> Array:
    norm = np.maximum(np.linalg.norm(a, axis=0)[:, None] * np.linalg.norm(b, axis=0)[None], 1e-300)
    return np.asarray(a.T @ b / norm)


def _twin_groups(smooth: Array, moving: list[int]) -> list[list[int]]:
    """Groups of columns that are the same but for noise and a short delay, of about the same size."""
    same = _correlate_columns(smooth, smooth)
    size = smooth.std(axis=0)
    groups: list[list[int]] = []
    for k in moving:
        for group in groups:
            if same[group[0], k] > _TWIN and 0.8 < size[k] / max(size[group[0]], 1e-300) < 1.25:
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _derivative_correlations(smooth: Array, rate: Array, heads: list[int]) -> Array:
    """Correlation of each column's derivative with each column, ``(m, m)``; zero where one falls as the other rises."""
    match = _correlate_columns(rate[:, heads], smooth[:, heads])
    np.fill_diagonal(match, 0.0)
    return np.where(match > 0.0, match, 0.0)


def _find_velocities(smooth: Array, rate: Array, positions: list[int], twins: list[list[int]]) -> list[int]:
    """Columns that are the positions' derivatives, in their order; empty where not every one has its own.

    Joints that move alike have velocities that are twins; of a velocity and its command the first is taken.
    """
    taken = {k for group in twins for k in group if group[0] in positions}
    others = [(k, rank) for group in twins for rank, k in enumerate(group) if k not in taken]
    if len(others) < len(positions):
        return []
    columns = [k for k, _ in others]
    match = _correlate_columns(rate[:, positions], smooth[:, columns])
    later = _LATER * np.array([rank for _, rank in others])
    rows, partners = linear_sum_assignment(later - match)
    if (match[rows, partners] < _DERIVATIVE).any():
        return []
    return [columns[k] for k in partners]


def _find_accelerations(smooth: Array, rate: Array, velocities: list[int], others: list[int]) -> list[int]:
    """Columns that are the velocities' derivatives, in their order; empty where not every joint has one."""
    if len(others) < len(velocities):
        return []
    match = _correlate_columns(rate[:, velocities], smooth[:, others])
    rows, partners = linear_sum_assignment(-match)
    if (match[rows, partners] < _DERIVATIVE).any():
        return []
    return [others[column] for column in partners]


def _find_positions(heads: list[int], match: Array, smooth: Array, dt: float, n: int) -> list[int] | None:
    """Columns that hold positions: whose derivative is there and which are no derivative, or the n smoothest."""
    has = [k for k in range(len(heads)) if match[k].max(initial=0.0) > _DERIVATIVE]
    derived_from = {int(np.argmax(match[k])) for k in has}
    first = [heads[k] for k in has if k not in derived_from]
    if len(first) == n:
        return first
    if len(heads) < n:
        return None
    rough = np.std(np.diff(smooth, axis=0), axis=0) / np.maximum(smooth.std(axis=0), 1e-300)
    order = sorted(sorted(heads, key=lambda k: rough[k])[:n])
    # Tables without names hold one quantity after the other: what stands between the smoothest of positions and is no
    # position shows that smoothness did not find them; a body's rates are as smooth.
    side_by_side = sorted(heads)
    at = side_by_side.index(order[0])
    return order if side_by_side[at : at + n] == order else None


def _measured_first(a: list[int], b: list[int], values: Array, dt: float) -> tuple[list[int], list[int]]:
    """Which of twins was measured: the one that comes later, or that is rougher."""
    late = 0.0
    for x, y in zip(a, b, strict=True):
        rate = np.gradient(values[:, x], dt)
        power = float(rate @ rate)
        late += float(rate @ (values[:, x] - values[:, y])) / power if power > 0.0 else 0.0
    # x(t) = y(t - d) makes x - y = -d·rate: what is late has a negative weight.
    return (a, b) if late < 0.0 else (b, a)
