"""Which terms beside rigid bodies an arm's log asks for, and how far the nominal model is to be trusted.

Whether a joint has an offset, friction or a rotor is decided by the evidence of the rows (Tipping and Faul 2003),
joint by joint; what drives and sensors may add beyond, and the weight of the nominal model, by what predicts blocks
of the log that are left out, with bodies that can exist. What this leaves of trials left out, beside least squares, is
in docs/measured.md (default_method).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.linalg import LinAlgError

from excite.arrays import Array, Flags, Indices
from excite.errors import InputError, NoSolutionError
from excite.finding import Finding, list_names
from excite.identification.estimators.conic import Adaptive, AdaptiveSettings
from excite.identification.estimators.estimator import Estimator
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import (
    Regression,
    condense_problem,
    iterate_weights,
    prior_std,
    square_factor,
)
from excite.identification.statistics import base_statistics
from excite.logs.log import Log
from excite.regressor.base_parameters import r_factor
from excite.rows.drive_terms import DRIVE_TERMS, EXTENSIONS
from excite.rows.joint_rows import drive_terms, usual_terms
from excite.rows.settings import ProblemSettings

# Blocks that are left out in turn. Fewer leave too little of short logs to learn from.
_BLOCKS = 5
_STEP = 10.0
_WEIGHTS = (1e-3, 1e2)
# Evidence that differs by less is the same [nats]: where steps of the search end.
_SAME_EVIDENCE = 1e-6
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


@dataclass(frozen=True)
class Candidates:
    """Terms of an arm's equations that the log is asked about.

    Attributes:
        by_evidence: terms that each joint has or has not, as the evidence of the rows says.
        by_blocks: terms that are added where they predict blocks left out.
        expected: terms that the log's header names, or that joints have as a rule where it names none.
    """

    by_evidence: tuple[str, ...] = ()
    by_blocks: tuple[str, ...] = ()
    expected: tuple[str, ...] = ()


def without_terms(problem: IdentificationProblem, terms: Sequence[str]) -> IdentificationProblem:
    """The problem without the columns of some terms."""
    return problem.with_drives([name for name in problem.parameter_names if _term_name(name) not in terms])


def list_candidates(
    log: Log, settings: ProblemSettings | None, own: AdaptiveSettings
) -> tuple[ProblemSettings | None, Candidates]:
    """Settings of a problem with the columns of all terms that an arm may have, and which of these are in question.

    Terms that the problem's settings state are none of them: they stay, whatever the log says. Those that the log's
    header names as modelled are in question, as is what it does not name.
    """
    if log.header.free_base or own.terms == "stated":
        return settings, Candidates()
    settings = settings or ProblemSettings()
    there = drive_terms(log.header, settings)
    usual: tuple[str, ...] = ()
    if settings.drive_terms is None:
        usual = tuple(dict.fromkeys((*there, *usual_terms(log.header))))
    added = tuple(name for name in EXTENSIONS if name not in there)
    asked = tuple(name for name in usual if name not in EXTENSIONS)
    columns = tuple(dict.fromkeys((*there, *usual, *added)))
    return replace(settings, drive_terms=columns), Candidates(asked, added, there)


def with_shown_drives(
    problem: IdentificationProblem, candidates: Candidates, own: AdaptiveSettings
) -> IdentificationProblem:
    """The problem without the drives' parameters that the evidence of the rows speaks against.

    Parameters whose nominal value is not zero stay: the robot's description states them.
    """
    names = problem.parameter_names
    asked = np.array([_term_name(name) in candidates.by_evidence for name in names]) & (problem.prior == 0.0)
    asked[: problem.n_inertial] = False
    if not asked.any():
        return problem
    asked_of = dict(zip(names, asked.tolist(), strict=True))
    plain = without_terms(problem, candidates.by_blocks)
    rows = iterate_weights(condense_problem(plain))
    noise = base_statistics(rows).noise
    factor = rows.weighted(noise.std, noise).independent_factor
    target = factor[:, -1] - factor[:, :-1] @ plain.prior
    scales = prior_std(plain, own.spreads(plain.robot))
    in_question = np.array([asked_of[name] for name in plain.parameter_names])
    spread = evident_spreads(factor[:, :-1] * scales, target, in_question)
    shown = {name for name, value in zip(plain.parameter_names, spread.tolist(), strict=True) if value > 0.0}
    return problem.with_drives({name for name in names if name in shown or not asked_of[name]})


def evident_spreads(matrix: Array, target: Array, in_question: Flags) -> Array:
    """Standard deviations of parameters about zero under which a measurement is most probable.

    ``target = matrix · x + noise`` of unit variance, ``x ~ N(0, diag(s²))`` with ``s = 1`` where nothing is in
    question. The others' are those of greatest evidence, found one by one, the one that gains most first; exactly zero
    where the rows speak against the parameter, ``q² ≤ s`` in the symbols of Tipping and Faul (AISTATS 2003).

    Args:
        matrix: ``(m, n)``.
        target: ``(m,)``.
        in_question: ``(n,)``.

    Returns:
        ``(n,)``, in units of the columns' scales.
    """
    spread = np.ones(matrix.shape[1])
    certain, count = int((~in_question).sum()), int(in_question.sum())
    stacked = np.zeros((len(matrix) + certain, certain + count + 1))
    stacked[: len(matrix)] = np.column_stack([matrix[:, ~in_question], matrix[:, in_question], target])
    stacked[len(matrix) :, :certain] = np.eye(certain)
    # What is certain to be there is orthogonalised away, which leaves few and well-scaled numbers.
    rest = square_factor(stacked)[certain:, certain:]
    columns, measured = rest[:, :-1], rest[:, -1]
    variance = np.ones(count)
    while True:
        own, pull = _without_itself(columns, measured, variance)
        usable = own > np.finfo(float).eps * (columns**2).sum(axis=0)
        best = np.where(usable, np.maximum(pull**2 - own, 0.0) / np.where(usable, own, 1.0) ** 2, 0.0)
        gain = np.where(
            variance == best, 0.0, _log_evidence_of(best, own, pull) - _log_evidence_of(variance, own, pull)
        )
        gain[~usable & (variance > 0.0)] = np.inf
        place = int(np.argmax(gain))
        if gain[place] < _SAME_EVIDENCE:
            break
        variance[place] = best[place]
    spread[in_question] = np.sqrt(variance)
    return spread


def _without_itself(columns: Array, measured: Array, variance: Array) -> tuple[Array, Array]:
    """``s = aᵀC⁻¹a`` and ``q = aᵀC⁻¹y`` of each column, ``C = I + Σ v a aᵀ`` over all columns but its own."""
    count, root = len(variance), np.sqrt(variance)
    q, r = np.linalg.qr(np.vstack([columns * root, np.eye(count)]))
    inverse = np.linalg.inv(r)
    share = (inverse**2).sum(axis=1)
    mean = inverse @ (q[: len(columns)].T @ measured)
    apart = np.vstack([columns, np.zeros((count, count))])
    apart -= q @ (q.T @ apart)
    there = variance > 0.0
    v = np.where(there, variance, 1.0)
    own = np.where(there, (1.0 / share - 1.0) / v, (apart**2).sum(axis=0))
    pull = np.where(there, mean / np.sqrt(v) / share, apart[: len(columns)].T @ measured)
    return own, pull


def _log_evidence_of(variance: Array, own: Array, pull: Array) -> Array:
    """Logarithm of the evidence of each parameter's variance, all others fixed, less that of a variance of zero."""
    grown = 1.0 + variance * own
    return np.asarray(0.5 * (variance * pull**2 / grown - np.log(grown)))


