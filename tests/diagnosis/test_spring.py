"""A joint's spring pulls back."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.forces.end_stop import EndStop, LowerEndStop
from excite.diagnosis.effects.forces.joint_spring import HardeningSpring, JointSpring, SlackSpring
from excite.diagnosis.effects.form import Sizes
from excite.diagnosis.effects.note import JointStep


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
    context = SimpleNamespace(q=q[:, None], row=lambda location: 0)
    spring = JointSpring() if len(beta) == 2 else HardeningSpring()
    assert spring.admissible(context, "joint", (), np.array(beta)) is held


@pytest.mark.parametrize(("slack", "spring"), [(0.5, True), (0.65, True), (0.8, False), (0.95, False)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_pushes_back_for_much_of_a_motion_is_a_spring_and_else_a_stop(
    side: float, slack: float, spring: bool
) -> None:
    q = side * np.sort(np.random.default_rng(0).normal(size=2000))
    context = SimpleNamespace(q=q[:, None], row=lambda location: 0)
    way = side * q
    theta, beta = (float(way.max() - np.quantile(way, slack)),), np.array([3.0])
    stop: Effect = EndStop() if side > 0.0 else LowerEndStop()
    assert SlackSpring(side).admissible(context, "joint", theta, beta) is spring
    assert stop.admissible(context, "joint", theta, beta) is not spring
    assert not SlackSpring(side).admissible(context, "joint", theta, -beta)


@pytest.mark.parametrize(
    ("edge", "q", "torque"), [("above", 0.7, -1.0), ("above", 0.3, 0.0), ("below", 0.3, 0.4)]
)
def test_a_simulator_has_a_spring_that_is_slack_on_one_side(edge: str, q: float, torque: float) -> None:
    side = 1.0 if edge == "above" else -1.0
    form = SlackSpring(side).in_mujoco(Sizes("joint", {"stiffness": 5.0 if q > 0.5 else 2.0, edge: 0.5}))
    (noted,) = form.notes
    # What is written into a model is read again as the same.
    values = {key: float(value) for key, _, value in (p.partition("=") for p in noted.note.text().split())}
    again = type(noted.note).of(values)
    assert again.torque(JointStep(lambda: 0.0, q=q)) == pytest.approx(torque)
