"""Weak directions, unexcited parameters, gain of one more motion."""

from __future__ import annotations

import numpy as np
import pytest

from excite.excitation.conditioning import conditioning, motion_factor
from excite.excitation.weakness import gains, unexcited, weak_directions
from excite.regressor.base_parameters import structural_base_parameters
from excite.robot.robot import Robot
from tests.excitation.conftest import sines


def test_weak_directions_are_the_least_visible_steps(panda: Robot) -> None:
    factor, base = motion_factor(panda, sines(panda, "motion", 0)), structural_base_parameters(panda)
    found = weak_directions(factor, base, k=3)
    rows = factor.matrix[:, base.independent]
    for direction in found:
        assert np.linalg.norm(direction.weights) == pytest.approx(1.0)
        assert np.linalg.norm(rows @ direction.weights) == pytest.approx(direction.singular_value, rel=1e-6)
        assert direction.weights.max() == np.abs(direction.weights).max()
        strongest = base.labels[int(np.argmax(direction.weights))]
        assert strongest in direction.text
    values = [direction.singular_value for direction in found]
    assert values == sorted(values)
    steps = np.random.default_rng(0).normal(size=(base.rank, 50))
    assert (np.linalg.norm(rows @ steps, axis=0) / np.linalg.norm(steps, axis=0)).min() >= values[0]


def test_joints_that_rest_leave_their_friction_unexcited(panda: Robot) -> None:
    still = {0, 4}
    motions = [
        sines(panda, f"motion{i}", i, moving=[j for j in range(7) if j not in still]) for i in range(2)
    ]
    found = unexcited(conditioning(panda, [motion_factor(panda, motion) for motion in motions]))
    labels = {parameter.label for parameter in found}
    friction = {label for label in labels if label.startswith(("viscous", "coulomb"))}
    assert friction == {f"{term}({panda.joint_names[j]})" for term in ("viscous", "coulomb") for j in still}
    assert all(0.25 < parameter.share <= 1.0 + 1e-9 for parameter in found)
    assert all(parameter.expression.startswith(parameter.label) for parameter in found)


def test_nothing_is_unexcited_when_all_joints_move(panda: Robot) -> None:
    factors = [motion_factor(panda, sines(panda, f"motion{i}", i)) for i in range(3)]
    assert unexcited(conditioning(panda, factors)) == ()


def test_a_humanoid_on_its_feet_with_still_legs_lacks_leg_parameters(g1: Robot) -> None:
    arms = [
        6 + j
        for j, name in enumerate(g1.joint_names)
        if "leg" not in name and name.startswith(("left_s", "waist"))
    ]
    found = unexcited(conditioning(g1, [motion_factor(g1, sines(g1, "arm", 0, moving=arms), 25.0)]))
    assert any("knee" in parameter.label for parameter in found)
    assert len(found) > 50


def test_gain_is_the_change_of_the_stacked_conditioning(panda: Robot) -> None:
    first, second = (motion_factor(panda, sines(panda, f"motion{i}", i)) for i in range(2))
    before, after = conditioning(panda, [first]), conditioning(panda, [first, second])
    (gain,) = gains(before, [second])
    assert gain.motion == "motion1"
    assert gain.log_det == pytest.approx(after.log_det - before.log_det, rel=1e-9)
    assert gain.full == pytest.approx(after.full, rel=1e-9)
    assert gain.rank == 0
    lame = conditioning(panda, [motion_factor(panda, sines(panda, "lame", 0, moving=[2, 3]))])
    (gain,) = gains(lame, [second])
    assert gain.rank == lame.n_base_parameters - lame.rank > 0
    assert gain.log_det is None