def with_terms_of(
    identified: IdentifiedParameters, log: Log, settings: ProblemSettings | None
) -> ProblemSettings:
    """Settings of a problem that has the columns of all that was identified, and maybe others."""
    settings = settings or ProblemSettings()
    if log.header.measures_contacts:
        return settings
    terms = tuple(dict.fromkeys(_term_name(name) for name in identified.drive_names))
    return replace(settings, drive_terms=terms)


def drives_finding(
    asked: Candidates, names: Sequence[str], identified: IdentifiedParameters
) -> tuple[Finding, ...]:
    """Where the log's drives are not what its header names, in a sentence; empty where they are.

    Args:
        asked: the terms that were in question.
        names: parameters of the problem before.
        identified: what is left of them, with values.
    """
    kept = identified.by_drive()
    places = tuple(
        name
        for name in kept
        if _term_name(name) in asked.by_evidence and _term_name(name) not in asked.expected
    )
    absent = [name for name in names if name not in kept and _term_name(name) in asked.by_evidence]
    gone = tuple(name for name in absent if _term_name(name) in asked.expected)
    parts = []
    if places:
        shown = list_names([f"{name} {kept[name]:+.3g}" for name in places], 5)
        parts.append(f"the rows show what the log's header does not name: {shown}")
    if gone:
        parts.append(f"they show nothing of, and left out is: {list_names(gone, 5)}")
    if not parts:
        return ()
    values = {name: kept[name] for name in places}
    return (Finding("drives", "; ".join(parts), values, (*places, *gone)),)


