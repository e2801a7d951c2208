"""Base parameters against what is known of mechanisms, and against fresh regressors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError, UnknownNameError
from excite.regressor.base_parameters import base_parameters, describe_combination, structural_base_parameters
from excite.regressor.columns import DRIVE_TERMS, measured_columns, regressor_rows
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.regressor.conftest import sample


def on_plates(robot: Robot) -> Robot:
    """The robot with sensors that see its feet too."""
    return replace(robot, sensors=tuple(replace(sensor, excludes=()) for sensor in robot.sensors))


# SO-101, a 6R arm with its jaw, has right angles typed as 1.5708.
# 43 for a 7R arm and 36 for a 6R arm with vertical first axis: Khalil & Dombre (2002), section 9.4 counts;
# 10·n_segments - 3·n_joints for a free base with revolute joints: Ayusawa et al. (2014).
@pytest.mark.parametrize(
    ("name", "feet", "rank"),
    [
        ("panda", True, 43),
        ("iiwa14", True, 43),
        ("ur10", True, 36),
        ("so101", True, 36),
        ("g1", True, 300 - 3 * 29),
        ("g1", False, 280 - 3 * 27),
        ("talos", True, None),
    ],
)
def test_structural_rank(name: str, feet: bool, rank: int | None) -> None:
    robot = load_robot(name)
    robot = on_plates(robot) if feet else robot
    base = structural_base_parameters(robot, ())
    assert base.rank == (rank if rank is not None else 10 * len(robot.segments) - 3 * robot.n_joints)
    assert base.smallest_kept > 1e-2
    assert base.largest_dropped < 1e-10
    assert f"{base.rank} base parameters" in base.summary()


def test_right_angles_that_were_typed_are_right_angles() -> None:
    robot = load_robot("ur10")
    model = pin.Model(robot.model)
    for joint, off in enumerate((8e-4, 1.6e-3, -8e-4, 0.0, 8e-4, 1.6e-3), 1):
        model.jointPlacements[joint] *= pin.SE3(pin.exp3(np.array([off, 0.0, 0.0])), np.zeros(3))
    typed = replace(robot, model=model)
    base, columns = structural_base_parameters(typed, ()), measured_columns(typed, ())
    s = sample(model, 200, seed=11)
    rows = regressor_rows(typed, columns, s.q, s.v, s.a).reshape(-1, len(columns.names))
    assert base_parameters(rows, columns.names).rank > base.rank
    assert base.rank == structural_base_parameters(robot, ()).rank
    # What is left out is no more than what the angles are off by.
    phi = typed.nominal_parameters[columns.inertial]
    left = rows @ phi - rows[:, base.independent] @ base.values(phi)
    assert np.linalg.norm(left) < 2e-3 * np.linalg.norm(rows @ phi)


@pytest.mark.parametrize(("name", "drives"), [("panda", DRIVE_TERMS), ("ur10", ()), ("g1", ())])
def test_base_parameters_explain_any_motion(name: str, drives: tuple[str, ...]) -> None:
    robot = load_robot(name)
    base, columns = structural_base_parameters(robot, drives), measured_columns(robot, drives)
    s = sample(robot.model, 40, seed=11)
    rows = regressor_rows(robot, columns, s.q, s.v, s.a).reshape(-1, len(columns.names))
    phi = np.random.default_rng(1).normal(size=len(columns.names))
    whole = rows @ phi
    np.testing.assert_allclose(
        rows[:, base.independent] @ base.values(phi), whole, atol=1e-10 * np.abs(whole).max()
    )
    assert base.labels == tuple(columns.names[i] for i in base.independent)


def test_expressions_are_the_matrix() -> None:
    robot = load_robot("iiwa14")
    base = structural_base_parameters(robot, ("viscous",))
    # Grouping of the first two links of an arm whose first two axes meet at a right angle.
    assert base.expressions[0] == "Izz(link1) + Iyy(link2)"
    assert base.expressions[-1] == "viscous(iiwa_joint_7)" or base.expressions[-1].startswith("viscous(")
    phi = np.random.default_rng(2).normal(size=len(base.names))
    scope = dict(zip(base.names, phi, strict=True))
    for text, value in zip(base.expressions, base.values(phi), strict=True):
        found = 0.0
        for term in text.replace(" - ", " + -").split(" + "):
            weight, _, name = term.rpartition("·")
            sign = -1.0 if name.startswith("-") else 1.0
            found += (float(weight) if weight else sign) * scope[name.removeprefix("-")]
        assert found == pytest.approx(value, rel=2e-2, abs=2e-2)


def test_dependence_within_a_small_matrix() -> None:
    rows = np.random.default_rng(0).normal(size=(30, 2))
    matrix = np.column_stack(
        [rows[:, 0], 0.0 * rows[:, 0], 2.0 * rows[:, 0], rows[:, 1], rows[:, 0] - 0.5 * rows[:, 1]]
    )
    base = base_parameters(matrix, ["a", "zero", "b", "c", "d"])
    assert list(base.independent) == [0, 3]
    assert base.expressions == ("a + 2·b + d", "c - 0.5·d")
    np.testing.assert_allclose(matrix, matrix[:, base.independent] @ base.matrix, atol=1e-14)


def test_an_r_factor_serves_as_well_as_the_rows() -> None:
    robot = load_robot("ur10")
    columns = measured_columns(robot)
    s = sample(robot.model, 100)
    rows = regressor_rows(robot, columns, s.q, s.v, s.a).reshape(-1, len(columns.names))
    whole = base_parameters(rows, columns.names)
    factor = base_parameters(np.linalg.qr(rows, mode="r"), columns.names)
    np.testing.assert_array_equal(whole.independent, factor.independent)
    np.testing.assert_allclose(whole.matrix, factor.matrix, atol=1e-11)


def test_drive_columns_add_friction() -> None:
    robot = load_robot("panda")
    columns = measured_columns(robot, DRIVE_TERMS)
    s = sample(robot.model, 5)
    rows = regressor_rows(robot, columns, s.q, s.v, s.a)
    terms = np.random.default_rng(3).uniform(size=(4, robot.n_joints))
    phi = np.concatenate([np.zeros(10 * len(robot.segments)), terms.ravel()])
    truth = terms[0] * s.v + terms[1] * np.sign(s.v) + terms[2] + terms[3] * s.a
    np.testing.assert_allclose(rows @ phi, truth, atol=1e-12)
    assert columns.names[70] == f"viscous({robot.joint_names[0]})"


def test_feet_beyond_ankle_sensors_have_no_columns(g1: Robot) -> None:
    columns = measured_columns(g1)
    for sensor in g1.sensors:
        for segment in sensor.excludes:
            assert len(columns.of_segment(segment)) == 0
    assert len(columns.names) == 280
    s = sample(g1.model, 3)
    phi = g1.nominal_parameters.copy()
    rows = regressor_rows(g1, columns, s.q, s.v, s.a)
    for sensor in g1.sensors:
        for segment in sensor.excludes:
            phi[g1.parameter_columns(segment)] = 0.0
    full = regressor_rows(on_plates(g1), measured_columns(on_plates(g1)), s.q, s.v, s.a)
    np.testing.assert_allclose(rows @ phi[columns.inertial], full @ phi, atol=1e-9)


def test_combination_in_words() -> None:
    assert (
        describe_combination(np.array([-1.0, 0.0, 0.1234567, -2.0]), ["a", "b", "c", "d"])
        == "-a + 0.123·c - 2·d"
    )
    assert describe_combination(np.zeros(2), ["a", "b"]) == "0"


def test_faults() -> None:
    with pytest.raises(InputError, match="for 2 names"):
        base_parameters(np.eye(3), ["a", "b"])
    with pytest.raises(InputError, match="NaN"):
        base_parameters(np.full((2, 1), np.nan), ["a"])
    with pytest.raises(InputError, match="zero"):
        base_parameters(np.zeros((2, 1)), ["a"])
    with pytest.raises(UnknownNameError, match="stiction"):
        measured_columns(load_robot("panda"), ("stiction",))
