"""Torques in another unit, of another side of the gear, as duty cycles: what the nominal weights say of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

import excite
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import UnclearError
from excite.doctor.examine import examine
from excite.logs.robot import nominal_robot
from tests.conversion import written
from tests.conversion.written import JOINTS

GEARS = (80.0, 50.0, 30.0)


def geared(folder: Path) -> Path:
    """The arm, with the reductions of its drives stated."""
    path = written.arm_urdf(folder / "arm.urdf")
    text = "".join(
        f'<transmission name="t{k}"><joint name="{joint}"/><actuator name="a{k}">'
        f"<mechanicalReduction>{gear}</mechanicalReduction></actuator></transmission>"
        for k, (joint, gear) in enumerate(zip(JOINTS, GEARS, strict=True))
    )
    path.write_text(path.read_text().replace("</robot>", f"{text}</robot>"))
    return path


def swing(robot: Path) -> dict[str, np.ndarray]:
    """A motion of the arm with the torques of its model and some friction, 15 s at 100 Hz."""
    data = written.motion(1500)
    model = pin.buildModelFromUrdf(str(robot))
    calculated = model.createData()
    a = np.gradient(data["v"], data["time"], axis=0)
    rows = zip(data["q"], data["v"], a, strict=True)
    tau = np.array([pin.rnea(model, calculated, *row) for row in rows])
    return data | {"tau": tau + 0.05 * np.tanh(data["v"] / 0.02) + 0.02 * data["v"]}


def table(file: Path, data: dict[str, np.ndarray], name: str, torque: np.ndarray) -> Path:
    names = ["t", *(f"q{k + 1}" for k in range(3)), *(f"{name}{k + 1}" for k in range(3))]
    rows = np.column_stack([data["time"], data["q"], torque])
    np.savetxt(file, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    return file


def suggested(log: Path) -> str:
    rows = yaml.safe_load((log / "log.yaml").read_text())["guessed"]
    words = ("torque_scale", "torque constants")
    return next(row["because"] for row in rows if row["what"].startswith(words))


def scale_of(text: str) -> dict[str, float]:
    found: dict[str, float] = yaml.safe_load(text.split("scale: ")[1].split("}")[0] + "}")
    return found


@pytest.mark.parametrize(("power", "cause"), [(-1, "motors"), (1, "twice")])
def test_torques_of_the_other_side_of_the_gear_are_named(power, cause, tmp_path):
    robot = geared(tmp_path)
    data = swing(robot)
    file = table(tmp_path / "run.csv", data, "tau", data["tau"] * np.array(GEARS) ** power)
    stated = {"units": {"tau": "N·m"}}
    excite.convert([file], robot, tmp_path / "log", Map.model_validate(stated))
    said = suggested(tmp_path / "log")
    assert cause in said and all(
        f"{joint} {gear:.4g}" in said for joint, gear in zip(JOINTS, GEARS, strict=True)
    )
    scale = scale_of(said)
    for joint, gear in zip(JOINTS, GEARS, strict=True):
        assert scale[f"tau.{joint}"] == pytest.approx(gear ** (-power), rel=0.2)
    again = excite.convert([file], robot, tmp_path / "again", Map.model_validate(stated | {"scale": scale}))
    torque = np.concatenate([trial.tau for trial in again.log.trials])
    np.testing.assert_allclose(torque.std(axis=0), data["tau"].std(axis=0), rtol=0.2)


def test_a_servos_duty_cycle_is_weighed(tmp_path):
    """Duty cycles of voltage-driven motors: the torque's share and the back-EMF, in per mille."""
    robot = written.arm_urdf(tmp_path / "arm.urdf")
    data = swing(robot)
    per_unit = np.array([0.05, -0.04, 0.02])
    duty = data["tau"] / per_unit + np.array([10.0, -12.0, 8.0]) * data["v"]
    file = table(tmp_path / "run.csv", data, "pwm", duty)
    with pytest.raises(UnclearError, match="duty cycle") as error:
        excite.convert([file], robot, tmp_path / "log")
    (question,) = error.value.questions
    assert not (tmp_path / "log").exists()
    # What the line proposes settles it.
    stated = yaml.safe_load("\n".join(question.line.split("   #")[0].split(" and ")))
    for joint, value in zip(JOINTS, per_unit, strict=True):
        assert stated["scale"][f"tau.{joint}"] == pytest.approx(value, rel=0.15)
    log = excite.convert([file], robot, tmp_path / "log", Map.model_validate(stated)).log
    assert log.header.torque == "motor_side"
    torque = np.concatenate([trial.tau for trial in log.trials])
    np.testing.assert_allclose(torque.std(axis=0), (duty * per_unit).std(axis=0), rtol=0.15)


def test_currents_get_constants_by_the_weights(tmp_path):
    robot = written.arm_urdf(tmp_path / "arm.urdf")
    data = swing(robot)
    constants = np.array([8.0, 5.0, 2.0])
    file = table(tmp_path / "run.csv", data, "current_mA_", 1000.0 * data["tau"] / constants)
    log = excite.convert([file], robot, tmp_path / "log").log
    assert log.header.torque == "current"
    said = suggested(tmp_path / "log")
    found = dict(item.split(": ") for item in said.split("{")[1].split("}")[0].split(", "))
    for joint, constant in zip(JOINTS, constants, strict=True):
        assert float(found[joint]) == pytest.approx(constant, rel=0.2)


