"""Commands whose names do not say of what: ``ctrl`` and ``action`` may be positions, or torques."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.families import Family, columns_line
from excite.conversion.columns.vocabulary import OF_WORD
from excite.conversion.guesses import Guesses
from excite.conversion.recording import Recording

# Median over the joints of the correlation with what was measured. In 60 drawn motions of three arms (3 to 20 s),
# positions that were asked for 10 to 90 ms before correlate by 0.94 or more with those measured, torques with positions
# by 0.00 at the most; robots under weak gains follow worse, so the line is drawn between.
_FOLLOWED = 0.5
# A hobby servo at 50 Hz answers 4 rows after it was asked.
_LATEST_ROWS = 8


def settle_commands(
    found: Guesses, chosen: dict[str, Family], recording: Recording, joints: Sequence[str]
) -> None:
    """Take commands of no stated quantity for what was measured that follows them.

    Positions go first: what torques are asked for is close to no position. Commands that nothing follows are left out
    where torques were measured, and asked about where none were.
    """
    family = chosen.get("q_cmd")
    if family is None or "q" not in chosen or family.stated or _says_positions(family):
        return
    columns = {c.name: c.values for stream in recording.streams for c in stream.columns}
    agreements = {
        target: _command_agreement(family, chosen[target], columns)
        for target in ("q", "tau")
        if target in chosen
    }
    of_position, of_torque = agreements["q"], agreements.get("tau") or 0.0
    if of_position is None or of_position >= max(_FOLLOWED, of_torque):
        return
    measured = {"tau", "i"} & {*chosen, *(item.channel for item in found.mapped)}
    if not measured and is_followed(family, chosen["q"], recording):
        why = "commands whose name says no quantity: positions, towards which the measured ones move"
        found.facts.append(("q_cmd", f"{family.columns[0]} …", why))
        return
    del chosen["q_cmd"]
    if of_torque >= _FOLLOWED:
        if "tau_cmd" not in chosen:
            chosen["tau_cmd"] = replace(family, target="tau_cmd", quantity="tau")
        return
    if not measured:
        found.ask(
            f"{family.columns[0]} … are commands by their names, and the positions do not follow them: whether they "
            "are positions or torques is not told",
            f"columns: {{{columns_line(family, joints)}}} or columns: {{{columns_line(family, joints, 'tau_cmd')}}}",
        )
        return
    found.facts.append(
        ("nothing", f"{family.columns[0]} …", "commands that no measured position or torque follows")
    )


def is_followed(command: Family, position: Family, recording: Recording) -> bool:
    """Whether positions do as a command asks: they resemble it, or move towards it a few rows later.

    A servo that is asked for more than it can do turns towards its target as fast as it can, which is proportional
    to, or has the sign of, what is left to go.
    """
    columns = {c.name: c.values for stream in recording.streams for c in stream.columns}
    alike = _command_agreement(command, position, columns)
    if alike is None or alike >= _FOLLOWED:
        return True
    towards = []
    for joint, name in command.placed.columns.items():
        if joint in position.placed.columns:
            asked, is_at = columns[name], columns[position.placed.columns[joint]]
            left, step = (asked - is_at)[:-1], np.diff(is_at)
            # Up to as many rows late as a few hundredths of a second are at the rates of servos.
            towards.append(
                max(
                    _correlation(left[: len(left) - late], step[late:]) or 0.0 for late in range(_LATEST_ROWS)
                )
            )
    return bool(towards) and float(np.median(towards)) >= _FOLLOWED


def _says_positions(family: Family) -> bool:
    return any(OF_WORD.get(word) == "q" for word in family.stem.split("_"))


def _command_agreement(one: Family, other: Family, columns: Mapping[str, Array]) -> float | None:
    """Median over the joints of the correlation; None where they are of different times."""
    values = []
    for joint, name in one.placed.columns.items():
        if joint not in other.placed.columns:
            continue
        a, b = columns[name], columns[other.placed.columns[joint]]
        if len(a) != len(b):
            return None
        if (value := _correlation(a, b)) is not None:
            values.append(value)
    return float(np.median(values)) if values else None


def _correlation(a: Array, b: Array) -> float | None:
    """Of the rows in which both are numbers; None where one of them stands still."""
    whole = np.isfinite(a) & np.isfinite(b)
    if whole.sum() <= 2 or np.ptp(a[whole]) == 0.0 or np.ptp(b[whole]) == 0.0:
        return None
    return float(np.corrcoef(a[whole], b[whole])[0, 1])
