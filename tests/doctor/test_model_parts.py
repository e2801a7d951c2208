"""Torques off which a driver took the model, in part or whole, and torques before gears that nobody stated."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.doctor.doubt import Doubt
from excite.doctor.examine import doctor, examine
from excite.export.models.simulator_model import write_models
from excite.identification.identify import identify
from excite.logs.files import load_log
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log, changed


def weight(robot, q: np.ndarray) -> np.ndarray:
    """By pinocchio's own loop, ``(n, n_joints)`` [N·m]."""
    data = robot.model.createData()
    return np.array([pin.computeGeneralizedGravity(robot.model, data, row).copy() for row in q])


def needed(robot, trial) -> np.ndarray:
    """Weight and inertial forces of the nominal bodies, likewise."""
    data, step = robot.model.createData(), trial.time[1] - trial.time[0]
    v = np.gradient(trial.q, step, axis=0)
    rows = zip(trial.q, v, np.gradient(v, step, axis=0), strict=True)
    return np.array([pin.rnea(robot.model, data, *row).copy() for row in rows])


def worst(robot, log):
    return [found for found in examine(robot, log).findings if found.severity != "note"]


# The driver's masses are the nominal ones, and the robot's up to 10 % off them; or a fifth heavier.
@pytest.mark.parametrize("share", [1.0, 1.2])
@pytest.mark.parametrize("side", ["motor_side", "link_side"])
@pytest.mark.parametrize("name", ["ur10", "panda", "iiwa14", "so101"])
def test_a_driver_that_takes_the_weight_off_is_named(name, side, share):
    robot = load_robot(name)
    log = arm_log(robot, 3, torque=side, trials=2)
    (found,) = worst(robot, changed(log, lambda t: replace(t, tau=t.tau - share * weight(robot, t.q))))
    assert (found.kind, found.repaired) == ("compensated", True)
    told = [value for key, value in found.figures.items() if key.startswith("weight.")]
    assert told and np.abs(np.array(told) - (1.0 - share)).max() < 0.1
    inertia = [value for key, value in found.figures.items() if key.startswith("inertia.")]
    assert inertia and np.abs(np.array(inertia) - 1.0).max() < 0.2


@pytest.mark.parametrize("name", ["panda", "iiwa14", "jaco2"])
def test_the_sign_of_torques_without_weight_is_told_with_it(name):
    """Without the weight neither the sign nor the missing weight is told alone where inertial forces are small."""
    robot = load_robot(name)
    log = arm_log(robot, 3, torque="link_side", trials=2)
    chart = examine(robot, changed(log, lambda t: replace(t, tau=weight(robot, t.q) - t.tau)))
    found = {one.kind: one for one in chart.findings if one.severity != "note"}
    assert found.keys() <= {"compensated", "torque_sign", "weak_torque"} and found["compensated"].repaired
    assert "torque_sign" in found or "opposite sign" in found["compensated"].text
    own = chart.log.trials[0].tau[:, 1] + weight(robot, log.trials[0].q)[:, 1] * (
        not any(chart.log.header.gravity)
    )
    np.testing.assert_allclose(own, log.trials[0].tau[:, 1], atol=1e-9)


@pytest.mark.parametrize("friction", [0.0, 1.0])
def test_what_a_driver_left_of_friction_and_payload_is_said(friction):
    """A load of 2 kg in the hand that the driver knows nothing of, and friction that it takes off or leaves."""
    robot = load_robot("ur10")
    hand, data = robot.model.getFrameId("tool0"), robot.model.createData()

    def held(q):
        jacobian = pin.computeFrameJacobian(robot.model, data, q, hand, pin.LOCAL_WORLD_ALIGNED)
        return 2.0 * 9.81 * jacobian[2]

    def logged(t):
        v = np.gradient(t.q, t.time, axis=0)
        load = np.array([held(row) for row in t.q])
        return replace(t, tau=t.tau - weight(robot, t.q) + load + friction * 20.0 * np.tanh(v / 0.02))

    (found,) = worst(robot, changed(arm_log(robot, 3, torque="link_side", trials=2), logged))
    assert found.kind == "compensated"
    shares = {
        part: np.array([x for key, x in found.figures.items() if key.startswith(f"{part}.")])
        for part in ("friction", "payload")
    }
    assert len(shares["friction"]) >= 2
    assert shares["payload"].max() > 0.05 and "of a payload is still in them: a body of" in found.text
    assert (shares["friction"][:3].max() > 0.1) == (friction > 0.0)


