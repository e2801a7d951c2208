"""Settings of the estimators: each declared once, with unit, bounds and meaning."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from excite.errors import InputError
from excite.robot.robot import Array, Robot


def _setting(default: float | None, unit: str, low: float, high: float, what: str) -> Any:
    """One numeric setting: default, unit, bounds (both allowed) and meaning, declared once."""
    return field(default=default, metadata={"unit": unit, "low": low, "high": high, "what": what})


@dataclass(frozen=True)
class EstimatorSettings:
    """Settings that all estimators share; each uses those that concern it. Unit, bounds and meaning are in
    each field's metadata.

    Attributes:
        alpha: see metadata, as for all others; the α of eq. (4) of Jovic et al. 2015 in units in which prior
            and noise have unit variance.
        prior_spread: Jovic et al. 2016 expect CAD masses to be off by up to 50 %.
        total_mass: None takes what the measured forces determine, where they do.
        inertia_floor: the ε of eq. (13) of Jovic et al. 2016, relative, so that it fits hands and trunks.
        sphere_subdivisions: 5 gives the 10 242 vectors of Jovic et al. 2016.
        symmetry: None imposes none, 0 equality.
        com_boxes: lower and upper corner of the box of each segment's centre of mass in its joint frame,
            ``(n_segments, 2, 3)`` [m]; None takes uniform boxes of the nominal mass and inertia.
        segment_spread: ``prior_spread`` of single segments, by link.
    """

    alpha: float = _setting(1.0, "1", 1e-12, 1e12, "weight of the nominal model against the data")
    prior_spread: float = _setting(0.5, "1", 1e-6, 1e6, "spread of masses about nominal, as share of them")
    total_mass: float | None = _setting(None, "kg", 1e-3, 1e4, "mass of the whole robot, from a scale")
    inertia_floor: float = _setting(
        0.01, "1", 0.0, 0.9, "least moment of inertia, as share of the nominal least one of the segment"
    )
    sphere_subdivisions: int = _setting(5, "1", 0, 6, "subdivisions of the icosahedron of the inertia rows")
    symmetry: float | None = _setting(None, "1", 0.0, 1.0, "largest relative left/right difference")
    com_boxes: Array | None = None
    segment_spread: Mapping[str, float] = field(default_factory=dict)

    def spreads(self, robot: Robot) -> Array:
        """Spread of each segment's mass about the nominal one, as share of it, ``(n_segments,)``."""
        return np.array([self.segment_spread.get(s.link, self.prior_spread) for s in robot.segments])

    def __post_init__(self) -> None:
        """Check every bound.

        Raises:
            InputError: a number out of bounds; names the setting.
        """
        for item in fields(self):
            value = getattr(self, item.name)
            if not item.metadata or (value is None and item.default is None):
                continue
            low, high, unit = item.metadata["low"], item.metadata["high"], item.metadata["unit"]
            number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
            if not number or not low <= value <= high:
                raise InputError(
                    f"is {value!r}",
                    source="settings",
                    field=item.name,
                    remedy=f"choose {low:g} … {high:g}" + ("" if unit == "1" else f" {unit}"),
                )
