"""Logs of several days, gains or speeds: what they agree on and what changes between them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import yaml
from scipy.linalg import cho_factor, cho_solve
from scipy.special import chdtrc, gammaincinv, ndtr, ndtri

from excite.arrays import Array, Flags
from excite.atomic import write_text
from excite.display import Shown, span
from excite.errors import InputError, LogError
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.inertia import FILE_ORDER, ROUNDING, physical_parameters, pseudo_inertia_matrices
from excite.identification.problem import NEVER_NEGATIVE, IdentificationProblem, build_problem
from excite.identification.regression import (
    RANK_TOLERANCE,
    Regression,
    condense_problem,
    iterate_weights,
    prior_std,
)
from excite.identification.statistics import base_statistics, parameter_labels
from excite.logs.log import Log
from excite.regressor.base_parameters import BaseParameters, base_parameters
from excite.results import (
    ADDED,
    FEW,
    HIDDEN,
    Name,
    Positive,
    Stated,
    Unbounded,
    UnboundedPositive,
    added_as,
    stated,
    to_json,
)
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread

# Estimates of several sessions pooled: what they agree on, and how far they lie apart (random effects).

_ROUNDS = 200
_TOLERANCE = 1e-10
_QUANTILES = 100
_BISECTIONS = 60


@dataclass(frozen=True, eq=False)
class Pooled:
    """Parameters over sessions, ``k`` of them.

    Attributes:
        mean: ``(k,)`` pooled values.
        covariance: ``(k, k)`` of ``mean``.
        between: ``(k,)`` standard deviation of the true values from session to session.
        inconsistency: ``(k,)`` share of the spread of the sessions' estimates that is no noise, 0 to 1
            (``I²`` of Higgins and Thompson 2002).
        mean_interval: ``(2, k)`` holds the mean over all possible sessions with the probability asked for.
        next_interval: ``(2, k)`` holds the true value in a session yet to come with that probability.
        level: that probability.
    """

    mean: Array
    covariance: Array
    between: Array
    inconsistency: Array
    mean_interval: Array
    next_interval: Array
    level: float

    def varies(self, n_sessions: int) -> Flags:
        """Which parameters' sessions lie further apart than their own intervals allow, ``(k,)``.

        Cochran's ``Q``, at the intervals' level for all parameters together (Bonferroni).
        """
        q = (n_sessions - 1) / np.maximum(1.0 - self.inconsistency, 1e-12)
        chance = chdtrc(n_sessions - 1, q)
        return np.asarray((self.inconsistency > 0.0) & (chance < (1.0 - self.level) / len(self.mean)))

    @property
    def next_std(self) -> Array:
        """Standard deviation of a normal distribution as wide as ``next_interval``, ``(k,)``."""
        quantile = float(ndtri(0.5 * (1.0 + self.level)))
        return np.asarray(0.5 * (self.next_interval[1] - self.next_interval[0]) / quantile)


def pool_estimates(values: Array, covariances: Array, level: float = 0.95) -> Pooled:
    """Pool estimates by the multivariate random-effects model ``values[s] = mean + b_s + e_s``.

    ``e_s`` has the covariance given, ``b_s`` independent components whose variances are found for each
    parameter by restricted maximum likelihood (Viechtbauer 2005, eq. 8), never below zero.

    Args:
        values: ``(n_sessions, k)`` estimates.
        covariances: ``(n_sessions, k, k)`` of their errors.

    Raises:
        InputError: fewer than two sessions.
    """
    if len(values) < 2:
        raise InputError(
            f"{len(values)} session", field="sessions", remedy="pool at least two, better five or more"
        )
    variances = np.maximum(np.einsum("skk->sk", covariances), 1e-300)
    between = between_variance(values, variances)
    fixed = 1.0 / variances
    center = (fixed * values).sum(axis=0) / fixed.sum(axis=0)
    q = (fixed * (values - center) ** 2).sum(axis=0)
    information, moment = _joint_information(values, covariances, between)
    covariance = np.asarray(np.linalg.inv(information), dtype=float)
    size = np.sqrt(np.diag(covariance))
    return Pooled(
        mean=size * (covariance / np.outer(size, size) @ (size * moment)),
        covariance=covariance,
        between=np.sqrt(between),
        inconsistency=np.clip(1.0 - (len(values) - 1) / np.maximum(q, 1e-300), 0.0, 1.0),
        mean_interval=_parameter_interval(values, variances, level, of_next=False),
        next_interval=_parameter_interval(values, variances, level, of_next=True),
        level=level,
    )


def between_variance(values: Array, variances: Array) -> Array:
    """Variance between sessions of each parameter by restricted maximum likelihood, ``(k,)``.

    Args:
        values: ``(n_sessions, k)``.
        variances: ``(n_sessions, k)`` of the estimates' own errors.
    """
    n = len(values)
    # Units in which a typical error is one, so that one tolerance serves all.
    unit = np.maximum(variances.mean(axis=0), 1e-300)
    y, v = values / np.sqrt(unit), variances / unit
    start = np.maximum(0.0, y.var(axis=0, ddof=1) - v.mean(axis=0))
    between = start
    for _ in range(_ROUNDS):
        w = 1.0 / (v + between)
        mean = (w * y).sum(axis=0) / w.sum(axis=0)
        new = (w**2 * ((y - mean) ** 2 * n / (n - 1) - v)).sum(axis=0) / (w**2).sum(axis=0)
        new = np.maximum(0.0, new)
        done = np.abs(new - between) <= _TOLERANCE * (1.0 + new)
        between = new
        if done.all():
            break
    return np.asarray(between * unit)


def _joint_information(values: Array, covariances: Array, between: Array) -> tuple[Array, Array]:
    """Sum of the inverse covariances and of them times the values."""
    k = values.shape[1]
    information, moment = np.zeros((k, k)), np.zeros(k)
    for value, covariance in zip(values, covariances, strict=True):
        total = covariance + np.diag(between)
        # Parameters of all sizes: scale to unit diagonal before inverting.
        size = np.sqrt(np.diag(total))
        inverse = np.linalg.inv(total / np.outer(size, size)) / np.outer(size, size)
        inverse = 0.5 * (inverse + inverse.T)
        information += inverse
        moment += inverse @ value
    return information, moment


def _parameter_interval(values: Array, variances: Array, level: float, *, of_next: bool) -> Array:
    """Interval of each parameter's mean, or of its value in another session, ``(2, k)``.

    With few sessions the variance between them is hardly known, and an interval that takes its estimate for
    the truth is too narrow. The generalised ``Q(τ²) = Σ w (y − μ)²`` with ``w = 1/(v + τ²)`` is chi-square with
    ``n − 1`` degrees of freedom at the true τ² (Viechtbauer 2007), which gives the confidence distribution of
    τ²; the interval is that of the normal distributions mixed over it (Nagashima, Noma and Furukawa 2019).
    """
    n = len(values)
    unit = np.maximum(variances.mean(axis=0), 1e-300)
    y, v = values / np.sqrt(unit), variances / unit
    center = y.mean(axis=0)
    y = y - center
    wanted = 2.0 * gammaincinv(0.5 * (n - 1), (np.arange(_QUANTILES) + 0.5) / _QUANTILES)[:, None]
    between = _profile_tau(y, v, wanted)
    w = 1.0 / (v[:, None, :] + between)
    total = w.sum(axis=0)
    mean = (w * y[:, None, :]).sum(axis=0) / total
    std = np.sqrt(1.0 / total + (between if of_next else 0.0))
    edges = [_mixture_quantile(mean, std, p) for p in (0.5 * (1.0 - level), 0.5 * (1.0 + level))]
    return np.asarray(np.stack(edges) * np.sqrt(unit) + center * np.sqrt(unit))


def _profile_tau(y: Array, v: Array, wanted: Array) -> Array:
    """τ² at which ``Q`` is ``wanted``, zero where it is smaller for every τ², ``(n_quantiles, k)``."""

    def excess_q(between: Array) -> Array:
        w = 1.0 / (v[:, None, :] + between)
        mean = (w * y[:, None, :]).sum(axis=0) / w.sum(axis=0)
        return np.asarray((w * (y[:, None, :] - mean) ** 2).sum(axis=0) - wanted)

    shape = (len(wanted), y.shape[1])
    low, high = np.zeros(shape), np.broadcast_to((y**2).sum(axis=0) / wanted, shape).copy()
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        above = excess_q(middle) > 0.0
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.asarray(0.5 * (low + high))


def _mixture_quantile(mean: Array, std: Array, probability: float) -> Array:
    """Quantile of equal mixtures of normal distributions, ``(k,)``."""
    reach = 9.0 * std.max(axis=0)
    low, high = mean.min(axis=0) - reach, mean.max(axis=0) + reach
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        below = ndtr((middle - mean) / std).mean(axis=0) < probability
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(0.5 * (low + high))


# Between which ends a base parameter of any robot lies, whatever its bodies and drives are.


def possible_ends(base: BaseParameters, names: Sequence[str], n_inertial: int) -> Array:
    """Lower and upper end of each base parameter, 0 or infinite, ``(2, n_base)``.

    Pseudo-inertias of bodies are positive semidefinite, a cone that is its own dual: a combination of one body's
    parameters is at least zero for every body exactly where the symmetric matrix ``C`` of ``tr(C J(φ)) = c·φ`` is
    positive semidefinite (Wensing, Kim and Slotine, IEEE RA-L 2018, section III). Friction and rotors are at least
    zero, other terms of drives may be anything.

    Args:
        base: base parameters of all columns.
        names: of all parameters, a drive's as ``TERM.JOINT``.
        n_inertial: how many of them are bodies', ten a segment in pinocchio's order.
    """
    # What rounding left of a column that is none of the combination's is nothing.
    largest = np.abs(base.matrix).max(axis=1, keepdims=True, initial=1e-300)
    matrix = np.where(np.abs(base.matrix) > ROUNDING * largest, base.matrix, 0.0)
    unit = pseudo_inertia_matrices(np.eye(10).reshape(-1))
    upper = np.triu_indices(4)
    # Entries off the diagonal stand twice in the trace.
    pairs = unit[:, upper[0], upper[1]] * np.where(upper[0] == upper[1], 1.0, 2.0)
    solution = np.linalg.solve(pairs, matrix[:, :n_inertial].reshape(-1, 10).T).T
    dual = np.zeros((len(solution), 4, 4))
    dual[:, upper[0], upper[1]] = dual[:, upper[1], upper[0]] = solution
    values = np.linalg.eigvalsh(dual).reshape(base.rank, -1, 4)
    size = np.abs(values).max(axis=(1, 2), initial=1e-300)[:, None, None]
    positive = np.array([name.partition(".")[0] in NEVER_NEGATIVE for name in names[n_inertial:]], dtype=bool)
    drives = matrix[:, n_inertial:]
    free = (drives[:, ~positive] == 0.0).all(axis=1)
    low = free & (values >= -ROUNDING * size).all(axis=(1, 2)) & (drives[:, positive] >= 0.0).all(axis=1)
    high = free & (values <= ROUNDING * size).all(axis=(1, 2)) & (drives[:, positive] <= 0.0).all(axis=1)
    return np.array([np.where(low, 0.0, -np.inf), np.where(high, 0.0, np.inf)])


# Ranges of links' and drives' parameters, for domain randomisation in simulators.

SCHEMA = "excite.ranges/1"
_QUANTITIES = (
    ("mass", "kg"),
    *((f"com_{axis}", "m") for axis in "xyz"),
    *((f"inertia_{pair}", "kg·m²") for pair in ("xx", "yy", "zz", "xy", "xz", "yz")),
)
# Mass and moments of inertia are positive: none is less than this share of the nominal one.
_POSITIVE = [0, 4, 5, 6]
_LEAST_SHARE = 0.05
# Moments of inertia, and each product with the moment that its double cannot exceed: 2|Ixy| ≤ Izz, as x² + y² ≥ 2|xy|.
_MOMENTS = [4, 5, 6]
_STEP = 1e-6


@dataclass(frozen=True)
class ParameterRange(Stated):
    """Range of one parameter.

    Attributes:
        link: the link, or the joint for a drive's parameter.
        parameter: ``mass``, ``com_x`` … in the link's joint frame, ``inertia_xx`` … about the centre of mass
            along the axes of that frame, or the name of a drive term.
        low: lower end [SI].
        value: middle [SI].
        high: upper end [SI].
        unit: SI unit.
        measured: share of the nominal model's spread that the data have taken away, 0 to 1.
        clipped: whether the data's interval went on to values that no body has, which are left out.
    """

    link: str
    parameter: str
    low: Unbounded
    value: Unbounded
    high: Unbounded
    unit: str
    measured: float
    clipped: bool = False


def parameter_ranges(
    problem: IdentificationProblem, base: BaseParameters, pooled: Pooled, spread: Array
) -> tuple[ParameterRange, ...]:
    """Ranges that hold the parameters of a session yet to come, with the level of ``pooled``.

    Base parameters are what the data show; a link's own parameters follow from them and from the nominal model
    scattered by ``spread``: the posterior of a Gaussian prior, ``P − P Kᵀ (K P Kᵀ + C)⁻¹ K P`` with ``C`` the
    covariance of the base parameters in another session. Mass, centre of mass and central inertia are
    linearised about the posterior's mean.

    Args:
        problem: rows of one session; for the prior.
        pooled: what the sessions say of them.
        spread: of each segment's mass about nominal, as share of it, ``(n_segments,)``.
    """
    prior = prior_std(problem, spread)
    scaled = base.matrix * prior
    extra = np.maximum(pooled.next_std**2 - np.diag(pooled.covariance), 0.0)
    noise = pooled.covariance + np.diag(extra)
    own = np.sqrt(np.diag(noise))
    scaled, noise = scaled / own[:, None], noise / np.outer(own, own)
    factor = cho_factor(scaled @ scaled.T + noise)
    gap = (pooled.mean - base.matrix @ problem.prior) / own
    mean = problem.prior + prior * (scaled.T @ cho_solve(factor, gap))
    quantile = float(ndtri(0.5 * (1.0 + pooled.level)))
    found: list[ParameterRange] = []
    for s, segment in enumerate(problem.robot.segments):
        if s in problem.unmeasured:
            continue
        part = slice(10 * s, 10 * s + 10)
        block = scaled[:, part]
        whitened = np.eye(10) - block.T @ cho_solve(factor, block)
        covariance = whitened * np.outer(prior[part], prior[part])
        nominal = problem.prior[part]
        if nominal[0] <= 0.0:
            continue
        ten = mean[part]
        if ten[0] <= 0.0:
            # No body: the data contradict the nominal model here, and what is left is its own spread.
            ten, covariance = nominal, np.diag(prior[part] ** 2)
        found += _of_link(segment.link, nominal, ten, covariance, prior[part], quantile)
    drives = range(problem.n_inertial, problem.n_params)
    return (*found, *_of_drives(problem, base, pooled, drives))


def ranges_document(ranges: Sequence[ParameterRange], level: float) -> dict[str, Any]:
    """Ranges as ``excite.ranges/1``: ``links`` and ``joints`` by name, each quantity with low and high."""
    document: dict[str, Any] = {"schema": SCHEMA, "level": level, "links": {}, "joints": {}}
    quantities = {name for name, _ in _QUANTITIES}
    for item in ranges:
        group = document["links" if item.parameter in quantities else "joints"]
        clipped = {"clipped": True} if item.clipped else {}
        entry = item.row("low", "high", "value", "unit", "measured") | clipped
        group.setdefault(item.link, {})[item.parameter] = entry
    return document


def write_document(document: dict[str, Any], path: Path) -> Path:
    """Write a document as YAML, or as JSON where the name ends in ``.json``."""
    if path.suffix == ".json":
        return write_text(path, to_json(document) + "\n")
    return write_text(path, yaml.safe_dump(document, sort_keys=False, allow_unicode=True))


def _of_link(
    link: str, nominal: Array, ten: Array, covariance: Array, prior: Array, quantile: float
) -> list[ParameterRange]:
    """Ten ranges of a link; a parameter that the data say nothing of has that of the nominal model's spread."""
    steps = _STEP * prior
    slopes = np.stack(
        [
            (_link_quantities(ten + step) - _link_quantities(ten - step)) / (2.0 * size)
            for step, size in zip(np.diag(steps), steps, strict=True)
        ],
        axis=1,
    )
    std = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, covariance, slopes), 0.0))
    loose = np.sqrt(slopes**2 @ prior**2)
    middle = _link_quantities(ten)
    floor = np.full(len(_QUANTITIES), -np.inf)
    floor[_POSITIVE] = _LEAST_SHARE * np.abs(_link_quantities(nominal)[_POSITIVE])
    middle = np.maximum(middle, floor)
    wide = np.array([middle - quantile * std, middle + quantile * std])
    low, middle, high = _of_a_body(np.maximum(wide[0], floor), middle, wide[1])
    found = []
    for i, (name, unit) in enumerate(_QUANTITIES):
        measured = float(np.clip(1.0 - (std[i] / max(loose[i], 1e-300)) ** 2, 0.0, 1.0))
        clipped = bool(low[i] > wide[0, i] or high[i] < wide[1, i])
        found.append(
            ParameterRange(
                link, name, float(low[i]), float(middle[i]), float(high[i]), unit, measured, clipped
            )
        )
    return found


