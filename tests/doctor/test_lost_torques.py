"""Torques that were zeroed under load, that stop in some trials, and that hold no friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.doctor.examine import doctor, examine
from excite.identification.identify import identify
from excite.robot.loading import load_robot
from tests.doctor.test_model_parts import needed, weight, worst
from tests.identification.practice_log import arm_log, changed

DRIVES = ("rigid_body", "viscous_friction", "coulomb_friction", "armature")


@pytest.mark.parametrize("name", ["ur10", "panda", "iiwa14"])
@pytest.mark.parametrize("once", [True, False])
def test_torques_that_were_zeroed_under_load_get_their_constants_back(name, once):
    robot = load_robot(name)
    whole = arm_log(robot, 3)
    first = whole.trials[0].tau[0]
    chart = examine(robot, changed(whole, lambda t: replace(t, tau=t.tau - (first if once else t.tau[0]))))
    (found,) = (one for one in chart.findings if one.severity != "note")
    assert (found.kind, found.repaired) == ("zeroed_torques", True)
    # Masses are off by up to a tenth, and friction was zeroed, too.
    for mended, true in zip(chart.log.trials, whole.trials, strict=True):
        off = first if once else true.tau[0]
        left = (mended.tau - true.tau)[0]
        assert np.linalg.norm(left) < 0.25 * np.linalg.norm(off)


@pytest.mark.parametrize("name", ["ur10", "iiwa14"])
def test_torques_without_weight_begin_with_nothing_and_were_not_zeroed(name):
    robot = load_robot(name)
    bare = changed(arm_log(robot, 3), lambda t: replace(t, tau=t.tau - weight(robot, t.q)))
    (found,) = worst(robot, changed(bare, lambda t: replace(t, tau=t.tau - t.tau[0])))
    assert found.kind == "compensated"


def test_a_first_row_of_zeros_is_a_loggers(name="ur10"):
    robot = load_robot(name)

    def begun(trial):
        tau = trial.tau.copy()
        tau[0] = 0.0
        return replace(trial, tau=tau)

    assert worst(robot, changed(arm_log(robot, 3), begun)) == []


def stop(trial, rows, columns=slice(None), value=0.0):
    tau = trial.tau.copy()
    tau[rows, columns] = value
    return replace(trial, tau=tau)


@pytest.mark.parametrize("name", ["ur10", "panda"])
@pytest.mark.parametrize(
    ("lost", "left"),
    [
        (lambda t: stop(t, slice(None)), 0),
        (lambda t: stop(t, slice(None), value=t.tau[0]), 0),
        (lambda t: stop(t, slice(None), 1), 0),
        (lambda t: stop(t, slice(400, None)), 400),
        (lambda t: stop(t, slice(200, 500), value=t.tau[200]), 500),
    ],
)
def test_rows_in_which_torques_stop_are_left_out(name, lost, left, tmp_path):
    """In one trial of four: all of them, from the middle on, for a while; or one joint's alone."""
    robot = load_robot(name)
    whole = replace(arm_log(robot, 3, trials=4), robot_text=robot.urdf)
    log = changed(whole, lambda t: lost(t) if t.name == "trial_01" else t)
    chart = doctor(log, robot, repair=tmp_path / "log")
    (found,) = (one for one in chart.findings if one.severity != "note")
    assert (found.kind, found.repaired, found.trials) == ("stopped_torques", True, ("trial_01",))
    rows = {trial.name: len(trial.time) for trial in chart.log.trials}
    assert rows.get("trial_01", 0) in (left, left + 1) and len(rows) == 3 + bool(left)
    assert worst(robot, doctor(tmp_path / "log", robot).log) == []


@pytest.mark.parametrize("name", ["ur10", "iiwa14"])
@pytest.mark.parametrize("heavy", [True, False])
def test_friction_that_no_torque_holds_is_said(name, heavy):
    """Of a log that says that friction is part of its baseline; beside the weight, or without that, too."""
    robot = load_robot(name)
    log = arm_log(robot, 3, torque="link_side")
    bare = changed(log, lambda t: t if heavy else replace(t, tau=t.tau - weight(robot, t.q)))
    found = {
        one.kind: one for one in examine(robot, changed(bare, lambda t: t, torque="motor_side")).findings
    }
    assert "no_friction" not in found
    stated = changed(bare, lambda t: t, torque="motor_side", modelled=DRIVES)
    found = {one.kind: one for one in examine(robot, stated).findings}
    assert found["no_friction"].severity == "note" and len(found["no_friction"].places) > 3
    assert ("compensated" in found) != heavy and not any("payload" in one.text for one in found.values())


@pytest.mark.parametrize("name", ["ur10", "panda"])
def test_rotors_that_first_links_would_explain_are_no_changed_links(name):
    """What a rotor of one of the first joints asks for is also asked for by the inertia of the link that it moves."""
    robot = load_robot(name)
    rotors, rng = 0.5 + 0.5 * np.arange(robot.n_joints) % 2, np.random.default_rng(1)

    def driven(trial):
        v = np.gradient(trial.q, trial.time, axis=0)
        a = np.gradient(v, trial.time, axis=0)
        tau = needed(robot, trial)
        return replace(
            trial, tau=tau + rotors * a + v + 0.005 * tau.std(axis=0) * rng.standard_normal(tau.shape)
        )

    log = changed(arm_log(robot, 3, duration=12.0), driven, modelled=DRIVES)
    result = identify(robot, log)
    assert result.changed_segments == ()
