"""Blocks of ``log.yaml``: sensors, feet, trials."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from excite.logs.header_values import MAX_NAMES, Angle, FileName, Length, Name, Noise, Stamp

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