class _Ends(NamedTuple):
    """Ends of ranges, and what lies in their middle."""

    low: Array
    middle: Array
    high: Array


def _of_a_body(low: Array, middle: Array, high: Array) -> _Ends:
    """Ends and middles without what no body's inertia can be, whatever the others are within their ranges."""
    low, middle, high = low.copy(), middle.copy(), high.copy()
    for i in _MOMENTS:
        # Each moment is at most the sum of the other two.
        first, second = (k for k in _MOMENTS if k != i)
        high[i] = min(high[i], high[first] + high[second])
        middle[i] = min(middle[i], middle[first] + middle[second])
        low[i] = min(low[i], middle[i])
    for i, moment in {7: 6, 8: 5, 9: 4}.items():
        most = 0.5 * middle[moment]
        middle[i] = np.clip(middle[i], -most, most)
        most = 0.5 * high[moment]
        low[i], high[i] = max(low[i], -most), min(high[i], most)
    return _Ends(low, middle, high)


def _link_quantities(ten: Array) -> Array:
    """Mass, centre of mass, and inertia about it, xx yy zz xy xz yz, ``(10,)``."""
    body = physical_parameters(ten)[0]
    return np.concatenate([body[:4], body[4:][list(FILE_ORDER)]])


def _of_drives(
    problem: IdentificationProblem, base: BaseParameters, pooled: Pooled, columns: range
) -> list[ParameterRange]:
    """Drives' parameters that are base parameters by themselves."""
    place = {int(column): i for i, column in enumerate(base.independent)}
    found = []
    for column in columns:
        if column not in place or np.count_nonzero(base.matrix[place[column]]) != 1:
            continue
        i = place[column]
        term, _, joint = problem.parameter_names[column].partition(".")
        low, high = (float(x) for x in pooled.next_interval[:, i])
        least = 0.0 if term in NEVER_NEGATIVE else -np.inf
        ends = (max(low, least), max(float(pooled.mean[i]), least), max(high, least))
        found.append(ParameterRange(joint, term, *ends, "SI", 1.0, clipped=low < least))
    return found


