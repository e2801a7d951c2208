"""An effect's form in a MuJoCo model of a standing robot: a part of the model, or a note beside it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class Part(StrEnum):
    """A part of a model that is written from the state with all effects in it."""

    BODIES = "body mass, pos and inertia"
    LENGTHS = "body pos"
    SENSORS = "pos and quat of the site that is the sensor"


class Beyond(StrEnum):
    """Why a model cannot have an effect by itself: what its runner then applies to the record."""

    MOTION = "the recorded motion that it is led through is no part of a model"
    READINGS = "what sensors read is no part of a model"
    FORCES = "a force that depends on the motion, or that comes and goes, is no part of a model"


@dataclass(frozen=True)
class StandingNote:
    """An effect beside a model, for the runner to apply.

    Attributes:
        word: the library's word for its form.
        location: its place.
        parameters: by name, in order, SI.
        holds: what it has learnt beside these, ready for JSON.
        beyond: why the model cannot have it.
    """

    word: str
    location: str
    parameters: Mapping[str, float]
    holds: Mapping[str, Any]
    beyond: Beyond

    def text(self) -> str:
        """Parameters and all else as JSON."""
        return json.dumps({"parameters": dict(self.parameters), **self.holds})
