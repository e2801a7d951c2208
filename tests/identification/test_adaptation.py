"""The default method adds what a log asks for beside rigid bodies, and nothing where it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from excite.identification.adaptation import evident_spreads
from excite.identification.estimators.method_settings import estimator_settings
from excite.identification.identify import identify
from excite.identification.problem import build_problem
from excite.identification.regression import condense_problem, iterate_weights
from excite.identification.result import Identification
from excite.identification.statistics import base_statistics
from excite.logs.log import Log
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.rows.drive_terms import EXTENSIONS
from excite.rows.settings import ProblemSettings
from tests.identification.practice_log import arm_log


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("ur10")


@pytest.fixture(scope="module")
def clean(robot: Robot) -> Log:
    return arm_log(robot, 3)


@pytest.fixture(scope="module")
def plain(robot: Robot, clean: Log) -> Identification:
    return identify(robot, clean)


@pytest.fixture(scope="module")
def scaled(clean: Log) -> Log:
    """The third joint's torques are read larger than they are."""
    return with_torques(clean, lambda tau, v: tau * np.array([1.0, 1.0, 1.6, 1.0, 1.0, 1.0]))


@pytest.fixture(scope="module")
def found(robot: Robot, scaled: Log) -> Identification:
    return identify(robot, scaled)


def with_torques(log: Log, change) -> Log:
    """The log with ``change(tau, v)`` in the place of its torques."""
    trials = [
        replace(trial, tau=change(trial.tau, np.gradient(trial.q, trial.time, axis=0)))
        for trial in log.trials
    ]
    return replace(log, trials=tuple(trials))


def added(result) -> tuple[str, ...]:
    return next((item.places for item in result.findings if item.kind == "extension"), ())


def left(result) -> float:
    return sum(fit.rmse for fit in result.validation.values())


def test_a_log_of_rigid_bodies_and_friction_gets_nothing_added(plain):
    assert added(plain) == ()
    assert not any(name.split(".")[0] in EXTENSIONS for name in plain.identified.drive_names)
    assert not plain.consistency.inconsistent


def test_friction_that_grows_with_the_load_is_added_and_named(robot, clean):
    def loaded(tau, v):
        own = np.eye(6)[1]
        return tau + 0.07 * own * np.abs(tau) * np.tanh(v / 0.01)

    log = with_torques(clean, loaded)
    found = identify(robot, log)
    assert added(found)[0] == "load_friction"
    drives = found.identified.by_drive()
    size = {name: abs(value) for name, value in drives.items() if name.startswith("load_friction")}
    assert max(size, key=size.get) == f"load_friction.{robot.joint_names[1]}"
    assert drives[f"load_friction.{robot.joint_names[1]}"] == pytest.approx(0.07, abs=0.02)
    assert left(found) < 0.8 * left(identify(robot, log, "wls"))
    assert not found.consistency.inconsistent


def test_a_torque_scale_that_no_bodies_explain_is_taken_out_of_them(robot, scaled, found):
    stated = identify(robot, scaled, settings=stated_terms())
    assert "gain" in added(found) and added(stated) == ()
    assert left(found) < left(stated)
    assert not found.consistency.inconsistent


def test_deviations_are_those_of_bodies_and_friction_alone(robot, scaled, found):
    names = [name for name in found.identified.drive_names if name.split(".")[0] not in EXTENSIONS]
    bare = build_problem(robot, scaled).with_drives(names)
    expected = base_statistics(iterate_weights(condense_problem(bare)))
    assert "gain" in added(found)
    np.testing.assert_allclose([item.std for item in found.base], expected.std, rtol=1e-6)


class TestEvidence:
    """Spreads of parameters in question against the probability of the measurement, by scipy."""

    def drawn(self, seed: int):
        rng = np.random.default_rng(seed)
        matrix = rng.normal(size=(40, 7)) * [1.0, 2.0, 0.5, 1.0, 3.0, 1.0, 0.3]
        truth = np.array([0.5, -0.4, 2.0, 0.0, 0.4, 0.0, 3.0])
        return matrix, matrix @ truth + rng.normal(size=40), np.array([0, 0, 1, 1, 1, 1, 1], dtype=bool)

    def probability(self, matrix, target, spread) -> float:
        covariance = np.eye(len(target)) + (matrix * spread**2) @ matrix.T
        return float(multivariate_normal(cov=covariance).logpdf(target))

    @pytest.mark.parametrize("seed", range(5))
    def test_no_other_spread_of_one_parameter_is_more_probable(self, seed):
        matrix, target, asked = self.drawn(seed)
        spread = evident_spreads(matrix, target, asked)
        assert (spread[:2] == 1.0).all() and (spread[[2, 4, 6]] > 0.0).all()
        best = self.probability(matrix, target, spread)
        for place in np.flatnonzero(asked):
            for factor in (0.0, 0.5, 0.9, 1.1, 2.0):
                other = spread.copy()
                other[place] = factor * spread[place] if spread[place] else 0.1 * factor
                assert self.probability(matrix, target, other) <= best + 1e-5

    def test_what_no_row_shows_is_not_there(self):
        matrix, target, asked = self.drawn(1)
        matrix[:, 3] = 0.0
        assert evident_spreads(matrix, target, asked)[3] == 0.0

    def test_units_of_columns_do_not_matter(self):
        matrix, target, asked = self.drawn(2)
        units = np.array([1.0, 1.0, 1e3, 1e-3, 10.0, 1.0, 1e6])
        np.testing.assert_allclose(
            evident_spreads(matrix * units, target, asked),
            evident_spreads(matrix, target, asked) / units,
            rtol=1e-3,
        )


def test_stated_terms_stay_whatever_the_log_says(robot, clean):
    settings = ProblemSettings(drive_terms=("offset", "root"))
    found = identify(robot, clean, problem_settings=settings)
    expected = [f"{term}.{joint}" for term in ("offset", "root") for joint in robot.joint_names]
    assert [name for name in found.identified.drive_names if name.split(".")[0] not in EXTENSIONS] == expected


def test_a_stated_weight_of_the_nominal_model_stays(robot, clean, plain):
    near = identify(robot, clean, settings=estimator_settings("adaptive", alpha=1e12))
    nominal = robot.nominal_parameters
    far = plain.identified.inertial
    assert np.abs(near.identified.inertial - nominal).max() < 0.05 * np.abs(far - nominal).max()


def stated_terms():
    return estimator_settings("adaptive", terms="stated")
