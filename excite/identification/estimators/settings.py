"""Settings of the estimators: each declared once, with unit, bounds and meaning."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.errors import InputError, UnknownNameError
from excite.identification.physical.known_bounds import KnownBounds
from excite.reading.number import check_number
from excite.robot.robot import Robot

_MAY_BE_NONE = ("total_mass", "symmetry", "mirror")


def _setting(default: float | None, unit: str, low: float, high: float, what: str) -> Any:
    """One numeric setting: default, unit, bounds (both allowed) and meaning, declared once."""
    return field(default=default, metadata={"unit": unit, "low": low, "high": high, "what": what})


def _choice(default: str, options: tuple[str, ...], what: str) -> Any:
    """One setting that is a word: default, allowed words and meaning, declared once."""
    return field(default=default, metadata={"options": options, "what": what})


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
        ls_reference: ``zero`` is ``Y⁺f`` (eq. 5 of Jovic et al. 2016), ``nominal`` counts distances in units of
            the spreads.
        regulariser: distance from the nominal model in ``lmi``; ``pullback`` and ``entropic`` are those of
            Lee, Wensing and Park 2020, which do not depend on units or frames.
        sphere_epsilon: the ε of eq. (13) of Jovic et al. 2016, absolute as there.
        mirror: the α of eq. (15) of Jovic et al. 2016; None leaves the left and right side free.
        asymmetric: links that need not mirror the other side's; a pair is free where either of its two is named.
        mass_range: the β of eq. (16) of Jovic et al. 2016; there 0.35 for modified segments, 0.05 for others.
        segment_mass_range: ``mass_range`` of single segments, by link.
        bound_width: bounds of ``cls1`` and ``cls2`` about nominal, where ``parameter_bounds`` are not given.
        parameter_bounds: lower and upper bound of every parameter, ``(2, n_params)`` [SI], ±inf for none.
        bounds: what is known of masses, centres of mass, inertias about these, and drives; for methods whose
            ``bounded`` is true.
        com_ellipsoids: where each centre of mass lies, ``(n_segments, 4, 4)``: ``[x; 1]ᵀ Q [x; 1] ≥ 0`` for
            points ``x`` [m] of the ellipsoid in the joint frame (eq. 6 of Golluccio et al. 2020); None derives them
            from the boxes.
        body_ellipsoids: where each body's mass lies, likewise.
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
    ls_reference: str = _choice("zero", ("zero", "nominal"), "which of equally good solutions ls gives")
    weight_iterations: int = _setting(10, "1", 0, 100, "rounds of reweighting in wls; 0 keeps stated weights")
    huber: float = _setting(
        1.345, "1", 0.1, 100.0, "residual, in robust deviations, beyond which rows count less"
    )
    regulariser: str = _choice(
        "euclidean", ("euclidean", "pullback", "entropic"), "distance from the nominal model in lmi"
    )
    sphere_epsilon: float = _setting(0.01, "kg·m²", 0.0, 1e3, "least moment of inertia in hqp")
    mirror: float | None = _setting(0.1, "1", 0.0, 1.0, "relative left/right difference in hqp")
    asymmetric: tuple[str, ...] = ()
    mass_range: float = _setting(
        0.35, "1", 0.0, 1e6, "range of masses about nominal in hqp, as share of them"
    )
    segment_mass_range: Mapping[str, float] = field(default_factory=dict)
    bound_width: float = _setting(
        3.0, "1", 1e-3, 1e6, "half width of the bounds of cls1 and cls2, in spreads"
    )
    parameter_bounds: Array | None = None
    bounds: KnownBounds | None = None
    com_ellipsoids: Array | None = None
    body_ellipsoids: Array | None = None

    def spreads(self, robot: Robot) -> Array:
        """Spread of each segment's mass about the nominal one, as share of it, ``(n_segments,)``."""
        return np.array([self.segment_spread.get(s.link, self.prior_spread) for s in robot.segments])

    def free_of_symmetry(self, robot: Robot) -> tuple[int, ...]:
        """Segments that ``asymmetric`` names; raises UnknownNameError for a link that is no segment."""
        links = _known_segments(robot, self.asymmetric)
        return tuple(links.index(name) for name in self.asymmetric)

    def mass_ranges(self, robot: Robot) -> Array:
        """β of eq. (16) of Jovic et al. 2016 for each segment, ``(n_segments,)``; raises UnknownNameError."""
        _known_segments(robot, self.segment_mass_range)
        return np.array([self.segment_mass_range.get(s.link, self.mass_range) for s in robot.segments])

    def __post_init__(self) -> None:
        """Check every bound.

        Raises:
            InputError: a number out of bounds; names the setting.
        """
        _check_segments(self.segment_spread, "segment_spread", 1e-6, 1e6)
        _check_segments(self.segment_mass_range, "segment_mass_range", 0.0, 1e6)
        for item in fields(self):
            value = getattr(self, item.name)
            if not item.metadata or (value is None and item.name in _MAY_BE_NONE):
                continue
            if "options" in item.metadata:
                if value not in item.metadata["options"]:
                    raise InputError(
                        f"is {value!r}",
                        source="settings",
                        field=item.name,
                        remedy="choose " + " or ".join(item.metadata["options"]),
                    )
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


def _known_segments(robot: Robot, names: Iterable[str]) -> list[str]:
    """Links of the segments, in their order; raises UnknownNameError for a name that is none of them."""
    links = [segment.link for segment in robot.segments]
    for name in names:
        if name not in links:
            massive = robot.nominal_parameters[::10] > 0.0
            known = [link for link, body in zip(links, massive, strict=True) if body]
            raise UnknownNameError("segment", name, known)
    return links


def _check_segments(shares: Mapping[str, float], name: str, low: float, high: float) -> None:
    for link, share in shares.items():
        check_number(share, f"{name}.{link[:60]}", low, high, source="settings")