def test_what_is_left_of_torques_without_weight_is_identified_or_the_weight_is_added(tmp_path):
    robot = load_robot("ur10")
    whole = arm_log(robot, 3)
    whole = replace(whole, robot_text=robot.urdf)
    log = changed(whole, lambda t: replace(t, tau=t.tau - weight(robot, t.q)))
    chart = doctor(log, robot)
    assert chart.log.header.gravity == (0.0, 0.0, 0.0)
    result = identify(robot, log)
    assert all(fit.rmse < 0.3 * fit.reference_rmse for fit in list(result.validation.values())[:3])
    doctor(log, robot, repair=tmp_path / "log")
    mended = load_log(tmp_path / "log")
    assert mended.header.gravity == (0.0, 0.0, -9.81)
    for one, other in zip(mended.trials, whole.trials, strict=True):
        np.testing.assert_allclose(one.tau, other.tau, atol=1e-6)
    assert worst(robot, mended) == []


def test_a_log_without_gravity_is_read_without_a_warning(recwarn):
    """Torques without weight whose log says so, and those of a log that says so wrongly."""
    robot = load_robot("ur10")
    log = arm_log(robot, 3, trials=2)
    still = changed(log, lambda t: replace(t, tau=t.tau - weight(robot, t.q)), gravity=(0.0, 0.0, 0.0))
    assert worst(robot, still) == []
    (found,) = worst(robot, changed(log, lambda t: t, gravity=(0.0, 0.0, 0.0)))
    assert found.kind == "gravity" and "[0.00, 0.00, -9.81]" in found.text
    assert [str(item.message) for item in recwarn if issubclass(item.category, RuntimeWarning)] == []


@pytest.mark.parametrize("name", ["ur10", "panda", "iiwa14"])
def test_torques_without_any_of_the_model_are_no_dead_channels(name):
    robot = load_robot(name)
    log = arm_log(robot, 3, torque="link_side", trials=2)
    (found,) = worst(robot, changed(log, lambda t: replace(t, tau=t.tau - needed(robot, t))))
    assert found.kind == "torque_scale" and "external torques" in found.text
    bodies = [x for key, x in found.figures.items() if key.startswith(("weight.", "inertia."))]
    assert bodies and np.abs(bodies).max() < 0.1


def test_no_model_is_written_of_torques_before_gears_that_nobody_stated(tmp_path):
    """Friction, as large as what bodies need, hides the ratios."""
    robot = load_robot("ur10")
    gears = np.array([160.0, 200.0, 150.0, 90.0, 120.0, 100.0])

    def before(trial):
        v = np.gradient(trial.q, trial.time, axis=0)
        return replace(trial, tau=(trial.tau + 1.5 * trial.tau.std(axis=0) * np.tanh(v / 0.05)) / gears)

    log = changed(arm_log(robot, 3), before)
    chart = examine(robot, log)
    (found,) = (one for one in chart.findings if one.severity != "note")
    assert found.kind == "torque_scale" and "before gears" in found.text
    # Nothing else of the channels is told by bodies that do not show.
    assert Doubt.SIZE in chart.doubts
    np.testing.assert_array_equal(chart.log.trials[0].tau, log.trials[0].tau)
    np.testing.assert_array_equal(chart.log.trials[0].q, log.trials[0].q)
    result = identify(robot, log)
    assert "no weight" in result.summary() and "unknown unit" in result.summary()
    files = write_models(robot, result, tmp_path)
    assert files.urdf is None and "unknown unit" in files.refused[0]
    assert not (tmp_path / "identified.urdf").exists()


def slow_log(robot, torque):
    """Slow motion whose wrists' torques are friction and rotors for the most; ``torque`` of model's and time rates."""
    rng = np.random.default_rng(5)
    friction = np.array([5.0, 6.0, 4.0, 1.2, 1.0, 0.6])

    def made(trial):
        w, t = 0.2 * np.pi, trial.time[:, None]
        a, b = 0.35 * rng.normal(size=(2, 4, 6)) / np.arange(1, 5)[:, None]
        turns = w * np.arange(1, 5)
        sine, cosine = np.sin(t * turns), np.cos(t * turns)
        q = sine @ a + cosine @ b + [0.0, -1.2, 1.0, 0.3, 0.4, 0.0]
        v = cosine @ (turns[:, None] * a) - sine @ (turns[:, None] * b)
        own = friction * (np.tanh(v / 0.01) + v + 0.2 * np.gradient(v, trial.time, axis=0))
        tau = torque(replace(trial, q=q)) + own + 0.1 * friction * rng.normal(size=q.shape)
        return replace(trial, q=q, v=None, tau=tau)

    return changed(arm_log(robot, 3, trials=3), made)


