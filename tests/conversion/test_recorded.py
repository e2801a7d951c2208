"""Recordings of real machines from their original files, with a map of a few lines where they need one."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import excite
from excite.conversion import convert
from excite.conversion.convert import Conversion
from excite.conversion.guesses import UnclearError
from excite.errors import InputError, LogError
from excite.robot.catalogue import example_robot_data
from tests.conftest import lacking

pytestmark = pytest.mark.usefixtures("readers_here")

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
MAPS = Path(__file__).parent / "maps"
MOST_LINES = 12


def rig(folder: Path, kind: str) -> Path:
    """A machine of one axis: a body of a kilogram that turns or slides."""
    path = folder / "rig.urdf"
    path.write_text(
        '<robot name="rig"><link name="base"/><link name="body"><inertial><origin xyz="0 0 -0.1"/><mass value="1"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="axis" type="{kind}"><parent link="base"/><child link="body"/><axis xyz="1 0 0"/>'
        '<limit lower="-5" upper="5" effort="1e5" velocity="1000"/></joint></robot>'
    )
    return path


def chain(folder: Path, names: tuple[str, ...], slides: str = "") -> Path:
    """A machine of joints in a row, one of which may slide."""
    path = folder / "chain.urdf"
    text = ['<robot name="chain"><link name="link0"/>']
    for k, name in enumerate(names):
        kind = "prismatic" if name == slides else "revolute"
        text.append(
            f'<link name="link{k + 1}"><inertial><origin xyz="0.05 0 0"/><mass value="0.5"/>'
            '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="{kind}"><parent link="link{k}"/><child link="link{k + 1}"/>'
            f'<origin xyz="0.1 0 0"/><axis xyz="{"0 1 0" if k % 2 else "0 0 1"}"/>'
            '<limit lower="-6.28" upper="6.28" effort="50" velocity="20"/></joint>'
        )
    path.write_text("".join([*text, "</robot>"]))
    return path


@dataclass(frozen=True)
class Recorded:
    """A folder of recordings.

    Attributes:
        files: pattern of the recordings.
        robot: its model in the folder, or ``continuous`` or ``prismatic`` for a machine of one axis.
        joints: number of joints.
        channels: besides positions.
        trials: how many come of it.
    """

    files: str
    robot: str
    joints: int
    channels: tuple[str, ...]
    trials: int


RECORDED = {
    "airbot_play_load_pair": Recorded("chirp_*.csv", "airbot_play_v3_0_gripper.urdf", 6, ("tau",), 2),
    "airbot_play_multi_traj": Recorded("vali_opt*.csv", "play.urdf", 6, ("tau", "v", "q_cmd"), 2),
    "bam_xl330_pendulum": Recorded("sin_*.json", "continuous", 1, ("v", "q_cmd"), 6),
    "brfd_friction_backlash": Recorded("1Hz*.csv", "prismatic", 1, ("v", "tau"), 2),
    "am_d02_friction": Recorded(
        "*_collect_joint_1.npz", "AM-D02-AemLURDF0413.urdf", 7, ("v", "tau", "q_cmd"), 2
    ),
    "dvrk_psm_payload": Recorded("traj_one_no_weight.csv", "psm", 7, ("v", "tau"), 2),
    "feetech_sts3250_pendulum": Recorded("2024*.json", "continuous", 1, ("v", "q_cmd"), 3),
    # Its column of accelerations holds zeros: nobody filled it.
    "franka_joint2_friction_nnfm": Recorded("case3_*.csv", "continuous", 1, ("v", "tau"), 3),
    "franka_panda_gaz2019": Recorded("panda_exciting*.csv", "panda", 7, ("v", "tau"), 2),
    "kuka_lwr4_flobaroid": Recorded("*.npz", "kuka_lwr4.urdf", 7, ("v", "a", "tau", "q_cmd"), 2),
    "so101_sage": Recorded("[cm]*s*e*.parquet", "so101", 6, ("v", "q_cmd"), 2),
    "solo12_khorshidi": Recorded("*.dat", "solo_description/robots/solo12.urdf", 12, ("tau",), 2),
    "tiago_arm_figaroh": Recorded("*.csv", "tiago_description/robots/tiago.urdf", 8, ("v", "current"), 2),
    "uart_servo_backlash": Recorded("*_single.csv", "chain", 3, ("q_cmd",), 2),
    "ur10e_dynamic_calibration": Recorded(
        "identification/*14harm*.csv", "ur10e.urdf", 6, ("v", "current", "tau_cmd"), 2
    ),
    "emps_ballscrew_axis": Recorded("*.csv", "prismatic", 1, ("q_cmd", "tau"), 2),
    "hsm150_two_motor": Recorded("idf_pos_0.06_*.csv", "continuous", 1, ("v", "tau", "q_cmd", "tau_cmd"), 2),
    "quadruped_chirp_pace": Recorded("go2_traj_[01].npz", "go2_fixed_base_sysid.xml", 12, ("v", "q_cmd"), 2),
    "staubli_tx40_figaroh": Recorded("*.npz", "tx40_mdh_modified.urdf", 6, ("tau",), 2),
}


# What is no recording of a robot's joints: what it holds, and what is said of it.
OTHERS = {
    "contact_cube_tosses": (
        "tosses.npz",
        "continuous",
        "column of times.*joint positions|joint positions.*column of times",
    ),
    "human_figaroh_forceplate_only": ("force_plate_wrench.csv", "human.urdf", "joint positions|rate_hz"),
    "human_lee_wensing_park2020": ("human_train.npz", "continuous", "rate_hz|joint positions"),
    "human_running_rajagopal": ("run_kinematics_and_grf.npz", "ur10", "39 columns for 6 joints"),
}


def converted(name: str, case: Recorded, folder: Path) -> Conversion:
    if not (DATA / name).is_dir():
        lacking(f"{name} is not here")
    robot = _robot(DATA / name, case.robot, folder)
    if robot.suffix == ".xml":
        robot = excite.write_scaffold(robot, folder / "model", seed=0).urdf
    mapping = MAPS / f"{name}.yaml"
    files = sorted((DATA / name).glob(case.files))
    return excite.convert(files, robot, folder / "log", mapping if mapping.exists() else None)


def _robot(data: Path, name: str, folder: Path) -> Path:
    made = {
        "psm": (tuple(f"joint{k + 1}" for k in range(7)), "joint3"),
        "so101": (("Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll", "Jaw"), ""),
        "chain": (tuple(f"joint{k + 1}" for k in range(4)), ""),
    }
    if name in ("continuous", "prismatic"):
        return rig(folder, name)
    if name in made:
        return chain(folder, *made[name])
    if "_description" in name:
        return example_robot_data() / name
    return data / name if "." in name else Path(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDED)
def test_a_recording_becomes_a_log(name, tmp_path, monkeypatch):
    case = RECORDED[name]
    found = converted(name, case, tmp_path)
    header = found.log.header
    assert len(header.joints) == case.joints
    assert len(found.log.trials) == case.trials
    assert {trial.role for trial in found.log.trials} == {"identification", "validation"}
    present = {
        c
        for c in ("v", "a", "tau", "current", "q_cmd", "tau_cmd")
        if getattr(found.log.trials[0], c) is not None
    }
    assert set(case.channels) <= present
    assert found.chart is not None or header.base != "fixed", found.notes
    # The doctor has looked at the same log already.
    monkeypatch.setattr(convert, "_examine_log", lambda *_: (None, []))
    again = excite.convert(
        sorted((DATA / name).glob(case.files)),
        found.folder / "robot.urdf",
        tmp_path / "again",
        found.folder / "map.yaml",
    )
    for one, other in zip(found.log.trials, again.log.trials, strict=True):
        assert (one.name, one.role) == (other.name, other.role)
        np.testing.assert_array_equal(one.q, other.q)


@pytest.mark.slow
def test_a_motor_without_a_stop_is_no_witness_against_its_model(tmp_path):
    """It goes round and round by a model with limits, and its torques are those of the motor beside it."""
    found = converted("hsm150_two_motor", RECORDED["hsm150_two_motor"], tmp_path)
    assert found.chart is not None
    assert not {"other_model", "beyond_limits"} & {one.kind for one in found.chart.findings}


def smallest_files(folder: Path) -> list[Path]:
    """The smallest file of each kind in a folder, texts about it and models left out."""
    by_kind: dict[str, list[Path]] = {}
    for file in sorted(folder.rglob("*")):
        if file.is_file() and file.stat().st_size and not file.stem.lower().startswith(("readme", "license")):
            by_kind.setdefault(file.suffix.lower(), []).append(file)
    models = (".urdf", ".xacro", ".stl", ".dae", ".obj", ".srdf", ".mtl", ".png", ".py", ".m", ".md")
    return [
        min(files, key=lambda f: f.stat().st_size) for kind, files in by_kind.items() if kind not in models
    ]


def model_in(folder: Path, tmp_path: Path) -> Path:
    """The smallest URDF in a folder, else a machine of one axis."""
    models = sorted(folder.rglob("*.urdf"), key=lambda file: file.stat().st_size)
    return models[0] if models else rig(tmp_path, "continuous")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", sorted(folder.name for folder in DATA.iterdir() if folder.is_dir()) if DATA.is_dir() else []
)
def test_every_folder_is_converted_asked_about_or_said_to_be_no_recording(name, tmp_path, monkeypatch):
    """Whatever folders are there: each file becomes a log, or is refused in a line that says what to do."""
    # What the doctor says of it is asked of whole recordings above.
    monkeypatch.setattr(convert, "_examine_log", lambda *_: (None, []))
    robot = model_in(DATA / name, tmp_path)
    for file in smallest_files(DATA / name):
        out = tmp_path / "log"
        try:
            found = excite.convert([file], robot, out)
        except UnclearError as error:
            assert error.questions and all(question.what and question.line for question in error.questions)
        except InputError as error:
            assert error.remedy and "\n" not in str(error)
        else:
            joints = found.log.header.joints
            assert joints and all(np.isfinite(trial.q).all() for trial in found.log.trials)
            assert {f"q.{joint}" for joint in joints} <= set(found.columns)
            shutil.rmtree(out)
        assert not out.exists()


@pytest.mark.parametrize("name", OTHERS)
def test_what_is_no_recording_of_joints_is_refused_in_a_line(name, data_dir, tmp_path):
    file, robot, said = OTHERS[name]
    with pytest.raises(LogError, match=said) as error:
        excite.convert([data_dir / name / file], _robot(data_dir / name, robot, tmp_path), tmp_path / "log")
    assert "\n" not in str(error.value) and not (tmp_path / "log").exists()


def test_a_real_servos_duty_cycle_is_weighed(data_dir, tmp_path):
    """XL330 with a pendulum of 0.49 kg at 0.1 m; its 885 counts are the whole voltage.

    Against kt/R = 0.069 N·m/V of a least-squares fit made of the same recordings by other means (README.txt there).
    """
    robot = rig(tmp_path, "continuous")
    weight = robot.read_text().replace('mass value="1"', 'mass value="0.49"').replace('"0.01"', '"1e-5"')
    robot.write_text(weight)
    files = sorted((data_dir / "bam_xl330_pendulum").glob("sin_*.json"))
    with pytest.raises(UnclearError, match="duty cycle") as error:
        excite.convert(files, robot, tmp_path / "log")
    (question,) = error.value.questions
    factor = float(question.line.split("tau.axis: ")[2].split("}")[0])
    volts = json.loads(files[0].read_text())["entries"][0]["input_volts"]
    assert factor == pytest.approx(0.069 * volts / 885.0, rel=0.25)


@pytest.mark.parametrize("file", sorted(MAPS.glob("*.yaml")), ids=lambda file: file.stem)
def test_a_map_is_short(file):
    assert len(file.read_text().splitlines()) <= MOST_LINES
