"""What stands beside a table's numbers: steps and rates in its header, counters, numbers of servos, clocks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import excite
from excite.conversion.columns.units import position_unit
from excite.conversion.guesses import UnclearError
from tests.conversion.test_habits import check, columns_of, table
from tests.conversion.written import JOINTS, WHOLE

pytestmark = pytest.mark.usefixtures("unexamined")


def _below(file: Path, header: str, columns: dict[str, object], separator: str = ",") -> Path:
    table(file, columns, separator)
    file.write_text(header + file.read_text())
    return file


def _counted(data: dict[str, np.ndarray], name: str) -> dict[str, object]:
    columns = columns_of(data, q="J{n} Pos[deg]", tau="J{n} Trq[Nm]")
    for k in range(3):
        columns[f"J{k + 1} Pos[deg]"] = np.degrees(data["q"][:, k])
    columns.pop("time")
    return {name: np.arange(600.0)} | columns


@pytest.mark.parametrize("counter", ["Tick", "time", "idx"])
@pytest.mark.parametrize(
    "stated",
    ["Sampling: 10 ms\n", "Robot: A\nSample rate [Hz]: 100\n", "# dt = 0.01 s\n", "Abtastzeit;10;ms\n"],
)
def test_a_counter_goes_as_fast_as_the_header_states(data, arm, tmp_path, counter, stated):
    """Rows that are 1 apart were taken for milliseconds, whatever stood above them."""
    if stated.startswith("Abtastzeit"):
        stated = "Abtastzeit [ms];10\n"
    file = _below(tmp_path / "a.csv", stated, _counted(data, counter))
    found = excite.convert([file], arm, tmp_path / "log", WHOLE)
    assert found.log.header.rate_hz == pytest.approx(100.0)
    check(found, data, "q", "tau")


def test_a_duration_in_the_header_is_no_rate(data, arm, tmp_path):
    file = _below(tmp_path / "a.csv", "Duration: 6 s\nLoad: 2 kg\n", _counted(data, "idx"))
    with pytest.raises(UnclearError, match="no column of times"):
        excite.convert([file], arm, tmp_path / "log", WHOLE)


def test_motors_degrees_are_asked_about(data, arm, tmp_path):
    """They were believed to be joints', found far beyond the limits, and taken for degrees once more."""
    columns = columns_of(data, tau="Motor{n}_Torque_Nm")
    for k, gear in enumerate((100.0, -100.0, 80.0)):
        columns[f"Motor{k + 1}_Angle_deg"] = gear * np.degrees(data["q"][:, k])
    with pytest.raises(UnclearError, match=r"turn by .* more than their ranges.*motors"):
        excite.convert([table(tmp_path / "a.csv", columns)], arm, tmp_path / "log", WHOLE)


def test_turns_that_an_encoder_has_counted_before_are_no_motors(data):
    """Far from its range a joint may be by whole turns; what it moves by is what tells."""
    low, high = np.full(3, -2.5), np.full(3, 2.5)
    far = np.degrees(data["q"]) + 360.0 * 20
    assert position_unit(far, low, high, np.zeros(3, dtype=bool), "deg").unit == "deg"


def test_numbers_of_servos_and_of_a_robot(data, arm, tmp_path):
    """DYNAMIXEL's tools begin with the servo's number, KUKA's traces end with the robot's."""
    servos = {"Time(ms)": 1e3 * data["time"]}
    kuka = {"Zeit": data["time"]}
    for k in range(3):
        servos |= {f"ID{k + 1} Present Position [rad]": data["q"][:, k]}
        servos |= {f"ID{k + 1} Present Torque [Nm]": data["tau"][:, k]}
        kuka |= {f"AxisPosAct_A{k + 1}_R1": data["q"][:, k], f"Torque_A{k + 1}_R1": data["tau"][:, k]}
    for name, columns in (("servos", servos), ("kuka", kuka)):
        file = table(tmp_path / f"{name}.csv", columns)
        check(excite.convert([file], arm, tmp_path / f"log_{name}", WHOLE), data, "q", "tau")


def test_parts_of_a_simulators_forces_are_no_rivals(data, arm, tmp_path):
    """MuJoCo's qfrc_bias beside qfrc_actuator, Isaac Lab's computed torque beside the applied one, sines of angles."""
    muj, isaac = (tmp_path / name for name in ("mujoco.npz", "isaac.npz"))
    np.savez(
        muj,
        time=data["time"],
        qpos=data["q"],
        qfrc_actuator=data["tau"],
        qfrc_bias=0.8 * data["tau"],
        qfrc_passive=0.1 * data["tau"],
    )
    np.savez(
        isaac,
        joint_pos=data["q"],
        joint_pos_cos=np.cos(data["q"]),
        joint_pos_sin=np.sin(data["q"]),
        applied_torque=data["tau"],
        computed_torque=1.3 * data["tau"],
        joint_names=np.array(JOINTS),
        step_dt=0.01,
    )
    for file in (muj, isaac):
        found = excite.convert([file], arm, tmp_path / f"log_{file.stem}", WHOLE)
        assert found.log.header.rate_hz == pytest.approx(100.0)
        check(found, data, "q", "tau")


def test_measurements_of_labview(data, arm, tmp_path):
    """Two headers, a line of numbers in the second one, decimal commas, a name for remarks that rows leave away."""
    head = (
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\nTime\t12:33:09,123\n***End_of_Header***\t\n\n"
        "Channels\t6\t\nSamples\t600\t600\t600\t600\t600\t600\nX0\t0,0\t0,0\t0,0\t0,0\t0,0\t0,0\n"
        "Delta_X\t0,01\t0,01\t0,01\t0,01\t0,01\t0,01\n***End_of_Header***\n"
    )
    names = "\t".join(
        ["X_Value", *(f"Angle {k}" for k in (1, 2, 3)), *(f"Torque {k}" for k in (1, 2, 3)), "Comment"]
    )
    rows = np.column_stack([data["time"], data["q"], data["tau"]])
    lines = ["\t".join(f"{x:.9g}".replace(".", ",") for x in row) for row in rows]
    file = tmp_path / "a.lvm"
    file.write_text(head + names + "\n" + "\n".join(lines) + "\n")
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau")


def test_set_points_beside_measured_torques_are_asked_about_by_name(data, arm, tmp_path):
    """A trace of interpolated positions and measured torques was said to have no positions at all."""
    columns = columns_of(data, q_cmd="q_ipo_{n}", tau="torque_act_{n}")
    with pytest.raises(UnclearError, match=r"q_ipo_1 … are what was asked.*columns: \{q: \"q_ipo_\{n\}\"\}"):
        excite.convert([table(tmp_path / "a.csv", columns)], arm, tmp_path / "log", WHOLE)


@pytest.mark.parametrize("copy", ["q2_copy", "q_2_old", "q2copy", "tau3_bak", "tau_1_prev"])
def test_a_copy_of_one_joints_column_stands_beside_those_of_all(data, arm, tmp_path, copy):
    columns = columns_of(data, q="q{n}", tau="tau{n}")
    columns[copy] = data["q" if copy.startswith("q") else "tau"][:, 0] + 0.1
    found = excite.convert([table(tmp_path / "a.csv", columns)], arm, tmp_path / "log", WHOLE)
    check(found, data, "q", "tau")
    assert found.unused == (copy,)
