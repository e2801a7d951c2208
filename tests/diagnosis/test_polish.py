"""The last search of all shapes together: what it moves, and how its turns come to an end."""

from __future__ import annotations

import numpy as np
import pytest

from excite.diagnosis.budget.polish import mixed
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.registry import EFFECTS


def _forms(effect: Effect) -> list[Effect]:
    return [effect, *effect.forms, *effect.richer]


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_shapes_can_be_moved_by_factors(name: str) -> None:
    """They are searched on a logarithmic scale."""
    for form in _forms(EFFECTS[name]):
        assert all(0.0 < p.low < p.high < np.inf for p in form.searched), type(form).__name__


@pytest.mark.parametrize("slope", [-0.95, -0.5, 0.4])
def test_turns_that_swing_about_their_end_are_brought_there(slope: float) -> None:
    """A linear turn in one direction ends after two of them, however far it overshoots."""
    end, along = np.array([2.0, -1.0]), np.array([1.0, 3.0])

    def turn(x: np.ndarray) -> np.ndarray:
        return end + slope * (x - end)

    x = end + along
    first = turn(x)
    second = turn(first)
    metric = np.diag([1.0, 4.0])
    np.testing.assert_allclose(mixed(metric, second, second - first, first, first - x), end, atol=1e-12)