def adaptation_finding(found: Adaptation, identified: IdentifiedParameters) -> tuple[Finding, ...]:
    """What was added to rigid bodies, in a sentence; empty where nothing was."""
    if not found.terms:
        return ()
    drives = {name: value for name, value in identified.by_drive().items() if _term_name(name) in found.terms}
    largest = sorted(
        drives, key=lambda name: -abs(drives[name]) / (DRIVE_TERMS[_term_name(name)].spread or 1.0)
    )
    named = list_names([f"{name} {drives[name]:+.3g}" for name in largest], 3)
    words = list_names([_WORDS[term] for term in found.terms])
    text = (
        f"rigid bodies and friction alone do not explain the torques: with {words} they leave {found.left:.0%} of the "
        f"mean square on blocks left out, most of it by {named}; `excite diagnose` tells what it is. Standard "
        "deviations are those of bodies and friction without these terms"
    )
    return (Finding("extension", text, {"left": found.left, "alpha": found.alpha, **drives}, found.terms),)


def adapt_problem(
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
        settings: of the estimator, each taken where it is better than those before it; a stated ``alpha`` stays, as do
            the terms where they are ``stated``.
        estimator: finds bodies that can exist.
        addable: the terms that may be added.

    Returns:
        What was chosen, and the settings with it.
    """
    trial = _Trial(_block_triangles(problem), plain, problem, estimator, tuple(addable))
    own = settings[0]
    first = best = trial.left((), own)
    for other in settings[1:]:
        found = trial.left((), other)
        if _is_better(found, best):
            own, best = other, found
    if not np.isfinite(best).all():
        return Adaptation((), own.alpha or 1.0, 1.0), own
    chosen: tuple[str, ...] = ()
    rest = list(addable)
    while rest:
        tried = {term: trial.left((*chosen, term), own) for term in rest}
        term = min(rest, key=lambda name: float(tried[name].mean()))
        if not _is_better(tried[term], best):
            break
        chosen, best = (*chosen, term), tried[term]
        rest.remove(term)
    if own.alpha is None:
        own, best = _choose_weight(trial, chosen, own, best)
    return Adaptation(chosen, own.alpha or 1.0, float(np.exp(best.mean() - first.mean()))), own


def predicts_better(
    problem: IdentificationProblem, plain: Regression, settings: EstimatorSettings, other: EstimatorSettings
) -> bool:
    """Whether blocks left out are predicted better with the spreads of ``other``, by bodies that can exist.

    Evidence takes what soft tissue, markers and filters leave for independent noise, and so for more than it says;
    blocks that are left out hold it too, and there it does not repeat. Of six simulated people, whose segments all
    differ from the table's, evidence believed one to be changed in a single segment, and its intervals then held 73 %;
    blocks believed none. Both believe G1, TALOS and HRP-2-like with 2 to 5 kg added.

    Args:
        plain: the rows, condensed and weighted.
        other: the spreads that are asked about.
    """
    trial = _Trial(_block_triangles(problem), plain, problem, Adaptive(), ())
    first, second = (
        trial.left((), AdaptiveSettings(one.prior_spread, one.segment_spread, one.total_mass, alpha=1.0))
        for one in (settings, other)
    )
    return _is_better(second, first)


def beats_nominal(
    problem: IdentificationProblem, plain: Regression, estimator: Estimator[Any], settings: EstimatorSettings
) -> bool:
    """Whether an estimator predicts blocks left out better than the nominal model, by more than a standard error.

    Args:
        plain: the rows, condensed.
    """
    # What the nominal model leaves is the measure: of few rows the estimator's own residual is too small.
    std = np.sqrt(plain.residual_variances(problem.prior))[problem.channel]
    block, left = _assign_blocks(problem), np.empty((2, _BLOCKS))
    for b in range(_BLOCKS):
        out = block == b
        try:
            found = estimator.estimate(problem.with_rows(~out), settings).parameters
        except (NoSolutionError, LinAlgError, InputError):
            return False
        for row, parameters in zip(left, (problem.prior, found), strict=True):
            row[b] = np.log(np.mean((problem.residual(parameters)[out] / std[out]) ** 2))
    return _is_better(left[1], left[0])


def _choose_weight(
    trial: _Trial, terms: tuple[str, ...], settings: AdaptiveSettings, best: Array
) -> tuple[AdaptiveSettings, Array]:
    """Settings with the best weight of the nominal model: down in steps as long as that helps, else up."""
    alpha = 1.0
    for factor in (1.0 / _STEP, _STEP):
        while _WEIGHTS[0] < alpha * factor < _WEIGHTS[1]:
            found = trial.left(terms, replace(settings, alpha=alpha * factor))
            if not _is_better(found, best):
                break
            alpha, best = alpha * factor, found
        if alpha != 1.0:
            break
    return replace(settings, alpha=alpha), best


def _is_better(found: Array, best: Array) -> bool:
    """Whether blocks left out are predicted better by more than one standard error of the gain (Breiman 1984)."""
    if not np.isfinite(found).all():
        return False
    gain = best - found
    error = float(gain.std(ddof=1)) / np.sqrt(len(gain))
    return bool(gain.mean() > error)


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
        squares = np.full(len(self.factors), np.inf)
        for block, judged in enumerate(self.factors):
            rows = self._join_blocks(np.delete(self.factors, block, axis=0), terms)
            try:
                parameters = self.estimator.solve(rows, settings).parameters
            except (NoSolutionError, LinAlgError):
                return np.full(len(self.factors), np.inf)
            misfit = np.einsum("cij,j->ci", judged, np.append(parameters, -1.0)) / self.plain.std[:, None]
            squares[block] = np.sum(misfit**2)
        return np.asarray(np.log(squares))

    def _join_blocks(self, factors: Array, terms: tuple[str, ...]) -> Regression:
        """Blocks together, with some of the terms that may be added."""
        problem = _at_zero(self.problem, set(self.addable) - set(terms))
        joined = np.array([square_factor(np.vstack(list(parts))) for parts in factors.transpose(1, 0, 2, 3)])
        return Regression(problem, (), joined, self.plain.std, self.plain.noise)


def _at_zero(problem: IdentificationProblem, terms: set[str]) -> IdentificationProblem:
    """The problem in which some terms stay at zero."""
    if problem.drive_spread is None:
        return problem
    out = [_term_name(name) in terms for name in problem.parameter_names[problem.n_inertial :]]
    return replace(problem, drive_spread=np.where(out, _OUT * problem.drive_spread, problem.drive_spread))


def _block_triangles(problem: IdentificationProblem) -> Array:
    """Triangles of the rows of each block and channel; blocks are stretches of time of equal numbers of rows."""
    block = _assign_blocks(problem)
    width, channels = problem.n_params + 1, len(problem.channel_names)
    factors = np.zeros((_BLOCKS, channels, width, width))
    for b in range(_BLOCKS):
        for c in range(channels):
            rows = (block == b) & (problem.channel == c)
            r = r_factor(np.column_stack([problem.Y[rows], problem.y[rows]]))
            factors[b, c, : len(r)] = r
    return factors


def _assign_blocks(problem: IdentificationProblem) -> Indices:
    """Which block each row belongs to, ``(n_rows,)``."""
    place = np.empty(problem.n_rows, dtype=np.int64)
    place[np.lexsort((problem.time, problem.trial))] = np.arange(problem.n_rows)
    return place * _BLOCKS // problem.n_rows


def _term_name(name: str) -> str:
    return name.split(".")[0]