@pytest.mark.parametrize(("word", "whole"), [("percent", 100.0), ("per mille", 1000.0)])
def test_shares_of_the_limits_are_called_so(word: str, whole: float, tmp_path):
    """Each joint is off by a factor of its own, which its limit explains."""
    limits = np.array([160.0, 40.0, 8.0])
    robot = written.arm_urdf(tmp_path / "arm.urdf")
    text = robot.read_text()
    for limit in limits:
        text = text.replace('effort="60"', f'effort="{limit:g}"', 1)
    robot.write_text(text)
    data = swing(robot)
    file = table(tmp_path / "run.csv", data, "effort", data["tau"] / limits * whole)
    excite.convert([file], robot, tmp_path / "log", Map.model_validate({"units": {"tau": "N·m"}}))
    said = suggested(tmp_path / "log")
    assert f"{word} of the model's limits" in said
    for joint, limit in zip(JOINTS, limits, strict=True):
        assert scale_of(said)[f"tau.{joint}"] == pytest.approx(limit / whole, rel=0.01)


@pytest.mark.parametrize(
    ("per_unit", "said"),
    [
        ((1.6, 0.4, 0.08), "percent of the model's limits"),
        ((160.0, 40.0, 8.0), "shares of the model's limits"),
        ((9.0, 7.0, 4.0), "currents, whose torque constants are not known"),
    ],
)
def test_torques_that_are_no_newton_metres_are_asked_about(per_unit, said, tmp_path):
    """Nothing says their unit, and no load makes every joint's factor; what the line proposes settles it."""
    robot = written.arm_urdf(tmp_path / "arm.urdf")
    text = robot.read_text()
    for limit in (160.0, 40.0, 8.0):
        text = text.replace('effort="60"', f'effort="{limit:g}"', 1)
    robot.write_text(text)
    data = swing(robot)
    file = table(tmp_path / "run.csv", data, "effort", data["tau"] / np.array(per_unit))
    with pytest.raises(UnclearError, match=said) as error:
        excite.convert([file], robot, tmp_path / "log")
    (question,) = error.value.questions
    assert not (tmp_path / "log").exists()
    stated = yaml.safe_load(question.line.split("   #")[0])
    for joint, value in zip(JOINTS, per_unit, strict=True):
        assert stated["scale"][f"tau.{joint}"] == pytest.approx(value, rel=0.1)
    excite.convert([file], robot, tmp_path / "log", Map.model_validate(stated))


def test_a_load_and_constants_that_are_off_are_not_asked_about(tmp_path):
    """A real arm had such factors; the nominal masses may be what is wrong."""
    robot = written.arm_urdf(tmp_path / "arm.urdf")
    data = swing(robot)
    file = table(tmp_path / "run.csv", data, "tau", data["tau"] * np.array([1.1, 1.9, 2.8]))
    assert excite.convert([file], robot, tmp_path / "log").log.header.torque == "motor_side"


def carrying(robot: Path, mass: float) -> dict[str, np.ndarray]:
    """The motion with the torques of the arm and of a point mass 0.2 m beyond its last joint."""
    data = swing(robot)
    empty, loaded = (pin.buildModelFromUrdf(str(robot)) for _ in range(2))
    loaded.appendBodyToJoint(
        len(JOINTS),
        pin.Inertia(mass, np.zeros(3), np.zeros((3, 3))),
        pin.SE3(np.eye(3), np.array([0.2, 0.0, 0.03])),
    )
    a = np.gradient(data["v"], data["time"], axis=0)
    for model, sign in ((loaded, 1.0), (empty, -1.0)):
        rows = zip(data["q"], data["v"], a, strict=True)
        calculated = model.createData()
        data["tau"] = data["tau"] + sign * np.array([pin.rnea(model, calculated, *row) for row in rows])
    return data


@pytest.mark.parametrize("mass", [2.0, 10.0, 40.0])
@pytest.mark.parametrize("stated", [{}, {"units": {"tau": "N·m"}}])
def test_a_load_is_no_scale(mass: float, stated: dict[str, dict[str, str]], tmp_path: Path) -> None:
    """No line is offered for it, nor asked for, and no torque is scaled; the arm itself weighs 6 kg."""
    robot = written.arm_urdf(tmp_path / "arm.urdf")
    robot.write_text(robot.read_text().replace('effort="60"', 'effort="900"'))
    data = carrying(robot, mass)
    file = table(tmp_path / "run.csv", data, "tau", data["tau"])
    found = excite.convert([file], robot, tmp_path / "log", Map.model_validate(stated))
    rows = yaml.safe_load((tmp_path / "log" / "log.yaml").read_text())["guessed"]
    assert not any("scale:" in row["because"] for row in rows)
    chart = examine(nominal_robot(found.log), found.log)
    assert not {finding.kind for finding in chart.findings} & {
        "torque_scale",
        "clock",
        "torque_order",
        "zero_position",
    }
    for old, new in zip(found.log.trials, chart.log.trials, strict=True):
        np.testing.assert_array_equal(old.tau, new.tau)


@pytest.mark.parametrize("factor", [0.2, 5.0, 100.0])
def test_what_a_load_explains_no_better_is_a_scale(factor: float, tmp_path: Path) -> None:
    robot = written.arm_urdf(tmp_path / "arm.urdf")
    robot.write_text(robot.read_text().replace('effort="60"', 'effort="9000"'))
    data = swing(robot)
    file = table(tmp_path / "run.csv", data, "tau", factor * data["tau"])
    excite.convert([file], robot, tmp_path / "log", Map.model_validate({"units": {"tau": "N·m"}}))
    said = suggested(tmp_path / "log")
    assert scale_of(said) == {"tau": pytest.approx(1.0 / factor, rel=0.1)}
