"""Ranges of links' and drives' parameters, for domain randomisation in simulators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from scipy.linalg import cho_factor, cho_solve
from scipy.special import ndtri

from excite.arrays import Array
from excite.atomic import write_text
from excite.identification.inertia import FILE_ORDER
from excite.identification.judgement.possible import NEVER_NEGATIVE
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import prior_std
from excite.identification.sessions.pooling import Pooled
from excite.json_document import to_json
from excite.regressor.base_parameters import BaseParameters

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
_PRODUCT_BELOW = {7: 6, 8: 5, 9: 4}
_STEP = 1e-6


@dataclass(frozen=True)
class ParameterRange:
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
    low: float
    value: float
    high: float
    unit: str
    measured: float
    clipped: bool = False

    def to_json(self) -> dict[str, Any]:
        """All fields."""
        return asdict(self)


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
        base: base parameters.
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
        if mean[10 * s] <= 0.0:
            # No body: the data contradict the nominal model here, and what is left is its own spread.
            free = np.diag(prior[part] ** 2)
            found += _of_link(segment.link, nominal, nominal, free, prior[part], quantile)
            continue
        found += _of_link(segment.link, nominal, mean[part], covariance, prior[part], quantile)
    drives = range(problem.n_inertial, problem.n_params)
    return (*found, *_of_drives(problem, base, pooled, drives))


def ranges_document(ranges: Sequence[ParameterRange], level: float) -> dict[str, Any]:
    """Ranges as ``excite.ranges/1``: ``links`` and ``joints`` by name, each quantity with low and high."""
    document: dict[str, Any] = {"schema": SCHEMA, "level": level, "links": {}, "joints": {}}
    quantities = {name for name, _ in _QUANTITIES}
    for item in ranges:
        group = document["links" if item.parameter in quantities else "joints"]
        group.setdefault(item.link, {})[item.parameter] = {
            "low": item.low, "high": item.high, "value": item.value, "unit": item.unit, "measured": item.measured,
        }  # fmt: skip
        if item.clipped:
            group[item.link][item.parameter]["clipped"] = True
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
            (_quantities(ten + step) - _quantities(ten - step)) / (2.0 * size)
            for step, size in zip(np.diag(steps), steps, strict=True)
        ],
        axis=1,
    )
    std = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, covariance, slopes), 0.0))
    loose = np.sqrt(slopes**2 @ prior**2)
    middle = _quantities(ten)
    floor = np.full(len(_QUANTITIES), -np.inf)
    floor[_POSITIVE] = _LEAST_SHARE * np.abs(_quantities(nominal)[_POSITIVE])
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
    for i, moment in _PRODUCT_BELOW.items():
        most = 0.5 * middle[moment]
        middle[i] = np.clip(middle[i], -most, most)
        most = 0.5 * high[moment]
        low[i], high[i] = max(low[i], -most), min(high[i], most)
    return _Ends(low, middle, high)


def _quantities(ten: Array) -> Array:
    """Mass, centre of mass, and inertia about it, xx yy zz xy xz yz, ``(10,)``."""
    center = ten[1:4] / ten[0]
    shift = ten[0] * (float(center @ center) * np.eye(3) - np.outer(center, center))
    central = ten[4:] - shift[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return np.concatenate([ten[:1], center, central[list(FILE_ORDER)]])


def _of_drives(
    problem: IdentificationProblem, base: BaseParameters, pooled: Pooled, columns: range
) -> list[ParameterRange]:
    """Drives' parameters that are base parameters by themselves."""
    place = {int(column): i for i, column in enumerate(base.independent)}
    found = []
    for column in columns:
        alone = column in place and np.count_nonzero(base.matrix[place[column]]) == 1
        if not alone:
            continue
        i = place[column]
        term, _, joint = problem.parameter_names[column].partition(".")
        low, high = (float(x) for x in pooled.next_interval[:, i])
        least = 0.0 if term in NEVER_NEGATIVE else -np.inf
        ends = (max(low, least), max(float(pooled.mean[i]), least), max(high, least))
        found.append(ParameterRange(joint, term, *ends, "SI", 1.0, clipped=low < least))
    return found
