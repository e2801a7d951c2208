"""Curves and masses for the report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.campaign.experiment import simulate
from excite.campaign.loop import findings_of
from excite.documents.campaign import Campaign
from excite.identification.identify import identify
from excite.logs.files import load_log
from excite.logs.log import Trial
from excite.motion.collection import load_motions
from excite.report.comparisons import load_report_data
from excite.report.page import report
from excite.robot.load import load_robot
from tests.identification.practice_log import arm_log


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
    forces = findings_of(robot, identify(robot, log, "wls"), log).forces
    assert forces is not None and forces.channels == robot.joint_names[:5]
    assert forces.measured.shape == (len(forces.time), 5) and len(forces.units) == 5


def test_curves_are_those_of_what_was_identified() -> None:
    """With terms that the method added to the model, and of the log as the doctor has put it right."""
    robot = load_robot("ur10")
    log = arm_log(robot, 3, trials=3, duration=8.0)

    def spoilt(trial: Trial) -> Trial:
        tau = np.array(trial.tau)
        # Of one direction alone: factors on the torques explain some of it, no body does.
        tau[:, 2] *= np.where(np.gradient(trial.q[:, 2]) > 0.0, 1.5, 1.0)
        tau[:, 3] *= -1.0
        tau[:, 5] = 0.4
        return replace(trial, tau=tau)

    ill = replace(log, trials=tuple(spoilt(trial) for trial in log.trials), robot_text=robot.urdf)
    found = identify(robot, ill)
    assert {"torque_sign", "constant", "extension"} <= {finding.kind for finding in found.findings}
    forces = findings_of(robot, found, ill).forces
    assert forces is not None
    for channel, measured, identified in zip(
        forces.channels, forces.measured.T, forces.identified.T, strict=True
    ):
        rmse = np.sqrt(np.mean((measured - identified) ** 2))
        assert rmse < 2.0 * found.validation[channel].rmse + 1e-6, channel


def test_a_campaigns_page_shows_the_trial_that_judges(
    small_campaign: tuple[Campaign, Path], tmp_path: Path
) -> None:
    _, folder = small_campaign
    forces = load_report_data(folder / "report_data.npz").forces
    assert forces is not None
    # The log that holds the trial, of the several that were identified from.
    log = folder / json.loads((folder / "identification.json").read_text())["log_file"]
    assert forces.trial in {trial.name for trial in load_log(log).role("validation")}
    page = report(folder, tmp_path).read_text(encoding="utf-8")
    assert f"Trial {forces.trial} as it was measured" in page
    assert page.index('id="moving-replay-robot"') < page.index('id="replay-robot"')