@dataclass(frozen=True)
class SessionValue(Stated):
    """A base parameter in one session.

    Attributes:
        value: [SI].
        std: its standard deviation [SI].
    """

    value: Unbounded
    std: UnboundedPositive


@dataclass(frozen=True)
class SessionParameter(Stated):
    """A base parameter in all sessions.

    Attributes:
        name: the parameter that stands for it.
        expression: the whole combination.
        value: over the sessions [SI].
        between_std: standard deviation between sessions [SI].
        low: lower end of where the next session's lies [SI].
        high: upper end of it [SI].
        by_session: by session.
        varies: whether sessions lie further apart than their intervals allow.
        std: standard deviation of ``value`` [SI].
        inconsistency: share of the spread of the sessions' estimates that is no noise, 0 to 1.
        mean_low: lower end of where the mean over all possible sessions lies [SI].
        mean_high: upper end of it [SI].
    """

    name: str
    expression: str
    value: Unbounded
    between_std: UnboundedPositive
    low: Unbounded
    high: Unbounded
    by_session: Annotated[Mapping[Name, SessionValue], FEW]
    varies: bool = field(metadata=added_as(False))
    std: UnboundedPositive = field(metadata=ADDED)
    inconsistency: Unbounded = field(metadata=ADDED)
    mean_low: Unbounded = field(metadata=ADDED)
    mean_high: Unbounded = field(metadata=ADDED)


