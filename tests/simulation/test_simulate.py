"""Logs of virtual robots: repeatable, complete, as noisy as declared."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.errors import InputError
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.robot.robot import Robot
from excite.simulation.simulate import run_experiment
from excite.simulation.virtual_robot import Recording, VirtualRobot, nominal_robot
from tests.simulation.motions import simulate, squatting, standing, waving


def _motions(robot: Robot) -> list:
    return [standing(robot, 0.5), squatting(robot, duration=1.0)]


def _same(first: Log, second: Log) -> bool:
    return first.header == second.header and all(
        a.q.tobytes() == b.q.tobytes()
        and a.base.tobytes() == b.base.tobytes()
        and all(a.wrenches[name].tobytes() == b.wrenches[name].tobytes() for name in a.wrenches)
        for a, b in zip(first.trials, second.trials, strict=True)
    )


def test_same_seed_same_bytes_with_any_number_of_processes(g1: Robot) -> None:
    virtual = nominal_robot(g1)
    one, two = (simulate(virtual, _motions(g1), seed=7, jobs=jobs) for jobs in (1, 2))
    assert _same(one, two)
    assert not _same(one, simulate(virtual, _motions(g1), seed=8))


def test_a_trial_does_not_depend_on_those_after_it(g1: Robot) -> None:
    virtual, motions = nominal_robot(g1), _motions(g1)
    seed = np.random.SeedSequence(7)
    both, alone = simulate(virtual, motions, seed=seed), simulate(virtual, motions[:1], seed=seed)
    assert both.trials[0].q.tobytes() == alone.trials[0].q.tobytes()


def test_a_log_survives_its_folder(g1: Robot, tmp_path: Path) -> None:
    log = simulate(nominal_robot(g1), _motions(g1), seed=1, roles={"squatting": "validation"})
    back = load_log(save_log(log, tmp_path / "log"), g1)
    assert [trial.role for trial in back.trials] == ["identification", "validation"]
    assert _same(log, back)
    assert back.header.sensors[0].excludes == ("left_ankle_roll_link",)
    assert back.header.torque == "none"
    assert back.header.controller["kp"]["left_knee_joint"] == pytest.approx(8000.0)


def test_noise_is_as_declared(g1: Robot) -> None:
    virtual, motions = nominal_robot(g1), [standing(g1, 2.0)]
    noisy = simulate(virtual, motions, seed=2).trials[0]
    clean = simulate(replace(virtual, noise=0.0), motions, seed=2).trials[0]
    sensors = g1.description.sensors
    assert (noisy.q - clean.q).std() == pytest.approx(sensors.noise_position, rel=0.05)
    assert (noisy.base - clean.base)[:, :3].std() == pytest.approx(sensors.noise_base_position, rel=0.15)
    turned = 2.0 * (noisy.base - clean.base)[:, 3:6]
    assert turned.std() == pytest.approx(sensors.noise_base_orientation, rel=0.15)
    wrench = noisy.wrenches["left_foot"] - clean.wrenches["left_foot"]
    assert wrench[:, :3].std() == pytest.approx(g1.sensors[0].noise_force, rel=0.1)
    assert wrench[:, 3:].std() == pytest.approx(g1.sensors[0].noise_moment, rel=0.1)


def test_an_arm_logs_the_torque_that_its_sensors_see(arm: VirtualRobot, arm_run: Recording) -> None:
    robot = arm.robot
    motion = waving(robot, dict.fromkeys(robot.joint_names, 0.4), duration=2.0)
    log = simulate(arm, [motion], seed=0)
    side = robot.description.sensors.joint_torque
    expected = arm_run.tau_link if side == "link_side" else arm_run.tau_motor
    np.testing.assert_array_equal(log.trials[0].tau, expected)
    assert log.header.torque == side
    assert {"rigid_body", "viscous_friction", "coulomb_friction"} <= set(log.header.modelled)


def test_a_fall_ends_its_trial_and_is_told(g1: Robot) -> None:
    hips = {name: 1.2 for name in g1.joint_names if "hip_pitch" in name}
    motions = [waving(g1, hips, duration=3.0, name="leaning"), standing(g1, 0.5)]
    experiment = run_experiment(nominal_robot(g1), motions, seed=0)
    assert [replay.fell for replay in experiment.replays] == [True, False]
    assert experiment.log.trials[0].time[-1] < 2.0


def test_wrong_requests_are_refused(g1: Robot) -> None:
    virtual, motion = nominal_robot(g1), standing(g1, 0.1)
    with pytest.raises(InputError, match="no motions"):
        simulate(virtual, [], seed=0)
    with pytest.raises(InputError, match="two motions are called 'standing'"):
        simulate(virtual, [motion, motion], seed=0)
    with pytest.raises(InputError, match="not run"):
        simulate(virtual, [motion], seed=0, roles={"jump": "validation"})
