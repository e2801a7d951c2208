"""Standing robots of a blind benchmark obey the laws of motion, whatever is hidden in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.blind.floating import FORMS, MAKERS, Site, floating_draft
from benchmarks.blind.standing_case import Stand, _mount_sensor, standing_robot, trial_of
from benchmarks.blind.standing_effects import Truth, true_recording, truth_of
from excite.arrays import Array
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import LogHeader
from excite.logs.robot import robot_in_log
from excite.motion.motion import Motion
from excite.robot.robot import Robot


@pytest.fixture(scope="module")
def robot() -> Robot:
    return standing_robot("hrp2like")


def stand(robot: Robot, sensors: str = "force_plate") -> Stand:
    """A second of arm swings and swaying."""
    rng = np.random.default_rng(3)
    time = np.arange(100) / 100.0
    window, omega = np.sin(np.pi * time) ** 4, 2.0 * np.pi * 1.3
    q = np.tile(robot.rest, (len(time), 1))
    arms = [k for k, name in enumerate(robot.joint_names) if "arm" in name]
    for k in arms:
        q[:, 7 + k] += 0.3 * window * np.sin(omega * time + k)
    q[:, :2] += 0.03 * window[:, None] * np.column_stack([np.sin(omega * time), np.cos(omega * time)])
    # The base stays upright, so that its velocity in its own frame is that in the world.
    rates = np.gradient(q, time, axis=0)
    v = np.hstack([rates[:, :6], rates[:, 7:]])
    contacts = {foot.name: np.ones(len(time), dtype=bool) for foot in robot.feet}
    motion = Motion(
        "trial_00", robot.name, robot.joint_names, time, q, v, np.gradient(v, time, axis=0), contacts
    )
    header = LogHeader(
        schema="excite.log/1",
        robot="robot.urdf",
        base="floating",
        rate_hz=100.0,
        joints=robot.joint_names,
        base_link=robot.base_link,
        wrench="on_robot_in_sensor_frame",
        sensors=tuple(_mount_sensor(robot, foot, sensors, 1.0, rng) for foot in robot.feet),
        trials=(TrialHeader(file="trial_00.parquet", role="identification"),),
    )
    return Stand(robot_in_log(robot, header), header, (motion,) * 3, robot.nominal_parameters, 1.0)


def total(truth: Truth, wrenches: dict[str, Array]) -> Array:
    """Force of two plates on the robot, world frame."""
    sensors = truth.stand.robot.sensors
    return sum(wrenches[sensor.name][:, :3] @ sensor.placement.rotation.T for sensor in sensors)


def hidden(truth: Truth, effect: str, form: str, seed: int = 5) -> tuple[Truth, str]:
    changed, what = MAKERS[effect](Site(truth, effect, form, 1.0, np.random.default_rng(seed)))
    return changed, what.location


def test_plates_carry_what_momentum_asks_for(robot: Robot) -> None:
    truth = truth_of(stand(robot))
    recording = truth.logged()[0]
    force, model = total(truth, recording.wrenches), truth.stand.robot.model
    data = model.createData()
    for k in range(20, 90, 20):
        pin.centerOfMass(model, data, recording.q[k], recording.v[k], recording.a[k])
        expected = robot.mass * (data.acom[0] + [0.0, 0.0, 9.81])
        np.testing.assert_allclose(force[k], expected, atol=1e-6 * robot.mass)


def test_a_payload_weighs_on_the_plates(robot: Robot) -> None:
    plain = truth_of(stand(robot))
    loaded, _ = MAKERS["payload"](Site(plain, "payload", "plain", 1.0, np.random.default_rng(1)))
    more = total(loaded, loaded.logged()[0].wrenches) - total(plain, plain.logged()[0].wrenches)
    added = loaded.phi[::10].sum() - plain.phi[::10].sum()
    assert added > 0.3
    # At rest, but for a last trace of the sway.
    assert more[0, 2] == pytest.approx(9.81 * added, rel=1e-3)


def test_soles_stay_where_they_stand_over_legs_of_another_length(robot: Robot) -> None:
    truth = truth_of(stand(robot))
    knee = next(j for j, name in enumerate(robot.model.names) if "leg" in name and "knee" in name)
    model = truth.model.copy()
    pose = model.jointPlacements[knee]
    model.jointPlacements[knee] = pin.SE3(pose.rotation, pose.translation + np.array([0.0, 0.0, 0.01]))
    recording = true_recording(replace(truth, model=model), truth.stand.motions[0], 0)
    wanted, data = robot.model.createData(), model.createData()
    for q, plan in zip(recording.q[::20], truth.stand.motions[0].q[::20], strict=True):
        pin.forwardKinematics(model, data, q)
        pin.forwardKinematics(robot.model, wanted, plan)
        for foot in robot.feet:
            assert data.oMi[foot.joint].isApprox(wanted.oMi[foot.joint], 1e-6)
    assert np.abs(recording.q - truth.stand.motions[0].q).max() > 1e-3


@pytest.mark.parametrize("effect", sorted(FORMS))
def test_every_effect_changes_what_is_logged(robot: Robot, effect: str) -> None:
    plain = truth_of(stand(robot, "foot_ft"))
    before = true_recording(plain, plain.stand.motions[0], 0)
    for form in FORMS[effect]:
        changed, place = hidden(plain, effect, form)
        after = true_recording(changed, plain.stand.motions[0], 0)
        for reading in changed.readings:
            after = reading(after)
        moved = max(
            np.abs(after.q - before.q).max(),
            *(np.abs(after.wrenches[name] - wrench).max() for name, wrench in before.wrenches.items()),
        )
        assert moved > 1e-3, form
        assert place


def test_noise_is_that_of_the_header(robot: Robot) -> None:
    here = stand(robot)
    still = truth_of(here).logged()[0]
    header = here.header.trials[0]
    quiet = trial_of(here.robot, still, header, 0.0, np.random.default_rng(0))
    noisy = trial_of(here.robot, still, header, 1.0, np.random.default_rng(0))
    for sensor in here.robot.sensors:
        spread = (noisy.wrenches[sensor.name] - quiet.wrenches[sensor.name])[:, :3].std()
        # Half of the band passes the recorder's filter.
        assert spread == pytest.approx(np.sqrt(0.48) * sensor.noise_force, rel=0.15)


def test_a_battery_goes_round_all_effects() -> None:
    plans = [floating_draft(k, np.random.default_rng(k)) for k in range(30)]
    seen = {name for plan in plans for name, _ in plan.effects}
    assert seen == set(FORMS)
    assert sum(plan.kind == "none" for plan in plans) == 6
    assert all(plan.fixed for plan in plans if any(name == "payload" for name, _ in plan.effects))
