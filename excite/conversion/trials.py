"""Recordings cut into trials: at gaps and long pauses; which of them repeat each other; what each is for."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np

from excite.arrays import Array, runs_of
from excite.conversion.columns.clock import Table
from excite.conversion.columns.words import name_tokens
from excite.conversion.explicit_mapping import TrialRules
from excite.errors import LogError
from excite.finding import first_names
from excite.logs.header_blocks import Role

# Between motions people and programs wait for seconds; a motion that dwells does so for less [s].
_PAUSE_S = 2.0
# What is cut out has to be a motion of its own [s].
_SHORTEST_S = 4.0
# Rows that are missing for longer were another recording [s], and more rows than jitter has.
_GAP_S, _GAP_ROWS = 1.0, 50.0
# Slower than this share of its own fastest motion a joint stands.
_STANDS = 0.02
# Motions repeat each other where they differ by less than this share of their own spread, commands or positions.
_SAME = 0.05
_SAME_LENGTH = 0.1
# Somebody who starts a recording by hand does so within a second of the motion [s].
_LATEST_S = 1.0
# Torques of repeats differ by their noise, a fifth of their spread where currents are coarse; a load changes more.
_SAME_FORCE = 0.25
# Share of a single recording that is kept for validation.
_KEPT = 1.0 / 3.0
_VALIDATION = frozenset("val vali valid validation test eval holdout".split())


@dataclass(frozen=True, eq=False)
class Cut:
    """One trial.

    Attributes:
        name: of its file.
        columns: as of :class:`~excite.conversion.columns.clock.Table`.
        role: ``identification`` or ``validation``.
        repeats: name of the trial that it repeats, None for none.
        source: name of the recording that it comes from.
        because: why it has this role and these ends.
    """

    name: str
    columns: dict[str, Array]
    role: Role
    repeats: str | None
    source: str
    because: str


def cut_trials(
    tables: Sequence[Table], rules: TrialRules, roles: Mapping[str, Role] | None = None
) -> tuple[Cut, ...]:
    """Trials of recordings.

    Args:
        tables: the recordings, joined.
        rules: what a map says of trials.
        roles: what a plan says of roles, by trial.

    Returns:
        Trials with roles; at least one is for identification.
    """
    pieces: list[Cut] = []
    for table in tables:
        table = _window(table, rules)
        parts = _parts(table.columns) if rules.split == "pauses" else [slice(None)]
        for k, part in enumerate(parts):
            name = _name(table.name if len(parts) == 1 else f"{table.name}_{k + 1}", pieces)
            columns = {key: values[part] for key, values in table.columns.items()}
            because = (
                "the whole recording" if len(parts) == 1 else f"part {k + 1} of {len(parts)} between pauses"
            )
            pieces.append(Cut(name, columns, "identification", None, table.name, because))
    pieces = _with_repeats(pieces, rules)
    return tuple(_with_roles(pieces, rules, roles or {}))


def _window(table: Table, rules: TrialRules) -> Table:
    start, end = rules.start_s.get(table.name), rules.end_s.get(table.name)
    if start is None and end is None:
        return table
    time = table.columns["time"] - table.columns["time"][0]
    inside = (time >= (start or 0.0)) & (time <= (np.inf if end is None else end))
    return replace(table, columns={key: values[inside] for key, values in table.columns.items()})


def _name(wanted: str, pieces: Sequence[Cut]) -> str:
    name = re.sub(r"[^A-Za-z0-9_.+-]+", "_", wanted).strip("._") or "trial"
    taken = {piece.name for piece in pieces}
    count = 2
    unique = name
    while unique in taken:
        unique, count = f"{name}_{count}", count + 1
    return unique


def _parts(columns: dict[str, Array]) -> list[slice]:
    """Stretches of rows between gaps and long pauses; the whole where there is one motion only."""
    time = columns["time"]
    n = len(time)
    steps = np.diff(time)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 1.0
    gaps = np.flatnonzero(steps > max(_GAP_S, _GAP_ROWS * usual)) + 1
    found: list[slice] = []
    for start, end in zip([0, *gaps], [*gaps, n], strict=True):
        found += _between_pauses(columns, int(start), int(end), usual)
    return found or [slice(None)]


def _between_pauses(columns: dict[str, Array], start: int, end: int, dt: float) -> list[slice]:
    positions = [values[start:end] for name, values in columns.items() if name.startswith("q.")]
    window = max(1, round(0.1 / dt))
    if end - start < 4 * window:
        return [slice(start, end)] if (end - start) * dt >= 1.0 else []

    def speed(q: Array) -> Array:
        return np.abs(q[window:] - q[:-window]) / (window * dt)

    # A joint at a time: recordings of an hour are as large as they may be already.
    fastest = [max(float(np.nanpercentile(speed(q), 99)), 1e-9) for q in positions]
    own, common = (np.zeros(end - start - window, dtype=bool) for _ in range(2))
    for q, most in zip(positions, fastest, strict=True):
        own |= speed(q) > _STANDS * most
        common |= speed(q) > _STANDS * max(fastest)
    moves = own & common
    merged: list[list[int]] = []
    for a, b in runs_of(moves):
        if merged and (a - merged[-1][1]) * dt < _PAUSE_S:
            merged[-1][1] = b
        else:
            merged.append([a, b])
    motions = [piece for piece in merged if (piece[1] - piece[0]) * dt >= _SHORTEST_S]
    if len(motions) < 2 or len(motions) < len(merged):
        # One motion, or one that dwells: static poses belong together.
        return [slice(start, end)]
    margin = round(0.5 / dt)
    return [slice(max(start, start + a - margin), min(end, start + b + window + margin)) for a, b in motions]


def _with_repeats(pieces: list[Cut], rules: TrialRules) -> list[Cut]:
    found: list[Cut] = []
    for piece in pieces:
        stated = rules.repeats.get(piece.name)
        same = stated or next(
            (o.name for o in found if o.repeats is None and _repeats(piece.columns, o.columns)), None
        )
        because = piece.because if same is None else f"{piece.because}; its motion is that of {same}"
        found.append(replace(piece, repeats=same, because=because))
    return found


def _repeats(a: dict[str, Array], b: dict[str, Array]) -> bool:
    """Whether two trials ran the same motion: commands where both have them, else positions, from their beginnings."""
    # Another gain of the servo shows in the positions, another load in the torques.
    return all(
        _alike(a, b, prefix, share)
        for prefix, share in (("q_cmd.", _SAME), ("q.", _SAME), ("tau.", _SAME_FORCE), ("i.", _SAME_FORCE))
        if any(name.startswith(prefix) for name in a)
    )


def _alike(a: dict[str, Array], b: dict[str, Array], prefix: str, share: float) -> bool:
    names = [name for name in a if name.startswith(prefix)]
    if any(name not in b for name in names):
        return False
    lengths = [float(np.ptp(columns["time"])) for columns in (a, b)]
    if abs(lengths[0] - lengths[1]) > _SAME_LENGTH * max(lengths):
        return False
    grid = np.linspace(0.0, 0.98 * min(lengths), 400)
    signals = [
        np.column_stack([np.interp(grid, c["time"] - c["time"][0], c[name]) for name in names])
        for c in (a, b)
    ]
    spread = float(np.sqrt(((signals[0] - signals[0].mean(axis=0)) ** 2).sum()))
    if spread <= 0.0:
        return False
    most = min(len(grid) // 4, round(_LATEST_S / (grid[1] - grid[0])))
    rest = min(
        float(
            np.sqrt(
                (
                    (signals[0][most : len(grid) - most] - signals[1][most + s : len(grid) - most + s]) ** 2
                ).sum()
            )
        )
        for s in range(-most, most + 1)
    )
    return rest < share * spread


def _with_roles(pieces: list[Cut], rules: TrialRules, roles: Mapping[str, Role]) -> list[Cut]:
    """The pieces, those that validate chosen in the first way that tells them.

    Raises:
        LogError: the map names a trial that is none.
    """
    names = [p.name for p in pieces]
    if len(pieces) == 1 and not rules.validation:
        return _halved(pieces[0])
    found = {mark: {name for name in names if fnmatchcase(name, mark)} for mark in rules.validation}
    if unknown := [mark for mark, of in found.items() if not of and mark != "none"]:
        raise LogError(
            f"names no trial: {', '.join(unknown)}",
            source="map.yaml",
            field="trials.validation",
            remedy=f"the trials are {first_names(names)}",
        )
    firsts = [p.name for p in pieces if p.repeats is None]
    last = set(firsts[-max(1, len(firsts) // 4) :])
    ways = (
        ("as stated in the map", set[str]().union(*found.values())),
        (
            "as the plan says",
            {p.name for p in pieces if roles.get(p.name, roles.get(p.source)) == "validation"},
        ),
        ("by its name", {name for name in names if not _VALIDATION.isdisjoint(name_tokens(name))}),
        ("", {names[-1]} if len(firsts) == 1 else last | {p.name for p in pieces if p.repeats in last}),
    )
    told = ((by, of) for by, of in ways if (of and len(of) < len(pieces)) or not by)
    by, chosen = ways[0] if rules.validation else next(told)
    usual = "the last of the repeats" if len(firsts) == 1 else "the last quarter of the motions"
    because = f"validation {by}" if by else f"{usual} validates"
    return [
        replace(p, role="validation", because=f"{p.because}; {because}") if p.name in chosen else p
        for p in pieces
    ]


def _halved(piece: Cut) -> list[Cut]:
    """A single trial as two: its last third is kept for validation."""
    time = piece.columns["time"]
    at = int((1.0 - _KEPT) * len(time))
    if at < 20 or len(time) - at < 20:
        return [piece]
    first = {key: values[:at] for key, values in piece.columns.items()}
    last = {key: values[at:] for key, values in piece.columns.items()}
    return [
        replace(piece, columns=first, because=f"{piece.because}, its first two thirds"),
        replace(
            piece,
            name=f"{piece.name}_validation",
            columns=last,
            role="validation",
            because="its last third validates",
        ),
    ]
