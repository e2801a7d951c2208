"""What numbers and names in a ``log.yaml`` may be: bounds that leave room for any robot, and for no slip of a unit."""

from __future__ import annotations

from pathlib import PurePosixPath, PureWindowsPath
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field

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
