"""What is suggested is pasted into a map.yaml, run after run, until a recording converts: nothing is lost unsaid."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import excite
from excite.conversion.guesses import UnclearError
from tests.conversion.drawn import _motion

pytestmark = pytest.mark.usefixtures("unexamined")

LABELS = (
    ("base", "shoulder", "elbow", "w1", "w2", "w3"),
    ("pan", "lift", "elbow", "wrist1", "wrist2", "wrist3"),
    ("s_pan", "s_lift", "elb", "wr1", "wr2", "wr3"),
    ("J1", "J2", "J3", "J4", "J5", "J6"),
    ("a", "b", "c", "d", "e", "f"),
    ("Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3"),
    ("shoulder_a", "shoulder_b", "elbow", "wrist_a", "wrist_b", "wrist_c"),
    ("sh1", "sh2", "el", "wr1", "wr2", "wr3"),
    ("axis1", "axis2", "axis3", "axis4", "axis5", "axis6"),
)
POSITIONS = (
    "ang_{j}_deg|{j}_pos_deg|pos_{j}|q_{j}|{j} angle [deg]|theta_{j}|{j}_deg|actual_{j}_rad|{j}".split("|")
)
VELOCITIES = (
    "ang_{j}_deg_s|{j}_vel_deg_s|vel_{j}|qd_{j}|{j} speed [deg/s]|omega_{j}|{j}_deg_s|{j}_rad_s|".split("|")
)
TORQUES = "trq_{j}_Nm|{j}_torque|tau_{j}|{j} torque [Nm]|{j}_Nm|mot_{j}_Nm|eff_{j}|M_{j}|load_{j}_Nm".split(
    "|"
)
CLOCKS = ("t_ms", "time", "Time [s]", "timestamp", "", "t")


def draw(seed: int, folder: Path) -> tuple[Path, dict[str, str]]:
    """A recording of a UR10 whose columns are called as people call them, and the column of each channel."""
    rng = np.random.default_rng([45, seed])
    robot = excite.load_robot("ur10")
    time, *values = (part[::4] for part in _motion(robot, np.random.default_rng(0)))
    labels = LABELS[rng.integers(len(LABELS))]
    *patterns, clock = (str(rng.choice(names)) for names in (POSITIONS, VELOCITIES, TORQUES, CLOCKS))
    table = {clock: time * (1e3 if "ms" in clock else 1.0)} if clock else {}
    truth = {}
    for k, label in enumerate(labels):
        for channel, pattern, rows in zip(("q", "v", "tau"), patterns, values, strict=True):
            if pattern:
                name = pattern.format(j=label)
                table[name] = np.degrees(rows[:, k]) if "deg" in pattern else rows[:, k]
                truth[f"{channel}.{robot.joint_names[k]}"] = name
    file = folder / "run.csv"
    header = ",".join(table)
    np.savetxt(file, np.column_stack(list(table.values())), delimiter=",", header=header, comments="")
    return file, truth


def first_of(line: str) -> list[str]:
    """The first of the alternatives that a suggested line has, as lines of a map; the rate as it was recorded."""
    line = re.split(
        r",? or (?=columns|units|scale|ignore|log|joints|what)| \((?=all)", line.partition("   #")[0]
    )[0]
    return re.sub(r" \(.*\)$", "", line.replace("NUMBER", "125")).split(" and ")


@pytest.mark.parametrize("seed", range(24))
def test_suggested_lines_lead_to_a_log_and_nothing_is_lost_unsaid(seed, tmp_path):
    file, truth = draw(seed, tmp_path)
    lines = ["schema: excite.map/1"]
    for _ in range(5):
        (tmp_path / "map.yaml").write_text("\n".join(lines) + "\n")
        try:
            found = excite.convert([file], "ur10", tmp_path / "log", tmp_path / "map.yaml")
            break
        except UnclearError as error:
            asked = [line for question in error.questions for line in first_of(question.line)]
            assert not set(asked) <= set(lines), error
            lines += asked
    said = found.summary()
    taken = {target: source for target, (source, _) in found.columns.items()}
    for target, column in truth.items():
        assert taken.get(target, column) == column
        assert column in taken.values() or column in said
    assert len(found.log.header.joints) == 6


def test_positions_beside_their_rates_are_read_without_a_map(tmp_path):
    """Positions in degrees, and velocities that are called the same but for the unit."""
    robot = excite.load_robot("ur10")
    time, q, v, tau = (part[::4] for part in _motion(robot, np.random.default_rng(0)))
    table = {"t_ms": 1e3 * time}
    for k, joint in enumerate(LABELS[0]):
        table |= {f"ang_{joint}_deg": np.degrees(q[:, k]), f"ang_{joint}_deg_s": np.degrees(v[:, k])}
        table[f"trq_{joint}_Nm"] = tau[:, k]
    file = tmp_path / "run.csv"
    np.savetxt(
        file, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments=""
    )
    found = excite.convert([file], "ur10", tmp_path / "log")
    for k, joint in enumerate(robot.joint_names):
        assert found.columns[f"q.{joint}"] == (f"ang_{LABELS[0][k]}_deg", pytest.approx(np.pi / 180.0))
        assert found.columns[f"v.{joint}"] == (f"ang_{LABELS[0][k]}_deg_s", pytest.approx(np.pi / 180.0))
        assert found.columns[f"tau.{joint}"] == (f"trq_{LABELS[0][k]}_Nm", 1.0)
    assert found.unused == ()


@pytest.mark.parametrize(
    ("names", "asked"),
    [
        (("tau_meas", "tau_model", "tau_fric"), "tau_meas"),
        (("torque_joint2_sensor", "torque_joint2_motor", "torque_joint2_est"), "torque_joint2_sensor"),
        (("q2_tau_J", "q2_tau_J_d", "q2_tau_J_compensate"), "q2_tau_J"),
        (("tau_raw_elbow", "tau_filtered_elbow", "tau_est_elbow"), "tau_raw_elbow"),
        (("joint2_motor_torque", "joint2_link_torque", "joint2_output_torque"), "joint2_link_torque"),
        (("elbow_torque_raw", "elbow_torque_filt", "elbow_torque_hat"), "elbow_torque_raw"),
    ],
)
@pytest.mark.parametrize("zeros", ["tau{}", ""])
def test_one_of_several_torques_of_a_joint_is_asked_for(names, asked, zeros, data, arm, tmp_path):
    table = {"time": data["time"]} | {f"q{k + 1}": data["q"][:, k] for k in range(3)}
    if zeros:
        table |= {zeros.format(k + 1): np.zeros(len(data["time"])) for k in range(3)}
    table |= {name: (1.0 - 0.1 * k) * data["tau"][:, 1] for k, name in enumerate(names)}
    file = tmp_path / "run.csv"
    np.savetxt(
        file, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments=""
    )
    with pytest.raises(UnclearError) as error:
        excite.convert([file], arm, tmp_path / "log")
    assert asked in str(error.value)
    lines = [line for question in error.value.questions for line in first_of(question.line)]
    (tmp_path / "map.yaml").write_text("\n".join(["schema: excite.map/1", *lines]))
    found = excite.convert([file], arm, tmp_path / "log", tmp_path / "map.yaml")
    assert found.log.header.torque == "motor_side"
    # The second joint's are that one's, called by its name or by its number.
    told = any(word in asked for word in ("elbow", "2"))
    assert not told or found.columns["tau.elbow"][0] in names


@pytest.mark.parametrize(
    ("columns", "said"),
    [({"tau.knee": "tau1"}, "names no joint of the robot"), ({"tau": "tau1"}, "one column for 3 joints")],
)
def test_columns_stated_of_no_joint_are_asked_about(columns, said, data, arm, tmp_path):
    names = [f"{word}{k + 1}" for word in ("q", "tau") for k in range(3)]
    table = np.column_stack([data["time"], data["q"], data["tau"]])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header=",".join(["time", *names]), comments="")
    stated = excite.conversion.explicit_mapping.Map.model_validate({"columns": columns})
    with pytest.raises(UnclearError, match=said):
        excite.convert([tmp_path / "run.csv"], arm, tmp_path / "log", stated)
