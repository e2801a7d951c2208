"""What is said of a tilt."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from excite.diagnosis.effects.bodies.base_tilt import BaseTilt
from excite.diagnosis.equations.horizontal import level_axes


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (3.0, -2.0, -9.0), (9.81, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_axes_are_level_and_right_handed_about_up(gravity: tuple[float, float, float]) -> None:
    axes = level_axes(np.array(gravity))
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.cross(axes[0], axes[1]), -axes[2], atol=1e-12)
    np.testing.assert_allclose(axes[2] * np.linalg.norm(gravity), gravity, atol=1e-12)


def test_on_a_level_base_they_are_its_own() -> None:
    np.testing.assert_allclose(level_axes(np.array([0.0, 0.0, -9.81]))[:2], np.eye(3)[:2], atol=1e-12)


def test_a_direction_that_nothing_shows_is_not_told() -> None:
    """A level slide feels one direction of a tilt alone."""
    fit = SimpleNamespace(
        extra=np.array([0.05, 0.0, 0.0, 0.0]), extra_std=np.array([1e-3, np.inf, np.inf, np.inf])
    )
    told = BaseTilt().estimates(None, "base", (), fit)
    assert set(told) == {"angle", "gravity_x"}
    assert told["angle"].value == pytest.approx(0.05 / 9.81, rel=1e-3)
    assert told["angle"].std == pytest.approx(1e-3 / 9.81)