@dataclass(frozen=True, eq=False, repr=False)
class Sessions(Shown, Stated):
    """What several sessions say, each by itself and all together.

    Attributes:
        names: of the sessions.
        base: base parameters that every session determines.
        values: ``(n_sessions, n_base)`` least-squares values [SI].
        std: ``(n_sessions, n_base)`` standard deviations within the sessions.
        pooled: over the sessions.
        ranges: for domain randomisation: parameters of links and drives in a session yet to come.
        possible: ``(2, n_base)`` ends between which they lie in any robot, infinite for none.
        left_out: sessions whose motions do not determine all of them, with the number that they do.
    """

    names: tuple[Name, ...]
    base: BaseParameters = field(metadata=HIDDEN)
    values: Array = field(metadata=HIDDEN)
    std: Array = field(metadata=HIDDEN)
    pooled: Pooled = field(metadata=HIDDEN)
    ranges: tuple[ParameterRange, ...] = field(metadata=ADDED)
    possible: Array = field(metadata=HIDDEN)
    left_out: Annotated[Mapping[Name, int], FEW] = field(default_factory=dict)

    @property
    def varies(self) -> Flags:
        """Which base parameters' sessions lie further apart than their own intervals allow, ``(n_base,)``."""
        return self.pooled.varies(len(self.names))

    @property
    def next_interval(self) -> Array:
        """Where base parameters of a session yet to come lie, of what a robot can have, ``(2, n_base)``."""
        return np.clip(self.pooled.next_interval, *self.possible)

    @property
    @stated
    def level(self) -> Positive:
        """Level of the intervals."""
        return self.pooled.level

    @property
    @stated
    def parameters(self) -> tuple[SessionParameter, ...]:
        """Base parameters that every session determines."""
        pooled, varies, (low, high) = self.pooled, self.varies, self.next_interval
        return tuple(
            SessionParameter(
                name=label,
                expression=self.base.expressions[i],
                value=float(pooled.mean[i]),
                between_std=float(pooled.between[i]),
                low=float(low[i]),
                high=float(high[i]),
                by_session={
                    name: SessionValue(float(self.values[s, i]), float(self.std[s, i]))
                    for s, name in enumerate(self.names)
                },
                varies=bool(varies[i]),
                std=float(np.sqrt(pooled.covariance[i, i])),
                inconsistency=float(pooled.inconsistency[i]),
                mean_low=float(pooled.mean_interval[0, i]),
                mean_high=float(pooled.mean_interval[1, i]),
            )
            for i, label in enumerate(self.base.labels)
        )

    def summary(self) -> str:
        """How many parameters differ between sessions, and the worst, in units of their noise."""
        between, within = self.pooled.between, np.median(self.std, axis=0)
        ratio = between / np.maximum(within, 1e-300)
        lines = [
            f"{len(self.names)} sessions ({', '.join(self.names)}): {int(self.varies.sum())} of {len(between)} base "
            "parameters differ between them by more than their intervals allow"
        ]
        lines += [
            f"  left out: {name}, whose motions determine {own} of the {len(between)}"
            for name, own in self.left_out.items()
        ]
        for i in np.argsort(-ratio, kind="stable")[:5]:
            low, high = self.next_interval[:, i]
            lines.append(
                f"  {self.base.labels[i]}: {self.pooled.mean[i]:.4g}, sessions differ by {between[i]:.2g} "
                f"(noise of one {within[i]:.2g}); the next lies in {span(f'{low:.4g}', f'{high:.4g}')}"
            )
        return "\n".join(lines)


