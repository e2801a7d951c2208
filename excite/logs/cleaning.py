"""Finding and repairing what loggers do to samples: repeated, swapped and missing rows, clipping, steps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.clipping import clipped_samples
from excite.logs.log import Cleaning
from excite.logs.missing import missing_rows
from excite.logs.resolution import channel_noise, coarse_step
from excite.logs.sampling import FEWEST_ROWS, SAME_S, check_span, check_stamps

_MAX_REORDERED = 0.01
# A quantised position that moves changes within so many rows.
_AROUND = 8
# Commands are clipped and stepped on purpose.
_NOT_MEASURED = {"time", "q_cmd", "tau_cmd"}


@dataclass(frozen=True, eq=False)
class CleanColumns:
    """Columns in strictly increasing time, and the report of what was done to them."""

    columns: dict[str, Array]
    report: Cleaning


def clean_columns(columns: dict[str, Array], path: Path) -> CleanColumns:
    """Put rows in order of time, drop repeated ones, and count what is missing, clipped or coarse.

    A repeated time stamp keeps its first row. Rows out of order are put in order as long as they are at
    most 1 % of all; more than that is a clock that went back, which nothing here can mend.

    Args:
        columns: finite columns ``(n,)`` by name, ``time`` [s] among them.
        path: the file, for errors.

    Returns:
        The repaired columns and the report.

    Raises:
        LogError: time goes back too often, is not in seconds, or leaps too far, or fewer than 16 distinct samples are
            left.
    """
    time = columns["time"]
    check_stamps(time, path)
    late = time < np.maximum.accumulate(time)
    reordered = int(late.sum())
    if reordered > max(1, _MAX_REORDERED * len(time)):
        row = int(np.argmax(late))
        raise LogError(
            f"goes back from {time[row - 1]:.6g} s to {time[row]:.6g} s in row {row}, {reordered} rows late",
            source=path,
            field="time",
            remedy="split the recording where its clock was reset",
        )
    order = np.argsort(time, kind="stable")
    keep = order[np.concatenate([[True], np.diff(time[order]) > SAME_S])]
    repeated = len(time) - len(keep)
    if len(keep) < FEWEST_ROWS:
        raise LogError(
            f"has {len(keep)} distinct samples",
            source=path,
            field="time",
            remedy=f"at least {FEWEST_ROWS} are needed",
        )
    # Rows that are all in order are not copied.
    rows = slice(None) if not repeated and not reordered else keep
    cleaned = {name: values[rows] for name, values in columns.items()}
    check_span(cleaned["time"], path)
    step = np.diff(cleaned["time"])
    median = float(np.median(step))
    missing = missing_rows(cleaned["time"])
    measured = {name: values for name, values in cleaned.items() if name.split(".")[0] not in _NOT_MEASURED}
    sizes = channel_noise(cleaned["time"], list(measured.values()))
    noise = dict(zip(measured, sizes, strict=True))
    quantised = {
        name: size for name, values in measured.items() if (size := coarse_step(values, noise[name]))
    }
    moving = _in_motion([values for name, values in cleaned.items() if name.startswith("q.")], len(keep))
    clipped = {
        name: count
        for name, values in measured.items()
        if (count := clipped_samples(values, quantised.get(name, 0.0), noise[name], moving))
    }
    report = Cleaning(
        repeated_rows=repeated,
        reordered_rows=reordered,
        missing_rows=int(missing.sum()),
        longest_gap_s=float(step.max()),
        rate_hz=1.0 / median,
        jitter=float(np.std(step[missing == 0]) / median),
        clipped=clipped,
        quantised=quantised,
    )
    return CleanColumns(cleaned, report)


def _in_motion(positions: list[Array], n: int) -> NDArray[np.bool_]:
    """Rows ``(n,)`` near which any position changes; all where there are no positions."""
    if not positions:
        return np.ones(n, dtype=bool)
    changes = np.zeros(n - 1, dtype=bool)
    for values in positions:
        changes |= np.diff(values) != 0.0
    passed = np.concatenate([[0], np.cumsum(np.concatenate([[False], changes]))])
    rows = np.arange(n)
    return np.asarray(passed[np.minimum(rows + _AROUND + 1, n)] > passed[np.maximum(rows - _AROUND, 0)])
