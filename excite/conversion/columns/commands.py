"""Commands whose names do not say of what: ``ctrl`` and ``action`` may be positions, or torques."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.families import Family
from excite.conversion.columns.vocabulary import OF_WORD
from excite.conversion.guesses import Guesses
from excite.conversion.recording import Recording

# Median over the joints of the correlation with what was measured. In 60 drawn motions of three arms (3 to 20 s),
# positions that were asked for 10 to 90 ms before correlate by 0.94 or more with those measured, torques with positions
# by 0.00 at the most; robots under weak gains follow worse, so the line is drawn between.
_FOLLOWED = 0.5


def settle_commands(found: Guesses, chosen: dict[str, Family], recording: Recording) -> None:
    """Take commands of no stated quantity for what was measured that follows them; leave them out where none does.

    Positions go first: what torques are asked for is close to no position.
    """
    family = chosen.get("q_cmd")
    if family is None or "q" not in chosen or family.stated or _says_positions(family):
        return
    columns = {c.name: c.values for stream in recording.streams for c in stream.columns}
    agreements = {
        target: _agreement(family, chosen[target], columns) for target in ("q", "tau") if target in chosen
    }
    of_position, of_torque = agreements["q"], agreements.get("tau") or 0.0
    if of_position is None or of_position >= max(_FOLLOWED, of_torque):
        return
    del chosen["q_cmd"]
    if of_torque >= _FOLLOWED:
        if "tau_cmd" not in chosen:
            chosen["tau_cmd"] = replace(family, target="tau_cmd", quantity="tau")
        return
    found.facts.append(
        ("nothing", f"{family.columns[0]} …", "commands that no measured position or torque follows")
    )


def _says_positions(family: Family) -> bool:
    return any(OF_WORD.get(word) == "q" for word in family.stem.split("_"))


def _agreement(one: Family, other: Family, columns: Mapping[str, Array]) -> float | None:
    """Median over the joints of the correlation; None where they are of different times."""
    values = []
    for joint, name in one.placed.columns.items():
        if joint not in other.placed.columns:
            continue
        a, b = columns[name], columns[other.placed.columns[joint]]
        if len(a) != len(b):
            return None
        whole = np.isfinite(a) & np.isfinite(b)
        if whole.sum() > 2 and a[whole].std() > 0.0 and b[whole].std() > 0.0:
            values.append(float(np.corrcoef(a[whole], b[whole])[0, 1]))
    return float(np.median(values)) if values else None