def write_ranges(sessions: Sessions, path: Path) -> Path:
    """Write what the next session may bring, for domain randomisation (``excite.ranges/1``, YAML or JSON).

    Links' quantities are not independent of each other: what the data fix are the base parameters, whose
    ranges stand beside. Those with a small share ``measured`` are the nominal model's spread. Values that no robot
    has are left out (``clipped``): negative masses, moments of inertia, friction and rotors, products of inertia
    beyond half the moment across them. ``varies_between_sessions`` names the base parameters whose sessions lie
    further apart than their own intervals allow, with each session's value.

    Args:
        sessions: what was identified.
        path: the YAML file to write.

    Returns:
        The file.
    """
    document = ranges_document(sessions.ranges, sessions.pooled.level)
    low, high = sessions.next_interval
    value = np.clip(sessions.pooled.mean, *sessions.possible)
    clipped = np.any(sessions.next_interval != sessions.pooled.next_interval, axis=0)
    varies = sessions.varies
    document["base_parameters"] = {
        label: {
            "low": float(low[i]),
            "high": float(high[i]),
            "value": float(value[i]),
            "varies": bool(varies[i]),
            "expression": sessions.base.expressions[i],
        }
        | ({"clipped": True} if clipped[i] else {})
        for i, label in enumerate(sessions.base.labels)
    }
    document["varies_between_sessions"] = {
        sessions.base.labels[i]: {
            name: {"value": float(sessions.values[s, i]), "std": float(sessions.std[s, i])}
            for s, name in enumerate(sessions.names)
        }
        for i in np.flatnonzero(varies)
    }
    return write_document(document, path)


