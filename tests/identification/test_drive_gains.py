"""Gains of drives from a known load, and a load from known gains, on simulated currents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.errors import ExciteError, LogError
from excite.identification.load import WeighedLoad, weigh_load
from excite.robot.loading import load_robot
from excite.rows.settings import ProblemSettings
from tests.identification.practice_log import arm_log, changed
from tests.identification.synthetic import add_body

TRUE_GAINS = np.array([14.9, 13.3, 11.1, 10.6, 11.0, 11.5])
MASS, AT = 2.5, np.array([0.03, 0.1, -0.12])
SETTINGS = ProblemSettings(cutoff_hz=5.0, drive_terms=("viscous", "coulomb", "offset", "armature"))


@pytest.fixture(scope="module")
def robot():
    return load_robot("ur10")


@pytest.fixture(scope="module")
def pair(robot):
    """The same motions without and with a load; motor currents with noise."""
    bare = robot.nominal_parameters * 1.05
    carried = bare.copy()
    carried[-10:] = add_body(carried[-10:], MASS, AT, 0.06)

    def in_amperes(log):
        return changed(log, lambda t: replace(t, tau=None, current=t.tau / TRUE_GAINS), torque="current")

    return tuple(in_amperes(arm_log(robot, 3, true=true, trials=2)) for true in (bare, carried))


def gains_of(found: WeighedLoad) -> np.ndarray:
    return np.array(list(found.gains.values()))


def test_gains_and_the_load_are_found_within_their_uncertainty(robot, pair):
    found = weigh_load(robot, *pair, mass=MASS, settings=SETTINGS)
    error, std = np.abs(gains_of(found) - TRUE_GAINS), np.array(list(found.gains_std.values()))
    assert (error < 0.02 * TRUE_GAINS).all(), found.summary()
    assert (error < 5.0 * std + 1e-3 * TRUE_GAINS).all(), found.summary()
    assert found.mass == MASS and found.half_width_95[0] == 0.0
    np.testing.assert_allclose(found.parameters[1:4] / MASS, AT, atol=3e-3)


def test_a_load_is_weighed_with_known_gains(robot, pair):
    gains = dict(zip(pair[0].header.joints, TRUE_GAINS, strict=True))
    found = weigh_load(robot, *pair, gains=gains, settings=SETTINGS)
    assert abs(found.mass - MASS) < 0.01 * MASS
    np.testing.assert_array_equal(gains_of(found), TRUE_GAINS)
    more = {name: 1.1 * gain for name, gain in gains.items()}
    wrong = weigh_load(robot, *pair, gains=more, settings=SETTINGS)
    assert wrong.mass == pytest.approx(1.1 * found.mass, rel=1e-6)


def test_gains_scale_with_the_mass_that_is_stated(robot, pair):
    """Mass of the load and scale of the gains are one and the same piece of knowledge."""
    found, double = (weigh_load(robot, *pair, mass=mass, settings=SETTINGS) for mass in (MASS, 2.0 * MASS))
    np.testing.assert_allclose(gains_of(double), 2.0 * gains_of(found), rtol=1e-4)


def test_what_is_missing_is_named(robot, pair):
    with pytest.raises(LogError, match="no gain"):
        weigh_load(robot, *pair, gains={}, settings=SETTINGS)
    torques = changed(pair[0], lambda t: replace(t, tau=t.current, current=None), torque="motor_side")
    with pytest.raises(LogError, match="others than the first log"):
        weigh_load(robot, torques, pair[1], mass=MASS, settings=SETTINGS)
    nothing = changed(pair[0], lambda t: t, torque="none")
    with pytest.raises(LogError, match="no currents"):
        weigh_load(robot, nothing, pair[1], mass=MASS, settings=SETTINGS)
    with pytest.raises(ExciteError, match="mass"):
        weigh_load(robot, *pair, mass=-1.0, settings=SETTINGS)


def test_the_scale_of_logged_torques_is_found_likewise(robot, pair):
    """Logged torques are the true ones over a factor of each joint."""
    logs = [
        changed(log, lambda t: replace(t, tau=t.current, current=None), torque="motor_side") for log in pair
    ]
    found = weigh_load(robot, *logs, mass=MASS, settings=SETTINGS)
    np.testing.assert_allclose(gains_of(found), TRUE_GAINS, rtol=0.02)
