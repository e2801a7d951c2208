"""Trials to judge by that are of another machine, and physics that no model has, which is no other machine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import excite
from excite.doctor.checks.machine import OtherMachine
from excite.finding import Finding
from excite.logs.files import load_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot


def simulated(folder: Path, *inject: str) -> Log:
    """Two motions of an arm to learn from and one to judge by."""
    robot, motions = excite.load_robot("ur10"), excite.load_motions("ur10")[:3]
    roles = {motions[2].name: "validation"}
    made = excite.simulate(robot, motions, inject=list(inject), nominal=True, roles=roles, seed=5)
    made.save(folder)
    return load_log(folder)


def found(log: Log) -> tuple[Finding, ...]:
    return OtherMachine().examine(nominal_robot(log), log).findings


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
