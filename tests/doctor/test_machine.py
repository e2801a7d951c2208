"""Trials to judge by that are of another machine, and physics that no model has, which is no other machine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

import excite
from excite.doctor.examine import examine
from excite.finding import Finding
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from tests.diagnosis.two_joints import RATE_HZ, URDF, two_joint_log


def simulated(folder: Path, *inject: str) -> Log:
    """Two motions of an arm to learn from and one to judge by."""
    robot, motions = excite.load_robot("ur10"), excite.load_motions("ur10")[:3]
    roles = {motions[2].name: "validation"}
    made = excite.simulate(robot, motions, inject=list(inject), nominal=True, roles=roles, seed=5)
    made.save(folder)
    return load_log(folder)


def found(log: Log) -> tuple[Finding, ...]:
    return tuple(one for one in examine(nominal_robot(log), log).findings if one.kind == "other_machine")


def test_a_strong_spring_is_no_other_machine(tmp_path: Path) -> None:
    """It bends what each trial says of the bodies, those to learn from among themselves no less."""
    assert found(simulated(tmp_path, "joint_spring:elbow_joint:15")) == ()


def test_torques_of_two_joints_exchanged_in_the_trials_that_judge_are_told(tmp_path: Path) -> None:
    log = simulated(tmp_path)
    exchanged = []
    for trial in log.trials:
        assert trial.tau is not None
        tau = trial.tau.copy()
        if trial.role == "validation":
            tau[:, [1, 2]] = tau[:, [2, 1]]
        exchanged.append(replace(trial, tau=tau))
    (finding,) = found(replace(log, trials=tuple(exchanged)))
    assert finding.kind == "other_machine"
    assert {"shoulder_lift_joint", "elbow_joint"} <= set(finding.places)


def with_a_stop(folder: Path, seconds: float) -> Log:
    """An arm whose first joint runs into rubber in the postures of the trial that judges alone."""
    model = pin.buildModelFromXML(URDF)

    def trial(name: str, role: str, middle: np.ndarray, length: float) -> Trial:
        t = np.arange(round(length * RATE_HZ)) / RATE_HZ
        turn = np.array([4.0, 5.5])
        angle = t[:, None] * turn + (role == "validation")
        q, v = middle + 0.5 * np.sin(angle), 0.5 * turn * np.cos(angle)
        a = -turn * turn * (q - middle)
        tau = np.array([pin.rnea(model, model.createData(), *rows) for rows in zip(q, v, a, strict=True)])
        tau += 0.3 * np.tanh(v / 0.05) + 30.0 * np.maximum(q - 1.4, 0.0) * [1.0, 0.0]
        return Trial(name, role, t, q, tau + 0.02 * np.random.default_rng(len(t)).normal(size=q.shape))

    log = two_joint_log(
        (
            trial("learnt", "identification", np.zeros(2), seconds),
            trial("judge", "validation", np.array([1.5, -0.8]), 1.2),
        )
    )
    save_log(log, folder)
    return load_log(folder)


def test_one_short_trial_to_learn_from_says_nothing_of_another_machine(tmp_path: Path) -> None:
    """How far its own parts are apart is not to be seen."""
    assert found(with_a_stop(tmp_path, 1.5)) == ()


def test_one_long_trial_to_learn_from_is_set_beside_itself(tmp_path: Path) -> None:
    (finding,) = found(with_a_stop(tmp_path, 6.0))
    assert finding.places == ("first",)
    assert "such as a stop" in finding.text
