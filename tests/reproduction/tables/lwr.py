"""LWR: what is left of torques that were not used, and the warning about poor motions."""

from __future__ import annotations

from pathlib import Path

from tests.reproduction.lwr import (
    BOTH,
    HALF,
    LARGEST,
    LARGEST_2,
    LWR_JOINTS,
    OTHER,
    OTHER_TRAJECTORY_2,
    PLAIN,
    SETTINGS,
    found,
    left,
    lwr_log,
    unexcited,
)
from tests.reproduction.recordings_data import from_recordings
from tests.reproduction.table import Line, Table

_TITLE = "FloBaRoID, KUKA LWR 4+"


def tables() -> list[Table]:
    """Left-out half, other trajectory, directions not excited."""
    return from_recordings(_TITLE, _tables)


def _tables(data: Path, folder: Path) -> list[Table]:
    return [_half(data, folder), _other(data, folder)]


def _half(data: Path, folder: Path) -> Table:
    log = lwr_log(data, folder / "half", HALF)
    lines = []
    for what, method, settings in (
        ("wls without bending", "wls", PLAIN),
        ("wls", "wls", SETTINGS),
        ("cls3", "cls3", SETTINGS),
    ):
        for joint, rmse in zip(LWR_JOINTS, left(found(log, method, settings)), strict=True):
            limit = LARGEST_2 if joint == LWR_JOINTS[1] else LARGEST
            barred = settings is SETTINGS
            met, bar = (bool(rmse <= limit), f"≤ {limit:g}") if barred else (None, "")
            lines.append(Line(f"{what}: {joint}", f"{limit:g}", float(rmse), met, bar))
    note = (
        "RMSE [N·m] of half a run from its other half and another trajectory, both sides at 5 Hz; by hand, of a second"
        " run of that trajectory, which is not public. Bending: some tenths of a per cent of the moments across a"
        " joint that its torque sensor reads, or a base that is not level."
    )
    return Table(f"{_TITLE}: torques left out", tuple(lines), note, digits=3)


def _other(data: Path, folder: Path) -> Table:
    log = lwr_log(data, folder / "other", OTHER)
    lines = []
    for method in ("wls", "qp", "cls3"):
        result = found(log, method)
        rmse, joint = float(left(result)[1]), LWR_JOINTS[1]
        met, bar = (
            (None, "") if method == "wls" else (rmse <= OTHER_TRAJECTORY_2, f"≤ {OTHER_TRAJECTORY_2:g}")
        )
        lines.append(
            Line(f"{method}: {joint} of the other trajectory [N·m]", OTHER_TRAJECTORY_2, rmse, met, bar)
        )
    lines.append(Line("nominal model: the same", None, result.validation[joint].reference_rmse))
    rich = found(lwr_log(data, folder / "both", BOTH), "wls")
    for what, one in (("one trajectory", found(log, "wls")), ("both", rich)):
        warning = unexcited(one)
        share = f"{warning.figures['directions']:.0f} of {len(one.base)}"
        said = warning.figures["directions"] > 0
        lines.append(
            Line(f"{what}: directions in which data say less than the model", None, share, said, "warned")
        )
        ratio = warning.figures["worst_ratio"]
        lines.append(
            Line(f"{what}: times that the worst of them is less known than from the model", None, ratio)
        )
    note = "Identified from one poor trajectory; by hand from two runs of it, by least squares on base parameters."
    return Table(f"{_TITLE}: another trajectory", tuple(lines), note, digits=3)