@one_blas_thread
def identify_sessions(
    robot: Robot,
    sessions: Mapping[str, Log],
    *,
    settings: EstimatorSettings | None = None,
    problem_settings: ProblemSettings | None = None,
    level: float = 0.95,
) -> Sessions:
    """Identify every session by itself and pool the base parameters by random effects.

    All trials of a session are used, whatever their role. A session that leaves parameters undetermined which the
    others show is left out, as long as two remain.

    Args:
        robot: the robot.
        sessions: a log for each session, of the same joints and channels.
        settings: spreads of the nominal model, for the links' ranges.
        problem_settings: filters and drive terms.
        level: of the intervals and ranges.

    Returns:
        Each session's parameters, and what they have in common.

    Raises:
        LogError: robot and logs do not fit, or fewer than two sessions determine all that they show together.
        InputError: fewer than two sessions.
    """
    rows = {
        name: iterate_weights(condense_problem(build_problem(robot, log, problem_settings, role=None)))
        for name, log in sessions.items()
    }
    base = _common_base(rows)
    ranks = {
        name: base_parameters(item.factor[:, base.independent], base.labels, RANK_TOLERANCE).rank
        for name, item in rows.items()
    }
    left_out = {name: rank for name, rank in ranks.items() if rank < base.rank}
    if len(rows) - len(left_out) < 2:
        name, own = next(iter(left_out.items()))
        raise LogError(
            f"determines {own} of the {base.rank} base parameters that the sessions show together",
            source=f"session {name!r}",
            field="trials",
            remedy="record richer motions in every session, or leave this one out",
        )
    rows = {name: item for name, item in rows.items() if name not in left_out}
    found = [base_statistics(item, base) for item in rows.values()]
    values = np.array([item.estimate for item in found])
    pooled = pool_estimates(values, np.array([item.covariance for item in found]), level)
    problem = next(iter(rows.values())).problem
    spreads = (settings or EstimatorSettings()).spreads(problem.robot)
    return Sessions(
        names=tuple(rows),
        base=base,
        values=values,
        std=np.array([item.std for item in found]),
        pooled=pooled,
        ranges=parameter_ranges(problem, base, pooled, spreads),
        possible=possible_ends(base, problem.parameter_names, problem.n_inertial),
        left_out=left_out,
    )


