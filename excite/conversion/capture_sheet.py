"""The sheet for the minutes at the robot: what is run in which order, and what a log of it is checked against."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from excite.conversion.assemble import Table
from excite.conversion.mapping import TrialRules
from excite.conversion.trials import Cut, cut_trials
from excite.errors import LogError
from excite.logs.header_blocks import Role
from excite.reading.file import read_text

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
    joint [rad or m].
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    kind: Literal["motion", "warm_up", "static", "zero_torque"]
    duration_s: Seconds
    motion: str | None = None
    role: Role | None = None
    repeats: str | None = None
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
    def logged(self) -> tuple[Run, ...]:
        """Runs that belong into a log: motions."""
        return tuple(run for run in self.runs if run.kind == "motion")

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


def read_capture(path: Path) -> Capture:
    """The part of a sheet that is for programs: its block ``yaml``, or the whole of a YAML file.

    Raises:
        LogError: the file is missing, or holds no such block, or mistakes.
    """
    text = read_text(path, error=LogError)
    block = re.search(r"(?:```yaml|<pre class=\"capture\">)\n(.*?)\n(?:```|</pre>)", text, re.DOTALL)
    said = text if block is None else unescape(block[1]) if block[0].startswith("<") else block[1]
    try:
        return Capture.model_validate(yaml.safe_load(said))
    except (ValidationError, yaml.YAMLError, TypeError) as error:
        line = " ".join(str(error).split())[:200]
        raise LogError(
            f"holds no capture sheet ({line})", source=path, remedy="write it by `excite capture`"
        ) from error


def named_runs(cuts: Sequence[Cut], sheet: Capture) -> dict[str, str]:
    """By trial, the run that it is: the run's name in the trial's, else their order where there are as many.

    Trials that no run is found for are left out.
    """
    found: dict[str, str] = {}
    runs = sorted((run.name for run in sheet.logged), key=len, reverse=True)
    for cut in cuts:
        name = next((run for run in runs if run in (cut.name, cut.source) or run in cut.name), None)
        if name is not None and name not in found.values():
            found[cut.name] = name
    if not found and len(cuts) == len(sheet.logged):
        return {cut.name: run.name for cut, run in zip(cuts, sheet.logged, strict=True)}
    return found


def by_sheet(tables: Sequence[Table], rules: TrialRules, sheet: Capture) -> tuple[Cut, ...]:
    """Trials with the roles and repeats of a sheet; those that are none of its runs are cut as ever."""
    cuts = cut_trials(tables, rules, sheet.roles())
    names = named_runs(cuts, sheet)
    trials = {run: trial for trial, run in names.items()}
    roles, repeats = sheet.roles(), sheet.repeats()
    found = []
    for cut in cuts:
        run = names.get(cut.name)
        if run is not None:
            again = trials.get(repeats.get(run, ""))
            because = f"run {run} of the capture sheet"
            cut = replace(cut, role=roles.get(run, cut.role), repeats=again, because=because)
        found.append(cut)
    return tuple(found)


def compare(cuts: Sequence[Cut], sheet: Capture) -> list[str]:
    """What differs between trials and a sheet, a sentence each."""
    runs = {run.name: run for run in sheet.logged}
    names = named_runs(cuts, sheet)
    said = []
    missing = [name for name in runs if name not in names.values()]
    if missing:
        said.append(f"not recorded: {', '.join(missing)}")
    for cut in cuts:
        if cut.name not in names:
            said.append(f"{cut.name} is no run of the sheet")
            continue
        run = runs[names[cut.name]]
        time = cut.columns["time"]
        lasts = float(np.ptp(time))
        if lasts < run.duration_s - _MISSING_S:
            said.append(f"{cut.name} lasts {lasts:.1f} s, its motion {run.duration_s:.1f} s")
        rate = (len(time) - 1) / max(lasts, 1e-9)
        if rate < _LEAST_RATE * sheet.rate_hz:
            said.append(f"{cut.name} has {rate:.0f} rows a second, the sheet asks for {sheet.rate_hz:g}")
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
