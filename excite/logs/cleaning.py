"""Finding and repairing what loggers do to samples: repeated, swapped and missing rows, clipping, steps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.errors import LogError
from excite.logs.log import Cleaning
from excite.robot.robot import Array

_MAX_REORDERED = 0.01
_GAP = 1.5
_CLIP_RUN, _CLIP_SHARE = 5, 0.005
_COARSE_LEVELS = 200
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
        LogError: time goes back too often, or fewer than 16 distinct samples are left.
    """
    time = columns["time"]
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
    keep = order[np.concatenate([[True], np.diff(time[order]) > 0.0])]
    repeated = len(time) - len(keep)
    if len(keep) < 16:
        raise LogError(
            f"has {len(keep)} distinct samples", source=path, field="time", remedy="at least 16 are needed"
        )
    cleaned = {name: values[keep] for name, values in columns.items()}
    step = np.diff(cleaned["time"])
    median = float(np.median(step))
    gaps = step > _GAP * median
    measured = {name: values for name, values in cleaned.items() if name.split(".")[0] not in _NOT_MEASURED}
    report = Cleaning(
        repeated_rows=repeated,
        reordered_rows=reordered,
        missing_rows=int(np.sum(np.round(step[gaps] / median) - 1)),
        longest_gap_s=float(step.max()),
        rate_hz=1.0 / median,
        jitter=float(np.std(step[~gaps]) / median),
        clipped={name: count for name, values in measured.items() if (count := clipped_samples(values))},
        quantised={name: size for name, values in measured.items() if (size := coarse_step(values))},
    )
    return CleanColumns(cleaned, report)


def clipped_samples(values: Array) -> int:
    """Samples that sit at the largest or smallest value of a moving channel in runs of five or more.

    Counts only where they are more than 0.5 % of all; a channel that never moves is not clipped.
    """
    spread = values.max() - values.min()
    if spread == 0.0:
        return 0
    count = 0
    for extreme in (values.max(), values.min()):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], (values == extreme).astype(np.int8), [0]])))
        runs = edges[1::2] - edges[::2]
        # A standstill at the end of a motion is no clipping: one run alone at an end of the record.
        count += int(runs[runs >= _CLIP_RUN].sum()) if np.sum(runs >= _CLIP_RUN) >= 2 else 0
    return count if count > _CLIP_SHARE * len(values) else 0


def coarse_step(values: Array) -> float:
    """Step of a channel that takes fewer than 200 values over more than 1000 samples; else 0."""
    levels = np.unique(values)
    if len(values) < 1000 or not 2 < len(levels) < _COARSE_LEVELS:
        return 0.0
    return float(np.min(np.diff(levels)))
