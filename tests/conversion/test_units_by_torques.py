"""Positions that may be radians of a model whose ranges are too narrow, or degrees: the torques tell."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import excite
from excite.conversion.guesses import UnclearError
from tests.conversion.test_habits import columns_of, table
from tests.conversion.written import WHOLE


@pytest.fixture
def moved(data, arm):
    """The motion, smaller by a factor, with the torques that the arm needs for it."""
    model = pin.buildModelFromUrdf(str(arm))

    def of(factor: float) -> dict[str, np.ndarray]:
        q, v = factor * data["q"], factor * data["v"]
        a = np.gradient(v, data["time"], axis=0)
        tau = np.array([pin.rnea(model, model.createData(), *rows) for rows in zip(q, v, a, strict=True)])
        return {"time": data["time"], "q": q, "tau": tau + 0.3 * np.tanh(v / 0.1)}

    return of


def _narrow(arm, joints: int) -> None:
    """The arm's model with a range that its last joints leave."""
    text = arm.read_text()
    head, *rest = text.split('<limit lower="-2.5" upper="2.5"')
    ranges = ["2.5"] * (len(rest) - joints) + ["0.4"] * joints
    arm.write_text(
        head + "".join(f'<limit lower="-{r}" upper="{r}"{part}' for r, part in zip(ranges, rest, strict=True))
    )


@pytest.mark.parametrize("joints", [1, 3])
def test_joints_that_turn_further_than_the_model_says_are_in_radians(joints, moved, arm, tmp_path):
    """A maker allows a whole turn each way, and the model half of one."""
    motion = moved(1.0)
    _narrow(arm, joints)
    file = table(tmp_path / "a.csv", columns_of(motion, q="q{n}", tau="tau{n}"))
    done = excite.convert([file], arm, tmp_path / "log", WHOLE)
    np.testing.assert_allclose(done.log.trials[0].q, motion["q"], atol=1e-6)
    assert any("so likely bodies explain the torques" in because for _, _, because in done.guesses)
    again = excite.convert([file], arm, tmp_path / "again", done.folder / "map.yaml")
    np.testing.assert_allclose(again.log.trials[0].q, motion["q"], atol=1e-6)


def test_small_motions_in_degrees_are_in_degrees(moved, arm, tmp_path):
    motion = moved(0.06)
    degrees = {**motion, "q": np.degrees(motion["q"])}
    file = table(tmp_path / "a.csv", columns_of(degrees, q="q{n}", tau="tau{n}"))
    done = excite.convert([file], arm, tmp_path / "log", WHOLE)
    np.testing.assert_allclose(done.log.trials[0].q, motion["q"], atol=1e-6)


def test_it_is_asked_where_no_torques_tell(moved, arm, tmp_path):
    _narrow(arm, 3)
    file = table(tmp_path / "a.csv", columns_of(moved(1.0), q="q{n}"))
    with pytest.raises(UnclearError, match="whose ranges are not the model's"):
        excite.convert([file], arm, tmp_path / "log", WHOLE)


def test_it_is_asked_where_torques_are_nobodys(data, moved, arm, tmp_path):
    _narrow(arm, 3)
    noise = np.random.default_rng(0).normal(size=data["q"].shape)
    file = table(tmp_path / "a.csv", columns_of({**moved(1.0), "tau": noise}, q="q{n}", tau="tau{n}"))
    with pytest.raises(UnclearError, match="whose ranges are not the model's"):
        excite.convert([file], arm, tmp_path / "log", WHOLE)


@pytest.mark.parametrize("unit", ["rad", "deg"])
@pytest.mark.parametrize("turns", [1.0, 2.5])
def test_of_a_joint_that_turns_over_torques_tell_the_unit(unit, turns, tmp_path):
    """A pendulum that goes round: velocities go with radians as with degrees, and its weight with one of them."""
    robot = tmp_path / "pendulum.urdf"
    robot.write_text(
        '<robot name="p"><link name="b"/><joint name="j" type="revolute"><parent link="b"/><child link="a"/>'
        '<axis xyz="0 1 0"/><limit lower="-3.2" upper="3.2" effort="9" velocity="20"/></joint>'
        '<link name="a"><inertial><origin xyz="0 0 -0.5"/><mass value="0.6"/>'
        '<inertia ixx="0.002" iyy="0.002" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
    )
    time = np.arange(0.0, 20.0, 0.01)
    size = 2.0 * np.pi * turns if unit == "rad" else 0.25
    q = size * np.sin(0.9 * time) + 0.1 * size * np.sin(3.0 * time)
    v = np.gradient(q, time)
    tau = 0.6 * 9.81 * 0.5 * np.sin(q) + 0.152 * np.gradient(v, time) + 0.05 * np.tanh(v / 0.02)
    factor = 1.0 if unit == "rad" else np.degrees(1.0)
    columns = {"time": time, "position": factor * q, "velocity": factor * v, "torque": tau}
    rows = np.column_stack(list(columns.values()))
    file = tmp_path / "a.csv"
    file.write_text("\n".join([",".join(columns), *(",".join(f"{x:.8g}" for x in row) for row in rows)]))
    found = excite.convert([file], robot, tmp_path / "log")
    assert found.columns["q.j"] == ("position", pytest.approx(1.0 / factor))
    assert found.columns["v.j"] == ("velocity", pytest.approx(1.0 / factor))
    assert "degrees" not in {item.kind for item in found.chart.findings}
    np.testing.assert_allclose(
        np.ptp(found.log.trials[0].q), np.ptp(q[: len(found.log.trials[0].q)]), rtol=1e-3
    )
