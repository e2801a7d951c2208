"""A person on a force plate: regularised estimates beside the prior and plain least squares, on rows left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.identification.inertia import pseudo_inertia_matrices
from tests.reproduction.human_2020 import N_BODIES, Recording


@pytest.mark.parametrize("regulariser", ["pullback"])
def test_regularised_is_better_than_prior_and_least_squares(
    regulariser: str, data_dir: Path, tmp_path: Path
) -> None:
    """Identified from two thirds, the weight of the prior found inside them; the last third judges."""
    recording = Recording(data_dir, tmp_path)
    train, judge = recording.thirds(2)
    alpha = recording.chosen_alpha(train, regulariser)
    found = recording.estimate(train, "lmi", alpha=alpha, regulariser=regulariser)
    ours, prior = recording.misses(judge, found), recording.misses(judge, recording.prior)
    plain = min(
        (recording.misses(judge, recording.estimate(train, method)) for method in ("ls", "wls")),
        key=lambda misses: float(np.sum((misses / recording.sigma) ** 2)),
    )
    assert (ours < prior).all(), (ours, prior)
    assert (ours < plain).all(), (ours, plain)
    # Measured when written: 0.52 of the prior's and 0.25 of the better plain one's.
    weighted = [float(np.linalg.norm(misses / recording.sigma)) for misses in (ours, prior, plain)]
    assert weighted[0] < 0.6 * weighted[1]
    assert weighted[0] < 0.3 * weighted[2]
    least = np.linalg.eigvalsh(pseudo_inertia_matrices(found))[:, 0]
    assert len(least) == N_BODIES
    assert least.min() > 0.0
    # No scale stood by; the plate's vertical force weighs the person.
    assert abs(found[::10].sum() - 64.0) < 0.5


def test_columns_mean_what_the_problem_says(data_dir: Path, tmp_path: Path) -> None:
    """Vertical forces hold no inertia about a joint's own position at rest, and masses weigh by gravity."""
    recording = Recording(data_dir, tmp_path)
    mass = recording.matrix[2::3, ::10]
    assert abs(np.median(mass) - 9.81) < 0.5
    assert np.linalg.eigvalsh(pseudo_inertia_matrices(recording.prior))[:, 0].min() > 0.0
    assert np.allclose(recording.robot.nominal_parameters, recording.prior, atol=1e-12)


def test_the_smallest_weight_of_the_prior_is_solved(data_dir: Path, tmp_path: Path) -> None:
    """Nearly nothing holds the bodies then but that they can exist: many short steps along the boundary."""
    recording = Recording(data_dir, tmp_path)
    train, _ = recording.thirds(0)
    weak, strong = (recording.estimate(train, "lmi", alpha=a, regulariser="pullback") for a in (0.01, 10.0))
    fits = [np.linalg.norm(recording.misses(train, phi) / recording.sigma) for phi in (weak, strong)]
    assert fits[0] < fits[1]
