"""Drawn recordings of arms whose columns nobody explained: how many are understood, faults included."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from excite.conversion.convert import convert
from excite.errors import InputError
from tests.benchmarks.table import Row
from tests.conversion.drawn import Drawn, draw
from tests.conversion.drawn_habits import draw_habits

CASES, LEAST = 100, 95


def judge(case: Drawn, out: Path, *, examine: bool = True) -> list[str]:
    """What was misunderstood of a case; empty for nothing."""
    try:
        found = convert([case.file], case.robot, out)
    except InputError as error:
        return [f"refused: {str(error)[:300]}"]
    wrong = [
        f"{target} from {found.columns.get(target, ('nothing', 0))[0]} instead of {column}"
        for target, column in case.columns.items()
        if found.columns.get(target, ("", 0.0))[0] != column
    ]
    for target, (_, factor) in found.columns.items():
        right = case.factors.get(target.partition(".")[0], factor)
        if not np.isclose(factor, right, rtol=1e-6):
            wrong.append(f"{target} × {factor:g} instead of {right:g}")
    wrong += [f"{target} was made up" for target in found.columns if target not in case.columns]
    if examine:
        signs = {
            j
            for f in (found.chart.findings if found.chart else ())
            if f.kind == "torque_sign"
            for j in f.places
        }
        if signs != ({case.turned} if case.turned else set()):
            wrong.append(f"turned: {sorted(signs)} instead of {case.turned or 'none'}")
    return wrong


def rows() -> list[Row]:
    """Columns and faults of cases drawn by two hands, a hundred each."""
    found = []
    for title, drawn in (
        ("arm, columns nobody explained", draw),
        ("arm, habits of laboratories", draw_habits),
    ):
        right = 0
        with tempfile.TemporaryDirectory() as folder:
            for seed in range(CASES):
                case = drawn(seed, Path(folder))
                wrong = judge(case, Path(folder) / f"log_{seed}")
                right += not wrong
                if wrong:
                    print(f"{seed} ({case.robot}): {'; '.join(wrong[:4])}", file=sys.stderr, flush=True)
        found.append(Row.at_least(f"conversion: {title}: understood of {CASES} drawn", right, LEAST))
    return found
