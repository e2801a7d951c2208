"""Gains of drives from a known load, and a load from known gains, on simulated currents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.errors import ExciteError, LogError
from excite.identification.load import identify_drive_gains, identify_load
from excite.robot.loading import load_robot
from excite.rows.settings import ProblemSettings
from tests.identification.practice_log import arm_log, changed
from tests.identification.synthetic import add_body

TRUE_GAINS = np.array([14.9, 13.3, 11.1, 10.6, 11.0, 11.5])
MASS, AT = 2.5, np.array([0.03, 0.1, -0.12])
SETTINGS = ProblemSettings(cutoff_hz=5.0)


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


def test_gains_and_the_load_are_found_within_their_uncertainty(robot, pair):
    found = identify_drive_gains(robot, *pair, MASS, SETTINGS)
    error = np.abs(found.gains - TRUE_GAINS)
    assert (error < 0.02 * TRUE_GAINS).all(), found.summary()
    assert (error < 5.0 * found.gains_std + 1e-3 * TRUE_GAINS).all(), found.summary()
    assert found.load[0] == MASS and found.load_std[0] == 0.0
    np.testing.assert_allclose(found.load[1:4] / MASS, AT, atol=3e-3)


def test_a_load_is_weighed_with_known_gains(robot, pair):
    gains = dict(zip(pair[0].header.joints, TRUE_GAINS, strict=True))
    found = identify_load(robot, *pair, gains, SETTINGS)
    assert abs(found.load[0] - MASS) < 0.01 * MASS
    np.testing.assert_array_equal(found.gains, TRUE_GAINS)
    wrong = identify_load(robot, *pair, {name: 1.1 * gain for name, gain in gains.items()}, SETTINGS)
    assert wrong.load[0] == pytest.approx(1.1 * found.load[0], rel=1e-6)


def test_gains_scale_with_the_mass_that_is_stated(robot, pair):
    """Mass of the load and scale of the gains are one and the same piece of knowledge."""
    found = identify_drive_gains(robot, *pair, MASS, SETTINGS)
    double = identify_drive_gains(robot, *pair, 2.0 * MASS, SETTINGS)
    np.testing.assert_allclose(double.gains, 2.0 * found.gains, rtol=1e-4)


def test_what_is_missing_is_named(robot, pair):
    with pytest.raises(LogError, match="no gain"):
        identify_load(robot, *pair, {}, SETTINGS)
    torques = changed(pair[0], lambda t: replace(t, tau=t.current, current=None), torque="motor_side")
    with pytest.raises(LogError, match="others than the first log"):
        identify_drive_gains(robot, torques, pair[1], MASS, SETTINGS)
    nothing = changed(pair[0], lambda t: t, torque="none")
    with pytest.raises(LogError, match="no currents"):
        identify_drive_gains(robot, nothing, pair[1], MASS, SETTINGS)
    with pytest.raises(ExciteError, match="mass"):
        identify_drive_gains(robot, *pair, -1.0, SETTINGS)


def test_the_scale_of_logged_torques_is_found_likewise(robot, pair):
    """Logged torques are the true ones over a factor of each joint."""
    logs = [
        changed(log, lambda t: replace(t, tau=t.current, current=None), torque="motor_side") for log in pair
    ]
    found = identify_drive_gains(robot, *logs, MASS, SETTINGS)
    np.testing.assert_allclose(found.gains, TRUE_GAINS, rtol=0.02)
    assert "N·m/A" not in found.summary()
    assert "N·m/A" in replace(found, unit="N·m/A").summary()