@pytest.mark.parametrize("load", [0.0, 1.5])
@pytest.mark.parametrize("known", [False, True])
def test_weight_that_was_taken_off_slow_torques_is_named_and_no_clock(load, known):
    """Friction is most of what is left, and a payload whose weight the driver knows, or does not, is in the hand."""
    robot = load_robot("ur10")
    loaded = pin.Model(robot.model)
    loaded.appendBodyToJoint(
        6, pin.Inertia(load, np.array([0.0, 0.05, 0.1]), 1e-3 * np.eye(3)), pin.SE3.Identity()
    )
    data, nominal = loaded.createData(), robot.model.createData()

    def torque(trial):
        v = np.gradient(trial.q, trial.time, axis=0)
        rows = list(zip(trial.q, v, np.gradient(v, trial.time, axis=0), strict=True))
        whole = np.array([pin.rnea(loaded, data, *row).copy() for row in rows])
        model, own = (loaded, data) if known else (robot.model, nominal)
        return whole - [pin.computeGeneralizedGravity(model, own, q).copy() for q, *_ in rows]

    log = slow_log(robot, torque)
    (found,) = worst(robot, log)
    assert (found.kind, found.repaired) == ("compensated", True)
    left = load > 0.0 and not known
    assert ("a body of 1.5 kg" in found.text) == left
    # A payload's weight is told beside that of the bodies, which is added.
    mended = examine(robot, log).log
    assert any(mended.header.gravity) == left
    if left:
        assert worst(robot, mended) == []


def test_currents_are_no_torques_where_friction_hides_the_wrists():
    robot = load_robot("ur10")
    constants = np.array([12.0, 12.0, 9.0, 5.0, 5.0, 3.0])
    log = slow_log(robot, lambda trial: needed(robot, trial))
    assert worst(robot, log) == []
    (found,) = worst(robot, changed(log, lambda t: replace(t, tau=t.tau / constants)))
    assert found.kind == "torque_scale" and "currents" in found.text


def held(robot, kg):
    """The weight of a body in the hand, ``(n, n_joints)`` of configurations [N·m]."""
    loaded = pin.Model(robot.model)
    loaded.appendBodyToJoint(
        robot.model.njoints - 1,
        pin.Inertia(kg, np.array([0.0, 0.0, 0.1]), 1e-3 * np.eye(3)),
        pin.SE3.Identity(),
    )
    data = loaded.createData()
    return lambda q: [pin.computeGeneralizedGravity(loaded, data, row).copy() for row in q] - weight(robot, q)


def tilted(robot, degrees):
    """The robot's weight under a gravity that leans towards x, likewise."""
    model, angle = pin.Model(robot.model), np.radians(degrees)
    model.gravity = pin.Motion(9.81 * np.array([np.sin(angle), 0.0, -np.cos(angle), 0.0, 0.0, 0.0]))
    data = model.createData()
    return lambda q: np.array([pin.computeGeneralizedGravity(model, data, row).copy() for row in q])


def at(*joints):
    """The weight in the torques of some joints alone, likewise."""
    return lambda robot: lambda q: weight(robot, q) * np.isin(np.arange(robot.n_joints), joints)


@pytest.mark.parametrize("name", ["ur10", "panda", "iiwa14"])
@pytest.mark.parametrize(
    ("taken", "said"),
    [
        (
            lambda robot: lambda q: 0.5 * weight(robot, q),
            r"subtracted (49|5\d) % of the weight from the torques",
        ),
        (lambda robot: lambda q: -weight(robot, q), r"added 1\d\d % of the weight to the torques"),
        (lambda robot: tilted(robot, 15.0), "subtracted the weight .*, 15° off what the log says"),
        (at(1), "missing in the torque of {1} alone: .* or a spring or counterweight"),
        (at(2), "missing in the torque of {2} alone"),
        (at(1, 2), "missing in the torques of {1}, {2} alone"),
        (lambda robot: held(robot, 3.0), "the weight of a body of about [23].* that is not there"),
    ],
)
def test_what_is_off_in_part_is_named_and_put_back(name, taken, said):
    """Weight off by a share, off some joints, under a wrong gravity, of a payload that nobody carries: no clock."""
    robot = load_robot(name)
    off, whole = taken(robot), arm_log(robot, 3, trials=2)
    chart = examine(robot, changed(whole, lambda t: replace(t, tau=t.tau - off(t.q))))
    (found,) = (one for one in chart.findings if one.severity != "note")
    assert (found.kind, found.repaired) == ("compensated", True)
    assert re.search(said.format(*robot.joint_names), found.text)
    for mended, true in zip(chart.log.trials, whole.trials, strict=True):
        assert (
            np.std(mended.tau - true.tau, axis=0) < 0.15 * np.std(off(true.q)) + 0.01 * true.tau.std()
        ).all()
