"""The sheet for the minutes at the robot: what is run in which order, and what a log of it is checked against."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field

from excite.conversion.columns.clock import Table
from excite.conversion.explicit_mapping import TrialRules
from excite.conversion.trials import Cut, cut_trials
from excite.errors import LogError, raised_as
from excite.formats.documents import check_content
from excite.formats.file import read_text, unreadable
from excite.logs.header_blocks import Role

Seconds = Annotated[float, Field(ge=0.0, le=1e6)]
# A recording is longer than its motion, by what passes before and after; never shorter by more than this [s].
_MISSING_S = 1.0
# Fewer rows than this share of those asked for is another rate.
_LEAST_RATE = 0.9
# A motion that begins farther from its plan is another one, or its zeros or units are others [rad or m].
_START = 0.1


class Run(BaseModel):
    """One recording.

    ``kind`` is ``motion``, ``warm_up``, ``static`` or ``zero_torque``; ``start`` the positions in which it begins, by
    joint [rad or m], those of ``motion`` ``at_s`` after its start [s].
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    kind: Literal["motion", "warm_up", "static", "zero_torque"]
    duration_s: Seconds
    motion: str | None = None
    role: Role | None = None
    repeats: str | None = None
    at_s: Seconds = 0.0
    start: dict[str, float] = {}


