"""The likeliest body that can exist, against drawn bodies of point masses."""

from __future__ import annotations

import numpy as np
import pytest

from excite.diagnosis.effects.bodies import likeliest_body
from excite.identification.inertia import pseudo_inertia_matrices

REACH = 0.6


def drawn(rng: np.random.Generator, mass: float = 2.0, reach: float = 0.5) -> np.ndarray:
    """Inertial parameters about the joint of ten point masses within reach."""
    at = rng.normal(size=(10, 3))
    at *= (reach * rng.uniform(0.2, 1.0, size=10) / np.linalg.norm(at, axis=1))[:, None]
    m = mass * rng.dirichlet(np.ones(10))
    inertia = sum(k * ((r @ r) * np.eye(3) - np.outer(r, r)) for k, r in zip(m, at, strict=True))
    return np.array(
        [m.sum(), *(m @ at), *(inertia[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)))]
    )


def information(rng: np.random.Generator) -> np.ndarray:
    rows = rng.normal(size=(40, 10))
    return rows.T @ rows


def value(matrix: np.ndarray, target: np.ndarray, body: np.ndarray) -> float:
    return float(0.5 * body @ matrix @ body - target @ body)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_body_that_can_exist_is_its_own_likeliest(seed: int, sign: float) -> None:
    rng = np.random.default_rng(seed)
    body, matrix = sign * drawn(rng), information(rng)
    found = likeliest_body(matrix, matrix @ body, REACH, removable=5.0)
    assert found == pytest.approx(body, abs=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_of_what_cannot_be_no_drawn_body_is_likelier(seed: int) -> None:
    """The estimate has its centre beyond reach, and moments of inertia below zero."""
    rng = np.random.default_rng(seed)
    estimate = drawn(rng) + np.array([0.0, 3.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    matrix = information(rng)
    target = matrix @ estimate
    found = likeliest_body(matrix, target, REACH, removable=5.0)
    assert found is not None
    assert np.linalg.eigvalsh(pseudo_inertia_matrices(found))[..., 0].min() > -1e-6
    second = 0.5 * (found[4] + found[6] + found[9])
    assert second <= REACH**2 * found[0] + 1e-6
    best = value(matrix, target, found)
    for _ in range(300):
        # Each drawn body at its own best mass.
        other = drawn(rng, reach=REACH)
        size = max(float(target @ other) / float(other @ matrix @ other), 0.0)
        assert value(matrix, target, size * other) >= best - 1e-6


def test_no_more_is_taken_away_than_the_link_has() -> None:
    rng = np.random.default_rng(1)
    body, matrix = -drawn(rng, mass=3.0), information(rng)
    found = likeliest_body(matrix, matrix @ body, REACH, removable=1.0)
    assert found is not None
    assert found[0] == pytest.approx(-1.0, abs=1e-5)


def test_where_nothing_is_missing_there_is_no_body() -> None:
    assert likeliest_body(np.eye(10), np.zeros(10), REACH, removable=1.0) is None
