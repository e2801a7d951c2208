"""A joint's spring pulls back."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from excite.diagnosis.effects.forces import HardeningSpring, JointSpring


@pytest.mark.parametrize(
    ("beta", "held"),
    [
        ((2.0, 1.0), True),
        ((-2.0, -1.0), False),
        ((2.0, 1.0, 0.1, 1.0), True),
        # Cables that are slack about the middle: stiff at both ends.
        ((-0.1, 0.0, 0.0, 3.0), True),
        # A curve through what else is left, of terms that cancel.
        ((51.56, 15.48, 54.85, 18.62), False),
    ],
)
def test_a_spring_pulls_back_over_its_motion(beta: tuple[float, ...], held: bool) -> None:
    q = np.linspace(-1.25, -0.73, 200) if abs(beta[0]) > 10.0 else np.linspace(-1.0, 1.0, 200)
    context = SimpleNamespace(signal_at=lambda location, name: q)
    spring = JointSpring() if len(beta) == 2 else HardeningSpring()
    assert spring.is_admissible(context, "joint", (), np.array(beta)) is held
