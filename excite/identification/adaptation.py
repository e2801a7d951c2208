"""How far the nominal model is to be trusted, and which terms beside rigid bodies an arm's log asks for.

Both are chosen by what predicts blocks of the log that are left out, with bodies that can exist. On public logs of
arms (UR10e, Panda, LWR 4+, AirBot Play, TX40, TIAGo) such bodies alone leave 0.94 to 1.5 times the error of least
squares on trials left out; with what is chosen here, 0.71 to 0.98 times (docs/measured.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.linalg import LinAlgError

from excite.arrays import Array
from excite.errors import NoSolutionError
from excite.finding import Finding, listed
from excite.identification.estimators.conic.adaptive import Adaptive, AdaptiveSettings
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.noise.correlated import triangle
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, square_factor
from excite.logs.log import Log
from excite.rows.drive_terms import DRIVE_TERMS, EXTENSIONS
from excite.rows.joint_rows import drive_terms
from excite.rows.settings import ProblemSettings

# Blocks that are left out in turn. Fewer leave too little of short logs to learn from.
_BLOCKS = 5
# What a term or another weight has to take of the mean square left over, in the logarithm, on blocks left out: more
# than its own standard error over the blocks, and more than this. Of the public logs' helpful terms none takes less
# than 0.024; on simulated arms without such effects none takes more than 0.01.
_LEAST_GAIN = 0.02
_STEP = 10.0
_WEIGHTS = (1e-3, 1e2)
# Standard deviation of a term that is left out, as share of its own: it then stays at zero.
_OUT = 1e-9
# Tried and left out: a first harmonic of each joint's own angle, as cables pull. With it the LWR's last joint leaves a
# ninth of its mean square on blocks left out, of either of two trajectories, and yet the other trajectory is predicted
# worse by a ninth in all; in parts of the Panda's first two thirds it is chosen at another joint each time.
_WORDS = {
    "gain": "factors on the torques",
    "load_friction": "friction that grows with the load",
    "bending": "cross-talk of the moments across the axes",
}


@dataclass(frozen=True)
class Adaptation:
    """What was chosen.

    Attributes:
        terms: added terms, the most helpful first.
        alpha: weight of the nominal model.
        left: mean square that was left on blocks left out, as share of what bodies alone leave at ``alpha`` 1.
    """

    terms: tuple[str, ...]
    alpha: float
    left: float


def without_terms(problem: IdentificationProblem, terms: Sequence[str]) -> IdentificationProblem:
    """The problem without the columns of some terms."""
    names = problem.parameter_names
    columns = np.array([k for k, name in enumerate(names) if _term(name) not in terms])
    if len(columns) == len(names):
        return problem
    drives = columns[columns >= problem.n_inertial] - problem.n_inertial
    return replace(
        problem,
        Y=problem.Y[:, columns],
        parameter_names=tuple(names[k] for k in columns),
        prior=problem.prior[columns],
        drive_spread=None if problem.drive_spread is None else problem.drive_spread[drives],
    )


def extended(
    log: Log, settings: ProblemSettings | None, own: AdaptiveSettings
) -> tuple[ProblemSettings | None, tuple[str, ...]]:
    """Settings of a problem with the columns of all terms that may be added to an arm's equations, and these terms.

    A term that is stated is none that may be added: it stays, whatever the log says of it.
    """
    if log.header.free_base or own.terms == "stated":
        return settings, ()
    settings = settings or ProblemSettings()
    stated = drive_terms(log.header, settings)
    added = tuple(name for name in EXTENSIONS if name not in stated)
    return replace(settings, drive_terms=(*stated, *added)), added


def with_terms_of(
    identified: IdentifiedParameters, log: Log, settings: ProblemSettings | None
) -> ProblemSettings:
    """Settings of a problem whose columns are those of what was identified, added terms among them."""
    settings = settings or ProblemSettings()
    there = {_term(name) for name in identified.drive_names}
    added = [name for name in EXTENSIONS if name in there]
    if log.header.free_base or not added:
        return settings
    stated = drive_terms(log.header, settings)
    return replace(settings, drive_terms=(*stated, *(name for name in added if name not in stated)))


def adaptation_finding(found: Adaptation, identified: IdentifiedParameters) -> tuple[Finding, ...]:
    """What was added to rigid bodies, in a sentence; empty where nothing was."""
    if not found.terms:
        return ()
    drives = {name: value for name, value in identified.by_drive().items() if _term(name) in found.terms}
    largest = sorted(drives, key=lambda name: -abs(drives[name]) / (DRIVE_TERMS[_term(name)].spread or 1.0))
    named = listed([f"{name} {drives[name]:+.3g}" for name in largest], 3)
    words = listed([_WORDS[term] for term in found.terms])
    text = (
        f"rigid bodies and friction alone do not explain the torques: with {words} they leave {found.left:.0%} of the "
        f"mean square on blocks left out, most of it by {named}; `excite diagnose` tells what it is. Standard "
        "deviations are those of bodies and friction without these terms"
    )
    return (Finding("extension", text, {"left": found.left, "alpha": found.alpha, **drives}, found.terms),)


def adapt(
    problem: IdentificationProblem,
    plain: Regression,
    settings: Sequence[AdaptiveSettings],
    estimator: Adaptive,
    addable: Sequence[str],
) -> tuple[Adaptation, AdaptiveSettings]:
    """Choose settings, then terms, one at a time and the most helpful first, then the nominal model's weight.

    Args:
        problem: rows with the columns of all terms that may be added.
        plain: the rows without them, condensed and weighted; its weights and noise are used throughout.
        settings: of the estimator, one after another taken where it is better than those before it; a stated
            ``alpha`` stays, as do the terms where they are ``stated``.
        estimator: finds bodies that can exist.
        addable: the terms that may be added.

    Returns:
        What was chosen, and the settings with it.
    """
    trial = _Trial(_blocks(problem), plain, problem, estimator, tuple(addable))
    own = settings[0]
    first = best = trial.left((), own)
    for other in [item for item in settings[1:] if item != own]:
        found = trial.left((), other)
        if _better(found, best):
            own, best = other, found
    if not np.isfinite(best).all():
        return Adaptation((), own.alpha or 1.0, 1.0), own
    chosen: tuple[str, ...] = ()
    rest = list(addable)
    while rest:
        tried = {term: trial.left((*chosen, term), own) for term in rest}
        term = min(rest, key=lambda name: float(tried[name].mean()))
        if not _better(tried[term], best):
            break
        chosen, best = (*chosen, term), tried[term]
        rest.remove(term)
    if own.alpha is None:
        own, best = _weighted(trial, chosen, own, best)
    return Adaptation(chosen, own.alpha or 1.0, float(np.exp(best.mean() - first.mean()))), own


def _weighted(
    trial: _Trial, terms: tuple[str, ...], settings: AdaptiveSettings, best: Array
) -> tuple[AdaptiveSettings, Array]:
    """Settings with the best weight of the nominal model: down in steps as long as that helps, else up."""
    alpha = 1.0
    for factor in (1.0 / _STEP, _STEP):
        while _WEIGHTS[0] < alpha * factor < _WEIGHTS[1]:
            found = trial.left(terms, replace(settings, alpha=alpha * factor))
            if not _better(found, best):
                break
            alpha, best = alpha * factor, found
        if alpha != 1.0:
            break
    return replace(settings, alpha=alpha), best


def _better(found: Array, best: Array) -> bool:
    if not np.isfinite(found).all():
        return False
    gain = best - found
    error = float(gain.std(ddof=1)) / np.sqrt(len(gain))
    return bool(gain.mean() > max(_LEAST_GAIN, error))


@dataclass(frozen=True, eq=False)
class _Trial:
    """Factors of blocks and channels, ``(n_blocks, n_channels, n_params + 1, n_params + 1)``, and what judges them."""

    factors: Array
    plain: Regression
    problem: IdentificationProblem
    estimator: Adaptive
    addable: tuple[str, ...]

    def left(self, terms: tuple[str, ...], settings: AdaptiveSettings) -> Array:
        """Logarithm of the mean square left over in each block by what the others say, ``(n_blocks,)``."""
        problem = _at_zero(self.problem, set(self.addable) - set(terms))
        squares = np.full(len(self.factors), np.inf)
        for block, judged in enumerate(self.factors):
            others = np.delete(self.factors, block, axis=0)
            stacked = np.array(
                [square_factor(np.vstack(list(parts))) for parts in others.transpose(1, 0, 2, 3)]
            )
            rows = Regression(problem, (), stacked, self.plain.std, self.plain.noise)
            try:
                parameters = self.estimator.solve(rows, settings).parameters
            except (NoSolutionError, LinAlgError):
                return np.full(len(self.factors), np.inf)
            misfit = np.einsum("cij,j->ci", judged, np.append(parameters, -1.0)) / self.plain.std[:, None]
            squares[block] = np.sum(misfit**2)
        return np.asarray(np.log(squares))


def _at_zero(problem: IdentificationProblem, terms: set[str]) -> IdentificationProblem:
    """The problem in which some terms stay at zero."""
    if problem.drive_spread is None:
        return problem
    out = [_term(name) in terms for name in problem.parameter_names[problem.n_inertial :]]
    return replace(problem, drive_spread=np.where(out, _OUT * problem.drive_spread, problem.drive_spread))


def _blocks(problem: IdentificationProblem) -> Array:
    """Triangles of the rows of each block and channel; blocks are stretches of time of equal numbers of rows."""
    place = np.empty(problem.n_rows, dtype=np.int64)
    place[np.lexsort((problem.time, problem.trial))] = np.arange(problem.n_rows)
    block = place * _BLOCKS // problem.n_rows
    width, channels = problem.n_params + 1, len(problem.channel_names)
    factors = np.zeros((_BLOCKS, channels, width, width))
    for b in range(_BLOCKS):
        for c in range(channels):
            rows = (block == b) & (problem.channel == c)
            r = triangle(np.column_stack([problem.Y[rows], problem.y[rows]]))
            factors[b, c, : len(r)] = r
    return factors


def _term(name: str) -> str:
    return name.split(".")[0]
