"""What `excite doctor` proposes next."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from excite.cli.main import app
from excite.logs.files import save_log
from tests.diagnosis.two_joints import moved, two_joint_log


@pytest.mark.parametrize("named", ["", "log.yaml"])
def test_the_next_command_names_the_robot_that_the_log_brings(named: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    trials = tuple(moved(name, "identification", 8.0, rng, np.eye(2)) for name in "ab")
    log = save_log(two_joint_log(trials), tmp_path / "log")
    done = CliRunner().invoke(app, ["doctor", str(log / named)])
    assert done.exit_code == 0, done.output
    (then,) = re.findall(r"^then: excite (.*)$", done.output, flags=re.MULTILINE)
    command, robot, *_ = shlex.split(then)
    assert command == "identify" and Path(robot).is_file() and Path(robot).parent == log


@pytest.mark.parametrize(
    ("known", "proposed"), [({}, "diagnose"), ({"shoulder": 2.0, "elbow": 1.0}, "identify")]
)
def test_bare_amperes_are_no_torques_to_identify_from(
    known: dict[str, float], proposed: str, tmp_path: Path
) -> None:
    rng = np.random.default_rng(6)
    trials = tuple(moved(name, "identification", 8.0, rng, np.eye(2)) for name in "ab")
    made = two_joint_log(trials)
    header = made.header.model_copy(
        update={
            "torque": "current",
            "torque_constants": dict(zip(made.header.joints, known.values(), strict=False)),
        }
    )
    amperes = replace(
        made, header=header, trials=tuple(replace(t, current=t.tau, tau=None) for t in made.trials)
    )
    done = CliRunner().invoke(app, ["doctor", str(save_log(amperes, tmp_path / "log"))])
    assert re.findall(r"^then: excite (\w+)", done.output, flags=re.MULTILINE) == [proposed], done.output
