"""Blocks of ``log.yaml``: sensors, feet, trials."""

from __future__ import annotations

from pathlib import PurePosixPath, PureWindowsPath
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

# What numbers and names in a ``log.yaml`` may be: bounds that leave room for any robot, and for no slip of a
# unit.

# A humanoid with hands has 70 joints, a hand of tactile sensors some hundred wrenches.
MAX_NAMES = 1000
# A week of trials of a minute each.
MAX_TRIALS = 10_000
# What file systems take for one name, and for a path [bytes].
_LONGEST_NAME, _LONGEST_PATH = 255, 4096


def _check_number(value: object) -> object:
    """YAML says ``yes`` where a number was forgotten, which would count as one."""
    if isinstance(value, bool):
        raise ValueError("is no number")
    return value


def _check_printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("holds characters that cannot be printed")
    return text


def _check_path(text: str) -> str:
    names = PurePosixPath(_check_printable(text)).parts
    if len(text.encode()) > _LONGEST_PATH or any(len(name.encode()) > _LONGEST_NAME for name in names):
        raise ValueError("is too long for the name of a file")
    return text


def _check_inside(text: str) -> str:
    """Trials lie in the log's folder: it can be copied, and names no other file of whoever reads it."""
    path, windows = PurePosixPath(_check_path(text)), PureWindowsPath(text)
    if path.is_absolute() or windows.drive or windows.is_absolute() or ".." in {*path.parts, *windows.parts}:
        raise ValueError("lies outside the folder of the log: copy the file into it")
    return text


Name = Annotated[str, Field(min_length=1, max_length=_LONGEST_NAME), AfterValidator(_check_printable)]
Text = Annotated[str, Field(min_length=1), AfterValidator(_check_path)]
FileName = Annotated[str, Field(min_length=1), AfterValidator(_check_inside)]

_Finite = BeforeValidator(_check_number)
# Four times the gravity of Jupiter [m/s²].
Acceleration = Annotated[float, _Finite, Field(ge=-100.0, le=100.0)]
# No encoder is read a million times a second, and none that shows a motion less than once [Hz].
Rate = Annotated[float, _Finite, Field(ge=1.0, le=1e6)]
Cutoff = Annotated[float, _Finite, Field(gt=0.0, le=1e6)]
# Places in a world's frame, which may be a map's [m].
Length = Annotated[float, _Finite, Field(ge=-1e7, le=1e7)]
# A full turn, with what rounding adds; more is degrees [rad].
Angle = Annotated[float, _Finite, Field(ge=-6.2832, le=6.2832)]
# Ratios of gears and torques per ampere; the largest gear of a robot has some thousand.
Factor = Annotated[float, _Finite, Field(ge=-1e6, le=1e6)]
Noise = Annotated[float, _Finite, Field(ge=0.0, le=1e6)]
# Seconds; those since 1970 are 1.8e9.
Stamp = Annotated[float, _Finite, Field(ge=-1e10, le=1e10)]


Role = Literal["identification", "validation"]


class HeaderBlock(BaseModel):
    """A mapping of ``log.yaml``: what it does not know is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, allow_inf_nan=False)


class SensorHeader(HeaderBlock):
    """One contact wrench sensor; its pose is given in the frame of the link ``parent``."""

    name: Name
    kind: Literal["foot_ft", "force_plate"]
    parent: Name
    xyz: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    rpy: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    foot: Name
    excludes: tuple[Name, ...] = Field(default=(), max_length=MAX_NAMES)
    noise_force: Noise | None = None
    noise_moment: Noise | None = None


class FootHeader(HeaderBlock):
    """A foot whose contact flag is logged: its link, and corners of its sole in that link's frame, one for a point
    foot, which may be a ball with a radius about a centre [m]."""

    name: Name
    link: Name
    sole: tuple[tuple[Length, Length, Length], ...] = Field(min_length=1, max_length=MAX_NAMES)
    radius: float = Field(default=0.0, ge=0.0, le=1.0)
    centre: tuple[Length, Length, Length] | None = None


class ImuHeader(HeaderBlock):
    """An inertial measurement unit on the base: the link whose frame its readings are in, and their noise."""

    link: Name
    noise_gyro: Noise | None = None
    noise_acceleration: Noise | None = None


class TrialHeader(HeaderBlock):
    """One trial: its file, relative to ``log.yaml``, and what it is for."""

    file: FileName
    role: Role
    session: Name | None = None
    start_s: Stamp | None = None
    repeats: FileName | None = None


class Guess(HeaderBlock):
    """Something that a conversion took for granted, with its reason."""

    what: str
    source: str
    because: str
