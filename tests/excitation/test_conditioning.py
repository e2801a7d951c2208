"""R factors and condition numbers against regressors stacked from pinocchio."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError, MotionError
from excite.excitation.conditioning import compute_conditioning, motion_factor, stack_factors
from excite.motion.motion import Motion
from excite.regressor.base_parameters import structural_base_parameters
from excite.robot.robot import Robot
from tests.excitation.conftest import sines
from tests.quadruped import quadruped


def pinocchio_rows(robot: Robot, motion: Motion) -> np.ndarray:
    """Rows and columns that the robot's sensors see, sample by sample from pinocchio."""
    data, blocks = robot.model.createData(), []
    hidden = [s for sensor in robot.sensors for s in sensor.excludes]
    kept = [10 * s + i for s in range(len(robot.segments)) if s not in hidden for i in range(10)]
    for q, v, a in zip(motion.q, motion.v, motion.a, strict=True):
        block = pin.computeJointTorqueRegressor(robot.model, data, q, v, a)
        if robot.floating:
            blocks.append(block[:6, kept])
        else:
            blocks.append(np.hstack([block, np.diag(v), np.diag(np.sign(v))]))
    return np.vstack(blocks)


@pytest.mark.parametrize("name", ["g1", "panda"])
def test_condition_numbers_are_those_of_the_stacked_regressor(
    name: str, request: pytest.FixtureRequest
) -> None:
    robot = request.getfixturevalue(name)
    motions = [sines(robot, f"motion{i}", seed=i) for i in range(2)]
    factors = [motion_factor(robot, motion, 50.0) for motion in motions]
    rows = np.vstack([pinocchio_rows(robot, motion.resampled(robot, 50.0)) for motion in motions])
    base = structural_base_parameters(robot)
    found = compute_conditioning(robot, factors, base)
    assert found.rank == found.n_base_parameters == base.rank
    assert found.factor.n_rows == len(rows)
    np.testing.assert_allclose(
        found.factor.matrix.T @ found.factor.matrix, rows.T @ rows, atol=1e-10 * np.abs(rows.T @ rows).max()
    )
    assert found.full == pytest.approx(np.linalg.cond(rows[:, base.independent]), rel=1e-6)
    information = rows[:, base.independent].T @ rows[:, base.independent]
    assert found.log_det == pytest.approx(np.linalg.slogdet(information)[1], rel=1e-6)
    if robot.floating:
        # All ten columns of every segment, as in Table I of Jovic et al. (2015).
        assert [s.n_columns for s in found.segments] == [10] * len(found.segments)
        for i, segment in enumerate(found.segments):
            assert segment.condition == pytest.approx(np.linalg.cond(rows[:, 10 * i : 10 * i + 10]), rel=1e-6)


def test_base_parameters_at_hand_leave_the_factor_as_it_is(tmp_path: Path) -> None:
    robot = quadruped(tmp_path)
    motion = sines(robot, "motion", 0)
    feet = [foot.name for foot in robot.feet]
    lifted = np.arange(motion.n_samples) > motion.n_samples // 2
    base = structural_base_parameters(robot)
    for raised in (1, 2):
        flags = {name: ~lifted | (k >= raised) for k, name in enumerate(feet)}
        whole = motion_factor(robot, replace(motion, contacts=flags))
        quick = motion_factor(robot, replace(motion, contacts=flags), base=base)
        # Beyond one raised foot the base parameters need not hold, and all columns are taken.
        assert len(quick.matrix) == (base.rank if raised == 1 else len(base.names))
        gram = whole.matrix.T @ whole.matrix
        np.testing.assert_allclose(quick.matrix.T @ quick.matrix, gram, atol=1e-10 * np.abs(gram).max())


def test_segments_of_an_arm_use_their_independent_columns(panda: Robot) -> None:
    factor = motion_factor(panda, sines(panda, "motion", 0))
    found = compute_conditioning(panda, [factor])
    # The first link turns about a vertical axis: Izz alone.
    assert found.segments[0].n_columns == 1
    assert found.segments[0].condition == pytest.approx(1.0)
    assert len(found.segments) == 7
    assert all(1.0 <= s.condition < np.inf for s in found.segments)
    assert found.segments[-1].n_columns == 10


def test_segments_beyond_ankle_sensors_are_left_out(g1: Robot) -> None:
    factor = motion_factor(g1, sines(g1, "motion", 0), 25.0)
    names = [s.segment for s in compute_conditioning(g1, [factor]).segments]
    feet = [g1.segments[s].name for sensor in g1.sensors for s in sensor.excludes]
    assert len(feet) == 2
    assert names == [s.name for s in g1.segments if s.name not in feet]


def test_a_motion_that_lacks_rank_has_an_infinite_condition_number(panda: Robot) -> None:
    found = compute_conditioning(panda, [motion_factor(panda, sines(panda, "one joint", 0, moving=[3]))])
    assert found.rank < found.n_base_parameters
    assert found.full == np.inf
    assert found.log_det == -np.inf
    content = found.to_json()
    assert json.loads(json.dumps(content, allow_nan=False))["full"] is None
    assert content["log_det"] is None
    assert content["n_base_parameters"] == found.n_base_parameters
    assert {"segment", "condition"} == set(content["segments"][0])
    assert any(s["condition"] is None for s in content["segments"])
    assert "rank" in found.summary()


def test_one_more_motion_never_lowers_the_information(panda: Robot) -> None:
    factors = [motion_factor(panda, sines(panda, f"motion{i}", i)) for i in range(4)]
    values = [compute_conditioning(panda, factors[:n]).log_det for n in (1, 2, 3, 4)]
    assert values == sorted(values)


def test_a_rigid_offset_of_time_changes_nothing(panda: Robot) -> None:
    motion = sines(panda, "motion", 0)
    late = replace(motion, time=motion.time + 3.0)
    a, b = (compute_conditioning(panda, [motion_factor(panda, m)]).full for m in (motion, late))
    assert a == pytest.approx(b, rel=1e-6)


def test_row_weights_divide_the_rows(panda: Robot) -> None:
    motion = sines(panda, "motion", 0)
    plain, halved = motion_factor(panda, motion), motion_factor(panda, motion, row_std=np.full(7, 2.0))
    np.testing.assert_allclose(np.abs(halved.matrix), np.abs(plain.matrix) / 2.0, atol=1e-10)


def test_faults(panda: Robot, g1: Robot) -> None:
    motion = sines(panda, "motion", 0)
    with pytest.raises(MotionError, match="joints differ"):
        motion_factor(g1, motion)
    with pytest.raises(InputError, match="rate"):
        motion_factor(panda, motion, 0.0)
    with pytest.raises(InputError, match="standard deviations"):
        motion_factor(panda, motion, row_std=np.zeros(7))
    broken = motion.a.copy()
    broken[10] = np.nan
    with pytest.raises(MotionError, match="NaN"):
        motion_factor(panda, replace(motion, a=broken))
    with pytest.raises(InputError, match="no motion"):
        stack_factors([])
    with pytest.raises(InputError, match="different"):
        stack_factors([motion_factor(panda, motion, 50.0), motion_factor(panda, motion, 25.0)])
    with pytest.raises(InputError, match="other columns"):
        compute_conditioning(panda, [motion_factor(panda, motion)], structural_base_parameters(g1))
