"""Virtual twins: they differ from their models in everything that real robots differ in, and can exist."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.simulation.true_parameters import nominal_drives, principal_inertia
from tests.reproduction.twins import TorqueCalibration, virtual_twin
from tests.simulation.motions import generator


@pytest.fixture(scope="module", params=["jaco2", "iiwa14", "hrp2like"])
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


def test_bodies_of_a_twin_can_exist_and_weigh_more(robot: Robot) -> None:
    twin = virtual_twin(robot, generator(1))
    phi, nominal = twin.truth.phi.reshape(-1, 10), robot.nominal_parameters.reshape(-1, 10)
    for segment, block in zip(robot.segments, phi, strict=True):
        principal_inertia(block, segment.name)
    added = 5.0 if robot.floating else (0.04 + 0.05) * robot.mass
    assert twin.truth.added_mass == pytest.approx(added)
    measured = [i for i in range(len(phi)) if all(i not in sensor.excludes for sensor in robot.sensors)]
    assert (np.abs(phi - nominal).max(axis=1) > 0.0)[measured].all()
    beyond = sorted(set(range(len(phi))) - set(measured))
    np.testing.assert_array_equal(phi[beyond], nominal[beyond])


def test_friction_noise_and_sensors_differ(robot: Robot) -> None:
    twin, declared = virtual_twin(robot, generator(1)), nominal_drives(robot)
    assert twin.noise > 1.0
    assert (twin.drives.total_viscous != declared.viscous).all()
    assert (twin.drives.bearing_coulomb > 0.0).all()
    if not robot.floating:
        (calibration,) = twin.readings
        assert isinstance(calibration, TorqueCalibration)
        assert np.ptp(calibration.gain) > 0.0 and np.abs(calibration.offset).max() > 0.0


def test_the_same_seed_gives_the_same_twin(robot: Robot) -> None:
    one, two, other = (virtual_twin(robot, generator(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.truth.phi, two.truth.phi)
    assert dataclasses.asdict(one.drives).keys() == dataclasses.asdict(two.drives).keys()
    np.testing.assert_array_equal(one.drives.coulomb, two.drives.coulomb)
    assert one.readings == two.readings
    assert np.abs(one.truth.phi - other.truth.phi).max() > 0.0
