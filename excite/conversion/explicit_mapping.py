"""``map.yaml``, schema ``excite.map/1``: what a person states about the columns of a recording."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from excite.errors import LogError, raised_as
from excite.formats.documents import read_yaml
from excite.logs.log import LogHeader
from excite.logs.units import TO_SI, unit_named

# ``map.yaml``, schema ``excite.map/1``: what a recording's columns mean, as far as a person has to say it.

SCHEMA = "excite.map/1"
CHANNELS = ("time", "q", "v", "a", "tau", "i", "q_cmd", "tau_cmd", "base", "wrench", "imu", "contact")
Factor = Annotated[float, Field(ge=-1e12, le=1e12)]


def _not_zero(factor: float) -> float:
    """The factor, with which a channel still says something."""
    if factor == 0.0:
        raise ValueError("zero leaves nothing of a channel; `ignore` leaves its columns out")
    return factor


def _known_unit(text: str) -> str:
    """The unit in this package's spelling."""
    unit = text if text in TO_SI or text == "±100" else unit_named(text)
    if unit not in TO_SI and unit != "±100":
        usual = (
            "rad, deg, rev, m, mm, rad/s, deg/s, rpm, N·m, mN·m, kgf·cm, ozf·in, A, mA, s, ms, counts/4096"
        )
        raise ValueError(f"no unit: {text}; units are {usual} and others put together so")
    return unit


Unit = Annotated[str, AfterValidator(_known_unit)]


class TrialRules(BaseModel):
    """How recordings become trials."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    split: Literal["pauses", "none"] = Field(
        default="pauses", description="Cut recordings at pauses and gaps, or keep each whole."
    )
    validation: tuple[str, ...] = Field(
        default=(),
        description="Names of the trials to validate on, `*` for any letters, or `none`; proposed if empty.",
    )
    repeats: dict[str, str] = Field(default={}, description="By trial, the trial whose command it repeats.")
    start_s: dict[str, float] = Field(default={}, description="By source, the time where its use begins [s].")
    end_s: dict[str, float] = Field(default={}, description="By source, the time where its use ends [s].")


class Map(BaseModel):
    """The whole of a ``map.yaml``. Whatever it leaves out is guessed, and said to be.

    In ``columns``, ``{joint}`` stands for each joint, ``{n}`` for its number from 1 and ``{n0}`` from 0, in the order
    of ``joints``. A channel (``q``) or one joint of it (``q.elbow``) may be named under ``columns``, ``units`` and
    ``scale``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, populate_by_name=True)

    schema_: Literal["excite.map/1"] = Field(alias="schema", default="excite.map/1")
    joints: tuple[str, ...] = Field(
        default=(), description="The robot's joints in the order of the columns; all of the robot's if empty."
    )
    columns: dict[str, str] = Field(
        default={},
        description="By channel (`q`, `tau.elbow`, `wrench.SENSOR.fx` …) the column's name or a pattern of it.",
    )
    units: dict[str, Unit] = Field(
        default={},
        description="By channel, the unit of its columns: rad, deg/s, rpm, N·mm, kgf·cm … in any spelling.",
    )
    scale: dict[str, Annotated[Factor, AfterValidator(_not_zero)]] = Field(
        default={}, description="By channel or joint, a factor on top of the unit's; -1 turns a sign."
    )
    offset: dict[str, Factor] = Field(
        default={}, description="By channel or joint, what is added after scaling (SI)."
    )
    motors: list[list[Factor]] = Field(
        default=[],
        description="Motor turns per joint turn, one row a motor: positions are motors', torques on the motors' side.",
    )
    ignore: tuple[str, ...] = Field(
        default=(), description="Columns that are no signals of the robot; `*` for any letters."
    )
    trials: TrialRules = TrialRules()
    log: dict[str, Any] = Field(
        default={},
        description="Fields of log.yaml as they shall stand there: torque, controller, rate_hz, modelled …",
    )

    @property
    def rate_hz(self) -> float | None:
        """Rows a second that ``log`` states [Hz]; None for none.

        Raises:
            LogError: what stands there is no rate.
        """
        rate = self.log.get("rate_hz")
        if rate is None:
            return None
        if isinstance(rate, int | float) and 0.0 < rate < np.inf and not isinstance(rate, bool):
            return float(rate)
        raise LogError(
            f"rate_hz is no rate: {rate}",
            field="log",
            remedy="write the rows a second, as `log: {rate_hz: 250}`",
        )

    def ignores(self, column: str) -> bool:
        """Whether a column is left out: its name, brackets and all, or a pattern of it."""
        return any(column == mark or fnmatchcase(column, mark) for mark in self.ignore)


@raised_as(LogError)
def read_map(path: Path) -> Map:
    """Read a ``map.yaml``; every mistake in it is said at once.

    What is advised stands in lines, several of which may begin with the same word: they are taken together.

    Raises:
        LogError: the file is missing, is no YAML, or holds unknown fields or values.
    """
    content = read_yaml(path, remedy="see docs/formats.md", sections=True)
    try:
        found = Map.model_validate(content)
    except ValidationError as error:
        faults = [
            f"{'.'.join(str(part) for part in e['loc'])} ({_mapping_advice(e)})" for e in error.errors()
        ]
        raise LogError(
            "has mistakes: " + "; ".join(faults[:20]), source=path, remedy="see `excite schema map`"
        ) from error
    unknown = [name for name in found.columns if name.partition(".")[0] not in CHANNELS]
    if unknown:
        raise LogError(
            f"names no channel: {', '.join(unknown[:5])}",
            source=path,
            field="columns",
            remedy="the channels are " + ", ".join(CHANNELS),
        )
    return found


def _mapping_advice(mistake: ErrorDetails) -> str:
    """What is wrong with a field; where it belongs if it is one of ``log.yaml``."""
    name = str(mistake["loc"][0])
    if mistake["type"] == "extra_forbidden" and len(mistake["loc"]) == 1 and name in LogHeader.model_fields:
        return f"belongs under log: {{{name}: …}}"
    return mistake["msg"].lower()
