"""A log beside another robot's model, and torques off which a driver took the friction of some joints."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.doctor.examine import examine
from excite.robot.load import load_robot
from excite.rows.drive_terms import smooth_sign
from tests.identification.practice_log import arm_log, changed

UR = Path(pin.__file__).parents[4] / "share/example-robot-data/robots/ur_description/urdf"


def robot_of(name: str):
    return load_robot(UR / f"{name}_joint_limited_robot.urdf" if name in ("ur3", "ur5") else name)


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize(
    ("recorded", "model"), [("ur5", "ur10"), ("ur3", "ur10"), ("ur10", "ur3"), ("panda", "iiwa14")]
)
def test_the_model_of_another_robot_is_named_and_sizes_are_not_believed_by_it(recorded, model, seed):
    nominal = robot_of(model)
    log = arm_log(robot_of(recorded), seed)
    log = changed(log, lambda trial: trial, joints=nominal.joint_names)
    chart = examine(nominal, log)
    kinds = {found.kind for found in chart.findings}
    assert not kinds & {"torque_scale", "clock"}
    (found,) = (one for one in chart.findings if one.kind == "other_model")
    assert found.figures["left_after"] < 0.1 * found.figures["left_before"]
    # A joint whose axis points elsewhere in the other robot may be turned, position and torque.
    np.testing.assert_array_equal(np.abs(chart.log.trials[0].tau), np.abs(log.trials[0].tau))


@pytest.mark.parametrize("share", [1.0, 1.2])
@pytest.mark.parametrize(
    ("name", "joints"),
    [("ur10", (1, 4)), ("panda", (2,)), ("ur10", (0, 3)), ("panda", (0, 5)), ("ur10", (0, 2, 4))],
)
def test_joints_whose_friction_a_driver_took_off_are_named(name, joints, share):
    robot = robot_of(name)
    log, whole = arm_log(robot, 3), arm_log(robot, 3, torque="link_side")
    assert "no_friction" not in {found.kind for found in examine(robot, log).findings}

    def taken(trial, bare):
        v = np.gradient(trial.q, trial.time, axis=0)
        columns = np.stack([v, smooth_sign(v, 0.01), np.gradient(v, trial.time, axis=0)], axis=2)
        tau = trial.tau.copy()
        for j in joints:
            weights = np.linalg.lstsq(columns[:, j], (trial.tau - bare.tau)[:, j], rcond=None)[0]
            tau[:, j] -= share * columns[:, j, :2] @ weights[:2]
        return replace(trial, tau=tau)

    pairs = dict(zip((trial.name for trial in log.trials), whole.trials, strict=True))
    chart = examine(robot, changed(log, lambda trial: taken(trial, pairs[trial.name])))
    (found,) = (one for one in chart.findings if one.kind == "no_friction")
    assert found.places == tuple(robot.joint_names[j] for j in joints)
    sizes = {key.partition(".")[2]: size for key, size in found.figures.items()}
    left, kept = (
        [size for joint, size in sizes.items() if (joint in found.places) is of] for of in (True, False)
    )
    assert min(kept) > 0.0 and max(left) < 0.1 * max(kept)


@pytest.mark.parametrize(("name", "load"), [("ur10", 0.0), ("ur10", 0.15), ("iiwa14", 0.1), ("panda", 0.2)])
def test_torques_before_gears_are_given_reductions_that_hold(name, load):
    """Masses a tenth off, a load at the last link as a share of the robot's mass, and friction as large as the rest."""
    robot, rng = robot_of(name), np.random.default_rng(5)
    true = robot.nominal_parameters.reshape(-1, 10) * rng.uniform(0.9, 1.1, (robot.n_joints, 1))
    carried = load * true[:, 0].sum()
    true[-1] += carried * np.array([1.0, 0.0, 0.0, 0.1, 0.02, 0.0, 0.02, 0.0, 0.0, 0.01])
    gears = rng.uniform(60.0, 260.0, robot.n_joints)

    def before_gears(trial):
        v = np.gradient(trial.q, trial.time, axis=0)
        rubs = trial.tau.std(axis=0) * (smooth_sign(v, 0.02) + v / np.abs(v).max(axis=0))
        return replace(trial, tau=(trial.tau + rubs) / gears)

    log = changed(arm_log(robot, 4, true=true.ravel()), before_gears)
    (found,) = (one for one in examine(robot, log).findings if one.severity != "note")
    assert found.kind == "torque_scale" and not found.repaired
    said = re.findall(r"(\w+) (\d+) to (\d+)", found.text.partition("reduction by")[2])
    assert len(said) >= 2
    for joint, least, largest in said:
        gear = gears[robot.joint_index(joint)]
        assert float(least) < gear < float(largest) and float(largest) > 50.0
