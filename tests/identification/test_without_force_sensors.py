"""From motions of a robot without force sensors to its parameters: simulated, logged, read, identified."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import LogError
from excite.identification.constraints.linear import measured_total_mass
from excite.identification.problem import build_problem
from excite.identification.regression import condense_problem, iterate_weights
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.motion.generators.registry import make_generator
from excite.robot.robot import Robot
from excite.rows.kinematics import imu_motion
from excite.rows.settings import ProblemSettings
from excite.safety.filter import filter_candidate
from excite.simulation.sensing import imu_readings, log_header
from excite.simulation.true_parameters import AddedPart, with_part
from excite.simulation.virtual_robot import Recording, VirtualRobot, changed_robot, nominal_robot
from tests.quadruped import quadruped
from tests.simulation.motions import simulate

_LOAD = 1.5


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return quadruped(tmp_path_factory.mktemp("toy"))


@pytest.fixture(scope="module")
def loaded(toy: Robot) -> VirtualRobot:
    virtual = nominal_robot(toy)
    load = AddedPart("load", 0, "trunk", _LOAD, (-0.03, 0.02, 0.08), (0.1, 0.1, 0.05))
    return replace(virtual, truth=with_part(virtual.truth, load))


@pytest.fixture(scope="module")
def log(toy: Robot, loaded: VirtualRobot) -> Log:
    motions = []
    for generator, count in (("sway", 3), ("foot_swing", 4)):
        for candidate in make_generator(generator).candidates(toy, count, np.random.SeedSequence(5)):
            motion = filter_candidate(toy, candidate).motion
            assert motion is not None, candidate.name
            motions.append(motion)
    return simulate(loaded, motions, seed=0)


def test_truth_leaves_nothing_but_the_torques_noise(toy: Robot, loaded: VirtualRobot, log: Log) -> None:
    problem = build_problem(toy, log)
    truth = problem.prior.copy()
    truth[: problem.n_inertial] = loaded.truth.phi
    left, before = problem.residual(truth), problem.residual(problem.prior)
    noise = 0.05 * np.sqrt(5.0 / 100.0)
    for joint in problem.channel_names:
        rows = problem.rows_of(joint)
        assert np.sqrt(np.mean(left[rows] ** 2)) < 2.5 * noise
        assert np.sqrt(np.mean(left[rows] ** 2)) < 0.5 * np.sqrt(np.mean(before[rows] ** 2))


def test_joint_torques_and_an_imu_weigh_the_robot(toy: Robot, log: Log) -> None:
    mass = measured_total_mass(iterate_weights(condense_problem(build_problem(toy, log))))
    assert mass.identifiable
    assert mass.value == pytest.approx(toy.mass + _LOAD, rel=0.01)


def test_its_log_comes_back_as_it_was_saved(toy: Robot, log: Log, tmp_path: Path) -> None:
    folder = tmp_path / "log"
    save_log(log, folder)
    again = load_log(folder)
    assert again.header.feet == log.header.feet
    assert again.header.imu == log.header.imu
    for one, other in zip(again.trials, log.trials, strict=True):
        assert np.array_equal(one.imu, other.imu)
        assert one.contacts.keys() == other.contacts.keys()
        for foot, flags in one.contacts.items():
            assert np.array_equal(flags, other.contacts[foot])
    # One foot at a time is in the air for a good part of a swing.
    least = [min(flags.mean() for flags in trial.contacts.values()) for trial in log.trials]
    assert min(least[:3]) > 0.8 > max(least[3:])
    assert np.array_equal(build_problem(toy, again).Y, build_problem(toy, log).Y)


def test_a_used_robot_without_hands_carries_a_load(toy: Robot) -> None:
    virtual = changed_robot(toy, np.random.default_rng(0))
    assert [part.link for part in virtual.truth.parts] == ["trunk"]
    assert virtual.truth.added_mass == pytest.approx(0.12 * toy.mass)


def test_a_foot_without_its_flag_is_named(toy: Robot, log: Log) -> None:
    mute = tuple(
        replace(trial, contacts={k: v for k, v in trial.contacts.items() if k != "RL"})
        for trial in log.trials
    )
    with pytest.raises(LogError, match=r"contact\.RL: is missing"):
        build_problem(toy, replace(log, trials=mute))


def test_the_imu_stands_for_the_base_motion(toy: Robot) -> None:
    """Whatever the pose and the linear velocity, inverse dynamics is that of the whole motion."""
    random = np.random.default_rng(2)
    model, data = toy.model, toy.model.createData()
    n, rate, step = 5, 1000.0, 1e-3
    q = [pin.integrate(model, toy.rest, 0.4 * random.normal(size=model.nv))]
    v = [random.normal(size=model.nv)]
    a = random.normal(size=model.nv)
    for _ in range(n - 1):
        q.append(pin.integrate(model, q[-1], step * v[-1]))
        v.append(v[-1] + step * a)
    recording = Recording(
        "toy",
        np.arange(n) * step,
        np.array(q),
        np.array(v),
        np.tile(a, (n, 1)),
        *[np.zeros(0)] * 4,
        {},
        {},
        np.zeros(0),
    )
    readings = imu_readings(toy, recording)
    header = log_header(toy, ({"file": "a.parquet", "role": "identification"},))
    level = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    acceleration, angular = imu_motion(toy, header, readings, level, rate)
    k = n // 2
    whole = pin.rnea(model, data, q[k], v[k], a).copy()
    seen = q[k].copy()
    seen[:7] = [9.0, 9.0, 9.0, 0.0, 0.0, 0.0, 1.0]
    found = pin.rnea(
        model, data, seen, np.r_[np.zeros(3), angular[k], v[k][6:]], np.r_[acceleration[k], a[6:]]
    )
    assert np.allclose(found, whole, atol=1e-9)


def test_hung_up_its_joints_rows_hold_while_it_swings(tmp_path: Path) -> None:
    robot = quadruped(tmp_path, "suspended")
    candidate = make_generator("random_joint").candidates(robot, 1, np.random.SeedSequence(1))[0]
    motion = filter_candidate(robot, candidate).motion
    assert motion is not None
    virtual = replace(nominal_robot(robot), noise=0.0)
    log = simulate(virtual, [motion], seed=0)
    assert log.header.base == "suspended"
    assert np.ptp(log.trials[0].base[:, 3:], axis=0).max() > 1e-3
    problem = build_problem(robot, log, ProblemSettings(cutoff_hz=10.0))
    assert np.sqrt(np.mean(problem.residual(problem.prior) ** 2)) < 0.02 * np.sqrt(np.mean(problem.y**2))
