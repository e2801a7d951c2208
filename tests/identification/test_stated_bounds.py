"""Stated bounds as rows on standard parameters: no allowed body is cut off, what is exact cuts exactly."""

from __future__ import annotations

import numpy as np
import pytest

from excite.identification.constraints.linear import speaks_of, stated_bounds
from excite.identification.estimators.settings import BodySettings
from excite.identification.inertia import NAMES, standard_parameters
from excite.identification.physical.bounds import KnownBounds
from excite.identification.physical.default_bounds import default_bounds
from excite.identification.problem import IdentificationProblem
from tests.reproduction import iiwa


@pytest.fixture(scope="module")
def problem() -> IdentificationProblem:
    rng = np.random.default_rng(0)
    return iiwa.problem(*rng.normal(size=(4, 3, 7)))


def some_bounds(rng: np.random.Generator) -> KnownBounds:
    """Bounds of about half of all parameters, on either side of zero."""
    found = {}
    for link in (f"link{k}" for k in range(1, 8)):
        for name in NAMES:
            if rng.uniform() < 0.5:
                middle = rng.uniform(1.0, 2.0) if name in ("m", "Ixx", "Iyy", "Izz") else rng.normal() * 0.3
                found[f"{link}.{name}"] = (middle - 0.2, middle + 0.2)
    return KnownBounds(found, {"viscous.joint2": (0.1, 0.4)}, (3.0, 60.0))


def test_every_body_within_the_bounds_meets_all_rows(problem: IdentificationProblem) -> None:
    """Also at the corners, where the way to the joint frame is least linear."""
    rng, judged = np.random.default_rng(1), 0
    for _ in range(20):
        known = some_bounds(rng)
        bounds = known.over(default_bounds(problem.robot, BodySettings()))
        rows = stated_bounds(problem, known, default_bounds(problem.robot, BodySettings()))
        for sharp in (False, True):
            share = rng.uniform(size=bounds.lower.shape)
            share = np.round(share) if sharp else share
            physical = bounds.lower + share * (bounds.upper - bounds.lower)
            physical[:, 0] *= np.clip(physical[:, 0].sum(), 3.0, 60.0) / physical[:, 0].sum()
            if (physical[:, 0] < bounds.lower[:, 0]).any() or (physical[:, 0] > bounds.upper[:, 0]).any():
                continue
            parameters = np.concatenate([standard_parameters(physical), np.full(14, 0.2)])
            assert rows.violations(parameters).max() <= 1e-9 * max(1.0, np.abs(parameters).max())
            judged += 1
    assert judged > 10


@pytest.mark.parametrize(
    ("name", "bounds", "mass", "place", "value"),
    [("m", (1.0, 2.0), 2.1, 0, 2.1), ("cy", (-0.1, 0.1), 3.0, 2, 0.33), ("Ixx", (0.1, 0.2), 1.0, 4, 60.0)],
)
def test_what_lies_outside_violates_its_own_row(problem, name, bounds, mass, place, value) -> None:
    known = KnownBounds({f"link3.{name}": bounds})
    rows = stated_bounds(problem, known, default_bounds(problem.robot, BodySettings()))
    parameters = problem.prior.copy()
    parameters[20], parameters[20 + place] = mass, value
    assert rows.violations(parameters).max() > 1e-3
    assert set(rows.labels) == {f"stated:link3.{name}"}
    assert speaks_of(problem, known) == [20 + place]


def test_the_verdict_counts_what_is_reached_and_what_is_broken() -> None:
    known = KnownBounds(
        {"a.m": (1.0, 2.0), "a.cx": (0.0, 0.1), "b.cz": (-1.0, 1.0)}, {"viscous.j": (0.0, 1.0)}
    )
    bodies = standard_parameters(
        np.array([[2.0, 0.15, 0, 0, 1, 0, 1, 0, 0, 1], [1.0, 0, 0, 0.5, 1, 0, 1, 0, 0, 1]])
    )
    report = known.judge(("a", "b"), bodies, {"viscous.j": 0.5})
    assert report.stated == 4 and [item.name for item in report.reached] == ["a.m"]
    assert [item.name for item in report.broken] == ["a.cx"]
    assert report.broken[0].by == pytest.approx(0.05)
    without = known.judge(("a", "b"), np.zeros(20), {})
    assert without.stated == 3 and without.broken[0].by == float("inf")
