"""Settings that several estimators share; what only one of them knows stands in its own file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.arrays import Array
from excite.errors import UnknownNameError
from excite.formats.number import check_number
from excite.identification.physical.bounds import KnownBounds
from excite.identification.regression import USUAL_SPREAD
from excite.robot.robot import Robot
from excite.rows.settings import SOURCE, check_settings, number

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def shares_by_link(low: float, high: float, what: str) -> Any:
    """Shares of single segments by their link, none by default."""
    return field(default_factory=dict, metadata={"shares": (low, high), "what": what})


def share_limits(settings: DataclassInstance, name: str) -> tuple[float, float]:
    """Least and greatest value that a setting of :func:`shares_by_link` takes."""
    low, high = next(item.metadata["shares"] for item in fields(settings) if item.name == name)
    return float(low), float(high)


def stated(unit: str, what: str) -> dict[str, str]:
    """Metadata of what has a form of its own, such as an array, and is checked where it is used."""
    return {"of": unit, "what": what}


@dataclass(frozen=True)
class EstimatorSettings:
    """Settings that concern every method: how far the nominal model is trusted, and what a scale says.

    Unit, bounds and meaning of a number are in its field's metadata. Each estimator's own settings derive from
    these and from the groups below; :func:`~excite.identification.estimators.method_settings.estimator_settings`
    makes those of a method by its name.

    Attributes:
        prior_spread: Jovic et al. 2016 expect CAD masses to be off by up to 50 %.
        segment_spread: ``prior_spread`` of single segments, by link.
        total_mass: None takes what the measured forces determine, where they do. Methods without a constraint on
            it leave the parameters as they are and compare.

    Raises:
        InputError: a number out of its bounds; names the setting.
    """

    prior_spread: float = number(
        USUAL_SPREAD, "1", 1e-6, 1e6, "spread of masses about nominal, as share of them"
    )
    segment_spread: Mapping[str, float] = shares_by_link(1e-6, 1e6, "prior_spread of single segments")
    total_mass: float | None = number(
        None, "kg", 1e-3, 1e4, "mass of the whole robot, from a scale", optional=True
    )

    def spreads(self, robot: Robot) -> Array:
        """Spread of each segment's mass about the nominal one, as share of it, ``(n_segments,)``."""
        return np.array([self.segment_spread.get(s.link, self.prior_spread) for s in robot.segments])

    def __post_init__(self) -> None:
        """Check every bound.

        Raises:
            InputError: a number out of bounds; names the setting.
        """
        check_settings(self)
        for item in fields(self):
            if "shares" in item.metadata:
                low, high = item.metadata["shares"]
                for link, share in getattr(self, item.name).items():
                    check_number(share, f"{item.name}.{link[:60]}", low, high, source=SOURCE)


@dataclass(frozen=True)
class PullSettings(EstimatorSettings):
    """The pull to the nominal model of eq. (4) of Jovic et al. 2015.

    Attributes:
        alpha: the α of eq. (4), in units in which prior and noise have unit variance.
    """

    alpha: float = number(1.0, "1", 1e-12, 1e12, "weight of the nominal model against the data")


@dataclass(frozen=True)
class BoxSettings(EstimatorSettings):
    """Where centres of mass may lie.

    Attributes:
        com_boxes: lower and upper corner of the box of each segment's centre of mass in its joint frame,
            ``(n_segments, 2, 3)`` [m]; None takes those of the geometry, else uniform boxes of the nominal mass and
            inertia.
    """

    com_boxes: Array | None = field(
        default=None, metadata=stated("m", "box of each segment's centre of mass")
    )


@dataclass(frozen=True)
class BodySettings(BoxSettings):
    """What bodies may be: boxes of their centres of mass, least moments of inertia.

    Attributes:
        inertia_floor: the ε of eq. (13) of Jovic et al. 2016, relative, so that it fits hands and trunks.
    """

    inertia_floor: float = number(
        0.01, "1", 0.0, 0.9, "least moment of inertia, as share of the nominal least one of the segment"
    )


@dataclass(frozen=True)
class PairSettings(EstimatorSettings):
    """Segments that have a twin on the other side.

    Attributes:
        asymmetric: links that need not mirror the other side's; a pair is free where either of its two is named.
    """

    asymmetric: tuple[str, ...] = field(
        default=(), metadata=stated("1", "links that need not mirror the other side")
    )

    def free_of_symmetry(self, robot: Robot) -> tuple[int, ...]:
        """Segments that ``asymmetric`` names; raises UnknownNameError for a link that is no segment."""
        links = known_segments(robot, self.asymmetric)
        return tuple(links.index(name) for name in self.asymmetric)


@dataclass(frozen=True)
class SymmetrySettings(BoxSettings, PairSettings):
    """The linear constraints of eq. (4) of Jovic et al. 2015: boxes of the centres of mass, symmetry.

    Attributes:
        symmetry: None imposes none, 0 equality.
    """

    symmetry: float | None = number(
        None, "1", 0.0, 1.0, "largest relative left/right difference", optional=True
    )


@dataclass(frozen=True)
class StatedBoundsSettings(BodySettings):
    """Bounds that somebody states, and the bodies that bound what is left open.

    Attributes:
        bounds: what is known of masses, centres of mass, inertias about these, and drives.
    """

    bounds: KnownBounds | None = field(
        default=None, metadata=stated("SI", "bounds from a file, load_bounds reads it")
    )


@dataclass(frozen=True)
class ParameterBoundsSettings(StatedBoundsSettings):
    """Bounds of the standard parameters themselves (Golluccio et al. 2020).

    Attributes:
        bound_width: bounds about nominal, where ``parameter_bounds`` are not given.
        parameter_bounds: lower and upper bound of every parameter, ``(2, n_params)`` [SI], ±inf for none.
    """

    bound_width: float = number(3.0, "1", 1e-3, 1e6, "half width of the parameters' bounds, in spreads")
    parameter_bounds: Array | None = field(
        default=None, metadata=stated("SI", "lower, upper bound of each parameter")
    )


def known_segments(robot: Robot, names: Iterable[str]) -> list[str]:
    """Links of the segments, in their order; raises UnknownNameError for a name that is none of them."""
    links = [segment.link for segment in robot.segments]
    for name in names:
        if name not in links:
            massive = robot.nominal_parameters[::10] > 0.0
            known = [link for link, body in zip(links, massive, strict=True) if body]
            raise UnknownNameError("segment", name, known)
    return links
