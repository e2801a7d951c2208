"""Which segments are not what the model says.

Masses of single segments are determined only in combinations: a revolute joint lets three parameters move
from one side to the other. What can be asked is which smallest set of bodies, changed in all ten parameters,
explains what the nominal model leaves.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import lgamma

import numpy as np
from scipy.linalg import qr

from excite.arrays import Array
from excite.identification.noise.correlated import NoiseModel, whitened_factor
from excite.identification.regression import RANK_TOLERANCE, Regression, prior_std

# Twice the natural logarithm of 20: sets whose criteria lie closer are not told apart.
_TIE = 6.0
_MOST_SEGMENTS = 12
_BEAM = 6
# A body is named only where that makes the measurement e¹⁵ times likelier than the criterion alone asks:
# errors that are no noise (filters, joints that lag, sensors that sit askew) imitate small changes.
_LEAST_EVIDENCE = 15.0
# Deviations by which a change of mass has to differ from zero, so that a quotient by it is near Gaussian.
_SURE = 5.0

Point = tuple[float, float, float]


@dataclass(frozen=True)
class ChangedSegment:
    """A segment whose inertial parameters differ from the model's.

    Attributes:
        segment: readable name.
        link: its link.
        mass_change_kg: identified minus nominal mass [kg].
        std_kg: its standard deviation [kg].
        evidence: how much more likely the measurement is with this segment changed than without, natural
            logarithm (half the difference of the criterion).
        tied_with: links that would explain the measurement as well in its place.
        centre_m: centre of mass of what came or went, in the frame of the segment's joint [m]; None where the rows do
            not say how heavy it is.
        centre_std_m: its standard deviations [m].
    """

    segment: str
    link: str
    mass_change_kg: float
    std_kg: float
    evidence: float
    tied_with: tuple[str, ...]
    centre_m: tuple[float, float, float] | None = None
    centre_std_m: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Changes:
    """The changed segments and what they leave unexplained.

    Attributes:
        segments: by falling evidence.
        explained: share of the nominal model's excess residual power that they explain, 0 to 1.
        dispersion: what remains, per base parameter, in units of the noise's variance: 1 means nothing but
            noise; far above it, something else is wrong with the model or the log.
    """

    segments: tuple[ChangedSegment, ...]
    explained: float
    dispersion: float


def find_changes(rows: Regression, noise: NoiseModel) -> Changes:
    """Find the changed segments by growing sets of whole bodies (a beam of the best), exchange and removal.

    The whitened rows condense to as many independent numbers as there are base parameters; a set of ``k``
    segments is judged by the extended information criterion of Chen and Chen (2008),
    ``b·ln σ² + G/σ² + 10·k·ln b + 2·ln C(n, k) + 30·k``, with ``G`` the whitened residual power above that of
    the full model and ``σ² = max(1, G/b)``: what no set explains widens the noise instead of naming bodies.
    The last term asks for more than chance as the reason of a change.

    Args:
        rows: weighted rows.
        noise: noise of the residuals of the full model.
    """
    search = _Search(rows, noise)
    best: tuple[int, ...] = ()
    beam: list[tuple[int, ...]] = [()]
    # One more level is looked at after the first that brings nothing: two bodies can need each other.
    fruitless = 0
    for _ in range(min(_MOST_SEGMENTS, len(search.candidates))):
        beam = search.grown(beam)
        if search.criterion(beam[0]) < search.criterion(best):
            best, fruitless = beam[0], 0
        elif (fruitless := fruitless + 1) > 1:
            break
    return search.result(search.exchanged(best))


class _Search:
    def __init__(self, rows: Regression, noise: NoiseModel):
        problem = rows.problem
        self.rows = rows
        residual = problem.residual(problem.prior)
        factor = whitened_factor(problem, rows.grids, np.column_stack([problem.Y, residual]), noise)
        n = problem.n_params
        self.matrix, self.target = self._without_drives(factor[:, :n], factor[:, n], problem.n_inertial)
        self.scales = prior_std(problem, 1.0)[: problem.n_inertial]
        norms = np.linalg.norm(self.matrix.reshape(len(self.matrix), -1, 10), axis=(0, 2))
        self.candidates = tuple(int(s) for s in np.flatnonzero(norms > 0.0))
        # Only what some change of parameters could explain is of interest here.
        u = _range(self.matrix * self.scales)
        self.rank = u.shape[1]
        self.matrix, self.target = u.T @ self.matrix, u.T @ self.target
        self._known: dict[tuple[int, ...], float] = {}

    @staticmethod
    def _without_drives(matrix: Array, target: Array, n_inertial: int) -> tuple[Array, Array]:
        drives = matrix[:, n_inertial:]
        if drives.shape[1] == 0:
            return matrix, target
        u = _range(drives)
        inertial = matrix[:, :n_inertial]
        return inertial - u @ (u.T @ inertial), target - u @ (u.T @ target)

    def gap(self, chosen: tuple[int, ...]) -> float:
        """Whitened residual power that the full model would remove and the set does not."""
        key = tuple(sorted(chosen))
        if key not in self._known:
            rest = self.target
            if key:
                columns = self._columns(key)
                rest = rest - self.matrix[:, columns] @ self._changes(key)[0]
            self._known[key] = float(rest @ rest)
        return self._known[key]

    def criterion(self, chosen: tuple[int, ...]) -> float:
        gap, b, k, n = self.gap(chosen), self.rank, len(chosen), len(self.candidates)
        variance = max(1.0, gap / b)
        sets = lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)
        penalty = 10 * k * np.log(b) + 2.0 * sets + 2.0 * _LEAST_EVIDENCE * k
        return float(b * np.log(variance) + gap / variance + penalty)

    def grown(self, beam: list[tuple[int, ...]]) -> list[tuple[int, ...]]:
        """The best sets with one member more than those of the beam, best first."""
        sets = {tuple(sorted((*chosen, s))) for chosen in beam for s in self.candidates if s not in chosen}
        return sorted(sets, key=lambda key: (self.criterion(key), key))[:_BEAM]

    def exchanged(self, chosen: tuple[int, ...]) -> tuple[int, ...]:
        """Replace or drop members, one at a time, while that improves the criterion."""
        while chosen:
            sets = list(combinations(chosen, len(chosen) - 1))
            sets += [tuple(sorted((*rest, s))) for rest in sets for s in self.candidates if s not in rest]
            best = min(sets, key=lambda key: (self.criterion(key), key))
            if self.criterion(best) >= self.criterion(chosen):
                break
            chosen = best
        return chosen

    def result(self, chosen: tuple[int, ...]) -> Changes:
        dispersion = max(1.0, self.gap(chosen) / self.rank)
        found = []
        if chosen:
            key = tuple(sorted(chosen))
            change, covariance = self._changes(key)
            for place, s in enumerate(key):
                others = tuple(t for t in key if t != s)
                best = self.criterion(key)
                ties = (t for t in self.candidates if t not in key)
                segment = self.rows.problem.robot.segments
                own = slice(10 * place, 10 * place + 4)
                body, spread = change[own], dispersion * covariance[own, own]
                centre, centre_std = _centre(body, spread)
                found.append(
                    ChangedSegment(
                        segment=segment[s].name,
                        link=segment[s].link,
                        mass_change_kg=float(body[0]),
                        std_kg=float(np.sqrt(spread[0, 0])),
                        evidence=0.5 * float(self.criterion(others) - best),
                        tied_with=tuple(
                            segment[t].link for t in ties if self.criterion((*others, t)) < best + _TIE
                        ),
                        centre_m=centre,
                        centre_std_m=centre_std,
                    )
                )
        nothing = self.gap(())
        return Changes(
            segments=tuple(sorted(found, key=lambda item: (-item.evidence, item.link))),
            explained=1.0 - self.gap(chosen) / nothing if nothing > 0.0 else 0.0,
            dispersion=self.gap(chosen) / self.rank,
        )

    def _columns(self, key: tuple[int, ...]) -> Array:
        return np.concatenate([np.arange(10 * s, 10 * s + 10) for s in key])

    def _changes(self, key: tuple[int, ...]) -> tuple[Array, Array]:
        """Changes of a set's parameters and their covariance.

        Neighbours in the set share directions that no motion tells apart; a very wide prior (a body as heavy
        as a hundred of the segment) keeps those finite.
        """
        columns = self._columns(key)
        wide = np.diag(1.0 / (100.0 * self.scales[columns]))
        matrix = np.vstack([self.matrix[:, columns], wide])
        target = np.concatenate([self.target, np.zeros(len(columns))])
        scaled = matrix * self.scales[columns]
        q, r = np.linalg.qr(scaled)
        inverse = np.linalg.inv(r) * self.scales[columns, None]
        return inverse @ (q.T @ target), inverse @ inverse.T


def _centre(body: Array, covariance: Array) -> tuple[Point | None, Point | None]:
    """Where the centre of a change of mass and first moments ``(4,)`` lies, and its standard deviations [m]."""
    if abs(body[0]) < _SURE * np.sqrt(covariance[0, 0]):
        return None, None
    centre = body[1:] / body[0]
    slope = np.column_stack([-centre, np.eye(3)]) / body[0]
    std = np.sqrt(np.einsum("ij,jk,ik->i", slope, covariance, slope))
    return _point(centre), _point(std)


def _point(values: Array) -> Point:
    return float(values[0]), float(values[1]), float(values[2])


def _range(matrix: Array) -> Array:
    """Orthonormal basis of the columns' span, ``(n_rows, rank)``."""
    q, r, _ = qr(matrix, mode="economic", pivoting=True, check_finite=False)
    diagonal = np.abs(np.diag(r))
    return np.asarray(q[:, : int((diagonal > RANK_TOLERANCE * max(float(diagonal[0]), 1e-300)).sum())])
