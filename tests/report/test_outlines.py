"""Outlines of shapes in pictures of a robot."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from excite.report.plots.postures import hull_outline


def test_an_outline_has_the_corners_of_the_hull_anticlockwise() -> None:
    corners = np.array([[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.0, 0.1], [0.1, 0.05]])
    found = hull_outline(corners).tolist()
    assert found[found.index(0) :] + found[: found.index(0)] == [0, 1, 2, 3]


@pytest.mark.parametrize("seed", range(5))
def test_nothing_sticks_out_that_could_be_seen(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ball = rng.normal(size=(96, 3))
    points = (ball / np.linalg.norm(ball, axis=1)[:, None] * rng.uniform(0.02, 0.3, 3))[:, :2]
    found = points[hull_outline(points)]
    area = 0.5 * np.sum(found[:, 0] * np.roll(found[:, 1], -1) - found[:, 1] * np.roll(found[:, 0], -1))
    assert 0.995 * ConvexHull(points).volume < area <= ConvexHull(points).volume + 1e-12


@pytest.mark.parametrize("points", [np.zeros((4, 2)), np.outer(np.arange(3.0), [1.0, 2.0])])
def test_what_has_no_area_has_no_outline(points: np.ndarray) -> None:
    assert len(hull_outline(points)) < 3


def test_pictures_are_drawn_without_the_hulls_of_scipy() -> None:
    code = "import sys, excite.report.sections.motions; print(*({'scipy.spatial', 'scipy.linalg'} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == []
