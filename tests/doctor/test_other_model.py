"""A log with the model of another machine: one cause, not several mistakes in the log."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.doctor.channel_mapping import Reading
from excite.doctor.examine import examine
from excite.doctor.mistakes.torques import left_by_any_bodies
from excite.doctor.torque_samples import torque_samples
from excite.logs.log import Log
from excite.robot.load import as_robot
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.identification.practice_log import arm_log, changed


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot("ur10")


@pytest.fixture(scope="module")
def log(arm: Robot) -> Log:
    return arm_log(arm)


def smaller(robot: Robot, length: float, mass: float) -> Robot:
    """A robot whose links are shorter and lighter by factors."""
    model = pin.Model(robot.model)
    for k in range(1, model.njoints):
        place, body = model.jointPlacements[k], model.inertias[k]
        model.jointPlacements[k] = pin.SE3(place.rotation, length * place.translation)
        model.inertias[k] = pin.Inertia(
            mass * body.mass, length * body.lever, mass * length**2 * np.array(body.inertia)
        )
    return replace(robot, model=model)


@pytest.mark.parametrize(("length", "mass"), [(0.4, 0.25), (0.5, 0.5), (2.2, 4.0)])
def test_the_log_of_a_robot_of_another_size_is_not_full_of_mistakes(
    arm: Robot, log: Log, length: float, mass: float
) -> None:
    chart = examine(smaller(arm, length, mass), log)

    (found,) = (item for item in chart.findings if item.severity == "spoils")
    assert found.kind == "other_model" and not found.repaired
    np.testing.assert_allclose(chart.log.trials[0].tau, log.trials[0].tau)


def test_bodies_explain_no_torque_that_counts_the_other_way(arm: Robot, log: Log) -> None:
    """Nor all of them, and their own as well as the model does."""
    turned = {
        "none": np.ones(6),
        "one": np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0]),
        "all": -np.ones(6),
    }
    left = {}
    for name, signs in turned.items():
        samples = torque_samples(arm, changed(log, lambda t, signs=signs: replace(t, tau=t.tau * signs)))
        assert samples is not None
        left[name] = float(left_by_any_bodies(samples, Reading.as_stated(log)).sum())
    assert left["one"] > left["none"] + 1.0
    assert left["all"] > left["none"] + 1.0


def test_mistakes_that_no_bodies_explain_are_believed_however_many(arm: Robot, log: Log) -> None:
    def spoilt(trial):
        tau = trial.tau.copy()
        tau[:, 2] *= -1.0
        tau[:, 1] *= 4.0
        return replace(trial, tau=tau)

    kinds = {item.kind for item in examine(arm, changed(log, spoilt)).findings if item.severity == "spoils"}
    assert "torque_sign" in kinds and "other_model" not in kinds


def test_weights_are_not_put_back_beside_a_payload_heavier_than_the_robot(arm: Robot, log: Log) -> None:
    """A UR10 by the model of a robot of half its masses and seven tenths of its lengths."""
    found = {one.kind for one in examine(smaller(arm, 0.7, 0.5), log).findings if one.severity != "note"}
    assert found and found <= {"torque_scale", "clock", "other_model"}


def read_with(recorded: str, model: Robot) -> Log:
    """A log of one robot under the names of another one's joints."""
    robot = load_robot(recorded)
    log = arm_log(robot, 3, torque="link_side", trials=2)
    names = dict(zip(robot.joint_names, model.joint_names, strict=True))
    header = {"joints": tuple(map(names.get, log.header.joints)), "controller": None}
    return replace(log, header=log.header.model_copy(update=header))


@pytest.mark.parametrize("recorded", ["iiwa14", "panda", "jaco2"])
@pytest.mark.parametrize("model", ["iiwa14", "panda", "jaco2"])
def test_neither_limits_nor_torques_are_another_robots(recorded: str, model: str) -> None:
    """Axes that point elsewhere: no bodies on the model's joints explain the log, and no mistake in it does."""
    robot = load_robot(model)
    found = {one.kind: one for one in examine(robot, read_with(recorded, robot)).findings}
    if recorded == model:
        assert not [one for one in found.values() if one.severity != "note"]
    else:
        assert "other_model" in found
        # A joint whose axis points elsewhere in the other robot may be turned.
        assert not {"position_sign", "torque_sign", "gravity", "torque_scale", "clock"} & found.keys()


def test_limits_that_a_mistake_explains_are_no_other_robots(arm: Robot, log: Log) -> None:
    """A joint that counts the other way, whose range is not the same on both sides, and another one in degrees."""
    uneven = replace(
        arm, limits=replace(arm.limits, position_lower=np.full(6, -0.6), position_upper=np.full(6, 3.0))
    )
    recorded = arm_log(uneven, 3)
    counted = np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
    ill = changed(recorded, lambda t: replace(t, q=t.q * counted, tau=t.tau * counted, q_cmd=None))
    kinds = {one.kind for one in examine(uneven, ill).findings if one.severity == "spoils"}
    assert kinds == {"direction"}


@pytest.mark.parametrize("model", ["rokae_xmate3pro/rokae_xmate3pro.urdf", "kuka_lbr_med/lbr_med.urdf"])
def test_a_load_that_explains_half_is_no_reason_to_believe_in_another_arms_bodies(
    data_dir: Path, model: str
) -> None:
    robot = as_robot(data_dir / model)
    assert "other_model" in {one.kind for one in examine(robot, read_with("panda", robot)).findings}


@pytest.mark.parametrize(
    ("recorded", "model"),
    [
        ("kuka_lbr_med/lbr_med.urdf", "jaco2"),
        ("kuka_lwr4_flobaroid/kuka_lwr4.urdf", "kuka_lbr_med/lbr_med.urdf"),
    ],
)
def test_neither_a_zero_nor_a_clock_nor_one_torques_size_stands_for_another_robot(
    data_dir: Path, recorded: str, model: str
) -> None:
    """Beside them bodies are still unlikely, or those of another robot explain the log as well."""
    real, other = (as_robot(data_dir / name if "/" in name else name) for name in (recorded, model))
    log = arm_log(real, 3, trials=2)
    names = dict(zip(real.joint_names, other.joint_names, strict=True))
    header = {"joints": tuple(map(names.get, log.header.joints)), "controller": None}
    chart = examine(other, replace(log, header=log.header.model_copy(update=header)))
    kinds = {one.kind for one in chart.findings}
    assert "other_model" in kinds and not {"clock", "zero_position", "torque_scale"} & kinds
    np.testing.assert_allclose(chart.log.trials[0].tau, log.trials[0].tau)
    assert not [one for one in examine(real, log).findings if one.severity == "spoils"]


def test_an_axis_that_points_the_other_way_may_be_another_robots(data_dir: Path) -> None:
    robot = as_robot(data_dir / "rokae_xmate3pro" / "rokae_xmate3pro.urdf")
    (found,) = (one for one in examine(robot, read_with("iiwa14", robot)).findings if one.kind == "direction")
    assert "as of another robot" in found.text


def test_a_zero_a_quarter_turn_off_is_no_load_beyond_the_arms_reach(arm: Robot, log: Log) -> None:
    """Bodies beyond it, turned as it is, explain most; what alone explains all is named beside them."""
    by = np.array([0.0, 0.0, np.pi / 2, 0.0, 0.0, 0.0])
    (found,) = (
        one
        for one in examine(arm, changed(log, lambda t: replace(t, q=t.q + by, q_cmd=None))).findings
        if one.kind in {"other_model", "zero_position"}
    )
    assert "-90° to elbow_joint" in found.text