class Capture(BaseModel):
    """What a sheet says to programs."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    schema_: Literal["excite.capture/1"] = Field(alias="schema", default="excite.capture/1")
    robot: str
    rate_hz: Annotated[float, Field(gt=0.0)]
    joints: tuple[str, ...]
    runs: tuple[Run, ...]

    @property
    def motions(self) -> tuple[Run, ...]:
        """Runs of motions."""
        return tuple(run for run in self.runs if run.kind == "motion")

    @property
    def logged(self) -> tuple[Run, ...]:
        """Runs that belong into a log: motions, and standing still. Drives are cold or off in the others."""
        return tuple(run for run in self.runs if run.kind in ("motion", "static"))

    def roles(self) -> dict[str, Role]:
        """Role by name of the run and of its motion."""
        found: dict[str, Role] = {}
        for run in self.logged:
            if run.role is not None:
                found[run.name] = run.role
                found.setdefault(run.motion or run.name, run.role)
        return found

    def repeats(self) -> dict[str, str]:
        """By run, the run that it repeats."""
        return {run.name: run.repeats for run in self.logged if run.repeats is not None}

    def text(self) -> str:
        """As YAML, for the sheet."""
        content = self.model_dump(mode="json", by_alias=True, exclude_none=True, exclude_defaults=False)
        return yaml.safe_dump(
            content, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110
        )


@raised_as(LogError)
def read_capture(path: Path) -> Capture:
    """The part of a sheet that is for programs: its block ``yaml``, or the whole of a YAML file.

    Raises:
        LogError: the file is missing, or holds no such block, or mistakes.
    """
    text = read_text(path)
    block = re.search(r"```yaml\n(.*?)\n```", text, re.DOTALL)
    said = text if block is None else block[1]
    again = "write it by `excite capture`"
    with unreadable(path, "a capture sheet", again):
        content = yaml.safe_load(said)
    return check_content(Capture, content, path, remedy=again)


def by_sheet(tables: Sequence[Table], rules: TrialRules, sheet: Capture) -> tuple[tuple[Cut, ...], list[str]]:
    """Trials with the roles and repeats of a sheet, and what differs from it, a sentence each.

    Those that are none of its runs are cut as ever; runs in which drives are cold or off are left out.

    Raises:
        LogError: nothing is left.
    """
    names = _named_runs([table.name for table in tables], sheet)
    runs = {run.name: run for run in sheet.runs}
    out = [table for table in tables if table.name in names and runs[names[table.name]] not in sheet.logged]
    said = [_left_out(table, runs[names[table.name]]) for table in out]
    if len(out) == len(tables):
        raise LogError(f"nothing belongs into a log ({'; '.join(said)})", remedy="record the sheet's motions")
    cuts = cut_trials([table for table in tables if table not in out], rules, sheet.roles())
    found, differs = _match_runs(cuts, sheet)
    return found, [*said, *differs]


def _match_runs(cuts: Sequence[Cut], sheet: Capture) -> tuple[tuple[Cut, ...], list[str]]:
    """Trials as the runs that they are, and what differs."""
    names = _named_runs([cut.name for cut in cuts], sheet)
    runs, trials = {run.name: run for run in sheet.runs}, {run: trial for trial, run in names.items()}
    roles, repeats = sheet.roles(), sheet.repeats()
    missing = [run.name for run in sheet.logged if run.name not in trials]
    found, said = [], [f"not recorded: {', '.join(missing)}"] if missing else []
    for cut in cuts:
        run = runs.get(names.get(cut.name, ""))
        if run is None:
            said.append(f"{cut.name} is no run of the sheet")
            found.append(cut)
            continue
        if run not in sheet.logged:
            said.append(_left_out(cut, run))
            continue
        said += _list_differences(cut, run, sheet.rate_hz)
        again = trials.get(repeats.get(run.name, ""))
        because = f"run {run.name} of the capture sheet"
        found.append(replace(cut, role=roles.get(run.name, cut.role), repeats=again, because=because))
    return tuple(found), said


def _named_runs(recorded: Sequence[str], sheet: Capture) -> dict[str, str]:
    """By recording, the run that it is: the run's name in its own, else their order where there are as many.

    Recordings that no run is found for are left out.
    """
    found: dict[str, str] = {}
    runs = sorted((run.name for run in sheet.runs), key=len, reverse=True)
    for name in recorded:
        run = next((run for run in runs if run in name), None)
        if run is not None and run not in found.values():
            found[name] = run
    for asked in () if found else (sheet.motions, sheet.logged, sheet.runs):
        if len(recorded) == len(asked):
            return {name: run.name for name, run in zip(recorded, asked, strict=True)}
    return found


def _left_out(recorded: Table | Cut, run: Run) -> str:
    """That a recording is no part of the log, and what its torques read where drives are off."""
    if run.kind == "warm_up":
        return f"{recorded.name} is left out of the log: drives warm up in it"
    read = {
        key: float(np.nanmean(v)) for key, v in recorded.columns.items() if key.startswith(("tau.", "i."))
    }
    words = f"{recorded.name} is left out of the log: torques are off in it"
    if not read:
        return words
    most = max(read, key=lambda key: abs(read[key]))
    unit = "A" if most.startswith("i.") else "N·m or N"
    return f"{words}, and the largest that a channel reads is {read[most]:+.3g} {unit}, {most.partition('.')[2]}'s"


def _list_differences(cut: Cut, run: Run, rate_hz: float) -> list[str]:
    """What differs between a trial and its run, a sentence each."""
    said = []
    time = cut.columns["time"]
    lasts = float(np.ptp(time))
    if lasts < run.duration_s - _MISSING_S:
        what = "its motion" if run.kind == "motion" else "the sheet"
        said.append(f"{cut.name} lasts {lasts:.1f} s, {what} {run.duration_s:.1f} s")
    rate = (len(time) - 1) / max(lasts, 1e-9)
    if rate < _LEAST_RATE * rate_hz:
        said.append(f"{cut.name} has {rate:.0f} rows a second, the sheet asks for {rate_hz:g}")
    far = {
        joint: float(cut.columns[f"q.{joint}"][0]) - start
        for joint, start in run.start.items()
        if f"q.{joint}" in cut.columns and abs(float(cut.columns[f"q.{joint}"][0]) - start) > _START
    }
    if far:
        worst = max(far, key=lambda joint: abs(far[joint]))
        said.append(
            f"{cut.name} begins {far[worst]:+.2f} off the motion's start at {worst}: unit, zero or another motion"
        )
    return said
