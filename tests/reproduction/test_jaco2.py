"""Golluccio et al. 2020: frames of Table 1, 43 base parameters, the combinations of Table 3."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from excite.arrays import Array
from excite.regressor.base_parameters import structural_base_parameters
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.reproduction.jaco2 import (
    TABLE_4,
    TABLE_5_CONSISTENCY,
    D,
    coefficients,
    combinations,
    denavit_hartenberg,
    published_rows,
)
from tests.reproduction.jaco2_experiment import METHODS, Trajectories, run


@pytest.fixture(scope="module")
def jaco2() -> Robot:
    return load_robot("jaco2")


@pytest.fixture(scope="module")
def regressor(jaco2: Robot) -> Array:
    """Joint torque regressor at random states, by pinocchio, ``(350, 70)``."""
    rng, data = np.random.default_rng(0), jaco2.model.createData()
    states = [(rng.uniform(-3, 3, 7), rng.normal(size=7), 5 * rng.normal(size=7)) for _ in range(50)]
    return np.vstack([pin.computeJointTorqueRegressor(jaco2.model, data, *state) for state in states])


def unexplained(rows: Array, regressor: Array) -> Array:
    """Share of each row that lies outside the regressor's row space."""
    _, values, basis = np.linalg.svd(regressor, full_matrices=False)
    basis = basis[values > 1e-10 * values[0]]
    return np.linalg.norm(rows - rows @ basis.T @ basis, axis=1) / np.linalg.norm(rows, axis=1)


def test_frames_are_those_of_table_1(jaco2: Robot) -> None:
    data, rng = jaco2.model.createData(), np.random.default_rng(1)
    for _ in range(5):
        q = rng.uniform(-3, 3, 7)
        pin.forwardKinematics(jaco2.model, data, q)
        rotations, origins = denavit_hartenberg(q)
        for joint in range(1, 8):
            np.testing.assert_allclose(data.oMi[joint].rotation, rotations[joint - 1], atol=1e-12)
            np.testing.assert_allclose(data.oMi[joint].translation, origins[joint - 1], atol=1e-12)


def test_there_are_43_base_parameters(jaco2: Robot, regressor: Array) -> None:
    assert np.linalg.matrix_rank(regressor) == 43
    base = structural_base_parameters(jaco2, ())
    assert base.rank == 43
    assert base.largest_dropped < 1e-12 < 0.1 < base.smallest_kept


def test_table_3_holds_to_1e_9(jaco2: Robot, regressor: Array) -> None:
    """Each combination is one that the regressor determines, and ours are they, coefficient by coefficient."""
    published = published_rows()
    assert unexplained(published, regressor).max() < 1e-9
    assert np.linalg.matrix_rank(published) == 43
    ours = structural_base_parameters(jaco2, ()).matrix
    apart = np.abs(ours[:, None] - published[None]).max(axis=2)
    assert apart.min(axis=0).max() < 1e-9 and apart.min(axis=1).max() < 1e-9


def test_the_printed_sign_of_d3_in_beta_2_is_a_misprint(jaco2: Robot, regressor: Array) -> None:
    """With -d3 as printed the combination is not identifiable; all others are. Table 4's own CAD column has +d3."""
    shares = unexplained(published_rows(-1.0), regressor)
    assert shares[1] > 0.1 and np.delete(shares, 1).max() < 1e-9
    behind = jaco2.nominal_parameters[30::10].sum()
    assert TABLE_4["β5"][0] == pytest.approx(D[4] * (behind - jaco2.nominal_parameters[30]), rel=1e-3)
    assert TABLE_4["β2"][0] == pytest.approx(D[3] * behind, rel=5e-3)


def test_the_makers_figures_come_near_what_the_article_identified(jaco2: Robot) -> None:
    """First moments of Kinova's links, referred to the frames of Table 1, against the columns ULS and CLS-3."""
    values = {name: coefficients(terms) @ jaco2.nominal_parameters for name, terms in combinations().items()}
    for name in ("β2", "β9", "β17"):
        cad, *identified = TABLE_4[name]
        for value in identified:
            assert values[name] == pytest.approx(value, rel=0.08)
        assert abs(values[name] - identified[0]) < abs(cad - identified[0])


@pytest.fixture(scope="module")
def trajectories() -> Trajectories:
    return run(n_trajectories=2)


def test_the_pattern_of_table_5(trajectories: Trajectories) -> None:
    """Least squares fits best what it has seen; CLS-3 predicts best and is the only one that can exist."""
    estimates = {method: trajectories.estimate(method, 0) for method in METHODS}
    seen = {method: trajectories.error(0, phi) for method, phi in estimates.items()}
    unseen = {method: trajectories.error(1, phi) for method, phi in estimates.items()}
    assert min(seen, key=seen.get) == "ULS" and max(unseen, key=unseen.get) == "CAD"
    assert unseen.pop("CAD") > unseen["CLS-3"]
    assert unseen["CLS-3"] <= 1.02 * min(unseen.values())
    for row, published in TABLE_5_CONSISTENCY.items():
        found = [trajectories.criteria(0, estimates[method])[row] for method in METHODS]
        assert found == list(published), row
