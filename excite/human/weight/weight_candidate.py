"""A weight on each segment as a hypothesis: the best fit, and how likely it makes the data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from excite.arrays import Array

BELT_RADIUS = 0.06
"""A belt is worn around a segment: its mass lies at this radius of gyration about its own centre [m]."""
_MARGIN = 0.03
_MOST, _MASS_SPREAD = 0.5, 10.0
# Twenty times as likely, in the natural logarithm.
_CLEAR = 3.0


@dataclass(frozen=True)
class Candidate:
    """A weight on one segment.

    Attributes:
        segment: segment that carries it.
        mass: [kg].
        std: of the mass [kg].
        place: of its centre in the joint frame of the segment [m].
        cost: squared residual that it leaves, in units of the noise.
        evidence: logarithm of the probability of the data with a weight on this segment, up to a constant: the
            fit, less what a place at the segment's edge and parameters that have to be just so take away.
    """

    segment: str
    mass: float
    std: float
    place: tuple[float, float, float]
    cost: float
    evidence: float


@dataclass(frozen=True)
class AddedMass:
    """The likeliest weight and the other segments' best.

    Attributes:
        best: the likeliest.
        candidates: one for each segment, likeliest first.
        nothing: squared residual without any weight.
    """

    best: Candidate
    candidates: tuple[Candidate, ...]
    nothing: float

    @property
    def tied(self) -> tuple[str, ...]:
        """Segments that the data do not tell from the likeliest one, which comes first."""
        return tuple(c.segment for c in self.candidates if self.best.evidence - c.evidence < _CLEAR)

    def to_json(self) -> dict[str, Any]:
        """``{"segment", "tied_segments", "mass_kg", "std_kg", "place_m", "candidates"}``."""
        listed = [
            {
                "segment": c.segment,
                "mass_kg": c.mass,
                "std_kg": c.std,
                "cost": c.cost,
                "evidence": c.evidence,
            }
            for c in self.candidates
        ]
        return {
            "segment": self.best.segment,
            "tied_segments": list(self.tied),
            "mass_kg": self.best.mass,
            "std_kg": self.best.std,
            "place_m": list(self.best.place),
            "candidates": listed,
        }

    def summary(self) -> str:
        """One line."""
        best, second = self.best, self.candidates[1]
        others = ", ".join(self.tied[1:])
        doubt = (
            f"or {others}, which look alike" if others else f"next: {second.segment}, {second.mass:.2f} kg"
        )
        return f"weight worn: {best.mass:.2f} ± {best.std:.2f} kg on {best.segment} ({doubt})"


def best_fit(columns: Array, target: Array, box: Array, body_mass: float) -> Any:
    """Mass and place on a segment that explain the most."""
    lower, upper = box[0] - _MARGIN, box[1] + _MARGIN

    def residual(x: Array) -> Array:
        return columns @ _belt_parameters(x[0], x[1:]) - target

    fits = [
        least_squares(
            residual,
            np.concatenate([[1.0], start]),
            bounds=(np.concatenate([[0.0], lower]), np.concatenate([[_MOST * body_mass], upper])),
            x_scale=np.array([1.0, 0.1, 0.1, 0.1]),
        )
        for start in (0.5 * (lower + upper), np.clip(np.zeros(3), lower + 1e-6, upper - 1e-6))
    ]
    return min(fits, key=lambda fit: fit.cost)


def weight_candidate(link: str, fit: Any, box: Array, noise: float) -> Candidate:
    """A fit as a candidate; its evidence by Laplace's approximation.

    A weight is worn about the middle of a segment: its place is normal about the box's centre with half the box's
    size as deviation. Masses are as likely as each other.
    """
    half = 0.5 * (box[1] - box[0])
    curvature = fit.jac.T @ fit.jac / noise
    off = (fit.x[1:] - box.mean(axis=0)) / half
    total = curvature + np.diag(np.append(_MASS_SPREAD**-2.0, half**-2.0))
    volume = np.linalg.slogdet(total)[1] + 2.0 * float(np.log(half).sum())
    evidence = -0.5 * (2.0 * fit.cost / noise + float(off @ off) + float(volume))
    std = float(np.sqrt(np.linalg.pinv(curvature)[0, 0]))
    x, y, z = (float(value) for value in fit.x[1:])
    return Candidate(link, float(fit.x[0]), std, (x, y, z), 2.0 * float(fit.cost), evidence)


def _belt_parameters(mass: float, place: Array) -> Array:
    """Ten parameters of a belt about the joint frame's origin, pinocchio's order."""
    inertia = mass * ((place @ place + BELT_RADIUS**2) * np.eye(3) - np.outer(place, place))
    six = inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return np.concatenate([[mass], mass * place, six])