def _common_base(rows: Mapping[str, Regression]) -> BaseParameters:
    """Base parameters of all sessions together."""
    problem = next(iter(rows.values())).problem
    n, labels = problem.n_params, parameter_labels(problem)
    stacked = np.vstack([item.factor[:, :n] for item in rows.values()])
    return base_parameters(stacked, labels, RANK_TOLERANCE)


def split_sessions(logs: Sequence[Log]) -> dict[str, Log]:
    """Logs by session: trials that name one go there, the rest of each log is a session of its own.

    Sessions of the same name in several logs are told apart by the logs' folders.

    Args:
        logs: as they were loaded.

    Returns:
        A log for each session, by its name.

    Raises:
        LogError: the logs hold fewer than two sessions.
    """
    sessions: dict[str, Log] = {}
    named = Counter(key for log in logs for key in {trial.session for trial in log.trials} if key)
    shared = {key for key, count in named.items() if count > 1}
    for number, log in enumerate(logs, start=1):
        own = log.folder.name if log.folder else f"log_{number}"
        keys = [trial.session or own for trial in log.trials]
        for key in dict.fromkeys(keys):
            name = f"{own}/{key}" if key in shared else key
            name = f"{name}_{number}" if name in sessions else name
            chosen = [i for i, other in enumerate(keys) if other == key]
            header = log.header.model_copy(update={"trials": tuple(log.header.trials[i] for i in chosen)})
            sessions[name] = replace(log, header=header, trials=tuple(log.trials[i] for i in chosen))
    if len(sessions) < 2:
        raise LogError(
            "holds one session",
            source=logs[0].folder if logs else None,
            field="trials",
            remedy="name sessions in log.yaml, or give several logs",
        )
    return sessions
