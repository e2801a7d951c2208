"""Curves and masses for the report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.campaign.experiment import simulate
from excite.campaign.findings import force_comparison
from excite.campaign.result import Campaign
from excite.identification.identify import identify
from excite.motion.collection import load_motions
from excite.report.data import load_report_data
from excite.robot.bringing import load_robot


def test_forces_are_shown_at_the_rate_of_the_log(small_campaign: tuple[Campaign, Path]) -> None:
    result, folder = small_campaign
    forces = load_report_data(folder / "report_data.npz").forces
    assert np.median(np.diff(forces.time)) < 0.011 and len(forces.time) > 500
    for channel, measured, nominal, identified in zip(
        forces.channels, forces.measured.T, forces.nominal.T, forces.identified.T, strict=True
    ):
        shown = [np.sqrt(np.mean((measured - model) ** 2)) for model in (nominal, identified)]
        assert shown[1] < shown[0], channel
        assert shown[1] < 3.0 * result.identification.validation[channel].rmse


def test_a_joint_that_stands_in_the_trial_shown_is_left_out() -> None:
    robot = load_robot("ur10")
    moving, still = load_motions("ur10")[:2]
    q, v, a = still.q.copy(), still.v.copy(), still.a.copy()
    q[:, 5], v[:, 5], a[:, 5] = 0.0, 0.0, 0.0
    still = replace(still, q=q, v=v, a=a)
    log = simulate(robot, [moving, still], roles={still.name: "validation"}, seed=1).log
    held = log.trials[1]
    stopped = replace(held, q=np.column_stack([held.q[:, :5], np.zeros(len(held.q))]))
    log = replace(log, trials=(log.trials[0], stopped))
    forces = force_comparison(robot, identify(robot, log, "wls"), log)
    assert forces is not None and forces.channels == robot.joint_names[:5]
    assert forces.measured.shape == (len(forces.time), 5) and len(forces.units) == 5


def test_terms_that_an_identification_added_are_in_its_curves() -> None:
    robot = load_robot("ur10")
    motions = load_motions("ur10")[:4]
    inject = ["load_dependent_friction:shoulder_lift_joint:0.3", "load_dependent_friction:elbow_joint:0.3"]
    roles = {motions[3].name: "validation"}
    log = simulate(robot, motions, inject=inject, roles=roles, nominal=True, seed=2).log
    found = identify(robot, log)
    assert any(name.startswith("load_friction.") for name in found.identified.drive_names)
    forces = force_comparison(robot, found, log)
    assert forces is not None
    for channel, measured, identified in zip(
        forces.channels, forces.measured.T, forces.identified.T, strict=True
    ):
        assert np.sqrt(np.mean((measured - identified) ** 2)) < 3.0 * found.validation[channel].rmse
