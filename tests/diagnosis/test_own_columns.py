"""How friction changes sign is found between the values of the grid."""

from __future__ import annotations

import numpy as np
import pytest

from excite.arrays import Array
from excite.diagnosis.equations.dry_friction.friction_sign import WIDTH_BOUNDS
from excite.diagnosis.equations.own_columns import BREAKAWAY_BOUNDS, refine_number


def _dahl(deflection: Array, breakaway: float) -> Array:
    """Friction after a reversal, over the deflection since then: Dahl's model in closed form."""
    return (1.0 - 2.0 * np.exp(-deflection / breakaway))[:, None]


@pytest.mark.parametrize("breakaway", [2.2e-4, 9e-4, 2.7e-3])
def test_a_breakaway_between_those_of_the_grid_is_found(breakaway: float):
    rng = np.random.default_rng(5)
    deflection = rng.uniform(0.0, 0.01, 3000)
    target = 1.7 * _dahl(deflection, breakaway)[:, 0] + 0.05 * rng.standard_normal(3000)
    start = min((5e-4, 1.5e-3, 4e-3), key=lambda b: abs(np.log(b / breakaway)))
    use = np.ones(3000, dtype=np.bool_)
    found = refine_number(
        target, lambda b: _dahl(deflection, b), start, _dahl(deflection, start), use, BREAKAWAY_BOUNDS
    )
    assert found == pytest.approx(breakaway, rel=0.08)


def test_a_width_stays_where_a_velocity_can_tell_it():
    """A step that is sharper than any velocity's noise would draw the search to nothing."""
    v = np.linspace(-0.5, 0.5, 4001)
    use = np.ones(len(v), dtype=np.bool_)

    def rows_at(width: float) -> Array:
        return np.tanh(v / width)[:, None]

    found = refine_number(np.sign(v), rows_at, 3e-3, rows_at(3e-3), use, WIDTH_BOUNDS)
    assert WIDTH_BOUNDS[0] <= found <= 1.1 * WIDTH_BOUNDS[0]


def test_rows_that_are_not_fitted_do_not_count():
    rng = np.random.default_rng(6)
    deflection = rng.uniform(0.0, 0.01, 2000)
    use = np.arange(2000) < 1000
    target = np.where(use, _dahl(deflection, 1.2e-3)[:, 0], _dahl(deflection, 5e-3)[:, 0])
    found = refine_number(
        target, lambda b: _dahl(deflection, b), 1.5e-3, _dahl(deflection, 1.5e-3), use, BREAKAWAY_BOUNDS
    )
    assert found == pytest.approx(1.2e-3, rel=0.08)
