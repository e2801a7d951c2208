"""Joints that move while their torque is not known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.equations.resampling import arm_samples
from excite.errors import LogError
from excite.identification.identify import identify
from excite.identification.problem import build_problem
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.robot.loading import load_robot
from excite.rows.settings import ProblemSettings
from tests.identification.practice_log import arm_log as moving_arm
from tests.logs.conftest import ARM


def declared(log: Log, *joints: str) -> Log:
    return replace(
        log, header=log.header.model_copy(update={"no_torque": joints}), robot_text=log.robot_text or ARM
    )


def test_columns_of_such_joints_may_be_missing_and_what_stands_there_is_left_out(
    arm_log: Log, tmp_path: Path
) -> None:
    folder = save_log(declared(arm_log, "elbow"), tmp_path / "log")
    text = (folder / "two.csv").read_text().splitlines()
    assert "tau.shoulder" in text[0]
    assert "tau.elbow" not in text[0]
    assert "q.elbow" in text[0]
    again = load_log(folder)
    assert np.array_equal(again.trials[0].tau[:, 0], arm_log.trials[0].tau[:, 0])
    assert not again.trials[0].tau[:, 1].any()
    # A column that is there all the same is not read.
    (folder / "two.csv").write_text(
        "\n".join([text[0] + ",tau.elbow", *(line + ",7.0" for line in text[1:])]) + "\n"
    )
    assert not load_log(folder).trials[1].tau[:, 1].any()


@pytest.mark.parametrize(
    ("joints", "said"),
    [(("wrist",), "no joint 'wrist'"), (("shoulder", "elbow"), "torque: none")],
)
def test_bad_declarations_are_refused(
    joints: tuple[str, ...], said: str, arm_log: Log, tmp_path: Path
) -> None:
    with pytest.raises(LogError, match=said):
        save_log(declared(arm_log, *joints), tmp_path / "log")


def test_rows_and_drives_are_those_of_the_other_joints() -> None:
    """The same rows as of the full log, and nothing of the joint without."""
    panda = load_robot("panda")
    log, settings = moving_arm(panda), ProblemSettings(cutoff_hz=5.0)
    quiet = declared(log, "panda_joint4", "panda_joint6")
    full, rest = build_problem(panda, log, settings), build_problem(panda, quiet, settings)
    kept = [name for name in full.channel_names if name not in quiet.header.no_torque]
    assert list(rest.channel_names) == kept
    assert not any(name.endswith(("joint4", "joint6")) for name in rest.parameter_names[rest.n_inertial :])
    columns = [full.parameter_names.index(name) for name in rest.parameter_names]
    for name in kept:
        assert np.array_equal(rest.Y[rest.rows_of(name)], full.Y[full.rows_of(name)][:, columns])
        assert np.array_equal(rest.y[rest.rows_of(name)], full.y[full.rows_of(name)])
    result = identify(panda, quiet, problem_settings=settings)
    assert list(result.validation) == kept
    assert all(fit.rmse < 0.1 * fit.reference_rmse for fit in result.validation.values())


def test_diagnosis_goes_on_without_that_joint() -> None:
    panda = load_robot("panda")
    quiet = declared(moving_arm(panda, trials=2), "panda_joint1")
    assert tuple(arm_samples(panda, quiet, quiet.trials).joints) == quiet.header.torque_joints
