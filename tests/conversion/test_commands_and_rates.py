"""Commands whose names say no quantity, and rates that nothing in a recording states."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

import excite
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import UnclearError
from tests.conversion.drawn import _motion
from tests.conversion.test_recorded import rig
from tests.conversion.written import WHOLE

pytestmark = pytest.mark.usefixtures("unexamined")

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases"


def servo(asked: np.ndarray, rate: float) -> np.ndarray:
    """Positions of a servo that turns towards what it was asked for two rows before, and no faster than 2 rad/s."""
    at = np.zeros_like(asked)
    for k in range(2, len(asked)):
        at[k] = at[k - 1] + np.clip((asked[k - 2] - at[k - 1]) / 0.05, -2.0, 2.0) / rate
    return at


def chirp(time: np.ndarray) -> np.ndarray:
    return 0.6 * np.sin(2.0 * np.pi * (0.2 * time + 0.15 * time**2))


@pytest.mark.parametrize("word", ["actions", "action", "targets", "goal", "setpoints", "controls"])
@pytest.mark.parametrize("position", ["sensor_data", "position", "x"])
def test_what_a_servo_is_asked_for_is_no_torque(word, position, tmp_path):
    time = np.arange(400) / 50.0
    asked = chirp(time)
    content = {"time": time, word: asked, position: servo(asked, 50.0)}
    file = tmp_path / "run.json"
    file.write_text(json.dumps({name: values.tolist() for name, values in content.items()}))
    found = excite.convert([file], rig(tmp_path, "revolute"), tmp_path / "log", WHOLE)
    assert {target: source for target, (source, _) in found.columns.items()} == {
        "time": "time",
        "q.axis": position,
        "q_cmd.axis": word,
    }
    assert found.log.header.torque == "none"


def test_a_recorded_servos_actions_are_positions(tmp_path):
    folder = CASES / "maui_actions"
    if not folder.is_dir():
        pytest.skip("no recordings here")
    found = excite.convert([folder / "real-action-state.json"], folder / "robot.urdf", tmp_path / "log")
    assert found.columns["q_cmd.servo"][0] == "actions"
    assert found.columns["q.servo"][0] == "sensor_data"
    assert found.log.header.torque == "none"


def test_commands_that_nothing_follows_are_asked_about_and_the_lines_work(data, arm, tmp_path):
    other = 0.3 * np.random.default_rng(3).standard_normal(data["q"].shape)
    np.savez(tmp_path / "run.npz", time=data["time"], position=data["q"], action=other)
    with pytest.raises(UnclearError, match=r"action.*positions or torques is not told") as asked:
        excite.convert([tmp_path / "run.npz"], arm, tmp_path / "log")
    (question,) = asked.value.questions
    for line, channel in zip(question.line.split(" or "), ("q_cmd", "tau_cmd"), strict=True):
        stated = Map.model_validate(yaml.safe_load(line))
        found = excite.convert([tmp_path / "run.npz"], arm, tmp_path / "log", stated)
        assert found.columns[f"{channel}.elbow"][0] == "action[1]"


def written(folder: Path, q: np.ndarray, tau: np.ndarray) -> Path:
    """Positions and torques without a clock."""
    names = [f"{word}_{k + 1}" for word in ("pos", "eff") for k in range(q.shape[1])]
    file = folder / "run.csv"
    np.savetxt(file, np.hstack([q, tau]), delimiter=",", header=",".join(names), comments="")
    return file


@pytest.mark.parametrize(
    ("name", "every", "sign"),
    [
        ("ur10", 1, 1.0),
        pytest.param("panda", 2, -1.0, marks=pytest.mark.battery),
        ("iiwa14", 5, 1.0),
        pytest.param("jaco2", 3, -1.0, marks=pytest.mark.battery),
    ],
)
def test_a_rate_that_nobody_stated_is_fitted_to_the_torques(name, every, sign, tmp_path):
    robot = excite.load_robot(name)
    time, q, _, tau = _motion(robot, np.random.default_rng(every))
    file = written(tmp_path, q[::every], sign * tau[::every])
    with pytest.raises(UnclearError) as asked:
        excite.convert([file], name, tmp_path / "log")
    (question,) = asked.value.questions
    stated = Map.model_validate(yaml.safe_load(question.line))
    assert stated.rate_hz == pytest.approx(1.0 / (every * np.median(np.diff(time))), rel=0.15)
    assert ("turned" in question.line) == (sign < 0.0)
    assert excite.convert([file], name, tmp_path / "log", stated).log.header.torque == "motor_side"


def test_no_rate_is_proposed_where_torques_hold_weight_alone(tmp_path):
    robot = excite.load_robot("panda")
    _, q, _, _ = _motion(robot, np.random.default_rng(0))
    data = robot.model.createData()
    tau = np.array([pin.computeGeneralizedGravity(robot.model, data, row) for row in q])
    with pytest.raises(UnclearError, match="rate_hz: NUMBER"):
        excite.convert([written(tmp_path, q, tau)], "panda", tmp_path / "log")


def test_a_rate_that_was_not_filled_in_is_refused(data, arm, tmp_path):
    file = written(tmp_path, data["q"], data["tau"])
    for rate in ("NUMBER", 0, -5.0, True):
        with pytest.raises(excite.errors.LogError, match="rate_hz is no rate"):
            excite.convert([file], arm, tmp_path / "log", Map.model_validate({"log": {"rate_hz": rate}}))


def test_a_recorded_arms_rate_is_fitted_with_its_torques_turned(tmp_path):
    folder = CASES / "rate_guess_franka"
    if not folder.is_dir():
        pytest.skip("no recordings here")
    files = [folder / "q_identification.csv", folder / "tau_identification.csv"]
    with pytest.raises(UnclearError) as asked:
        excite.convert(files, "panda", tmp_path / "log")
    (question,) = asked.value.questions
    rate = yaml.safe_load(question.line)["log"]["rate_hz"]
    assert 20.0 < rate < 30.0 and "turned" in question.line
