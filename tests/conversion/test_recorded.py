"""Recordings of real machines from their original files, with a map of a few lines where they need one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import excite
from excite.conversion.convert import Conversion

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
    "emps_ballscrew_axis": Recorded("*.csv", "prismatic", 1, ("q_cmd", "tau"), 2),
    "hsm150_two_motor": Recorded("idf_pos_0.06_*.csv", "continuous", 1, ("v", "tau", "q_cmd", "tau_cmd"), 2),
    "quadruped_chirp_pace": Recorded("go2_traj_[01].npz", "go2_fixed_base_sysid.xml", 12, ("v", "q_cmd"), 2),
    "staubli_tx40_figaroh": Recorded("*.npz", "tx40_mdh_modified.urdf", 6, ("tau",), 2),
}


def converted(name: str, case: Recorded, folder: Path) -> Conversion:
    if not (DATA / name).is_dir():
        pytest.skip(f"{name} is not here")
    robot = rig(folder, case.robot) if case.robot in ("continuous", "prismatic") else DATA / name / case.robot
    if robot.suffix == ".xml":
        robot = excite.write_scaffold(robot, folder / "model", seed=0).urdf
    mapping = MAPS / f"{name}.yaml"
    files = sorted((DATA / name).glob(case.files))
    return excite.convert(files, robot, folder / "log", mapping if mapping.exists() else None)


@pytest.mark.parametrize("name", RECORDED)
def test_a_recording_becomes_a_log(name, tmp_path):
    case = RECORDED[name]
    found = converted(name, case, tmp_path)
    header = found.log.header
    assert len(header.joints) == case.joints
    assert len(found.log.trials) == case.trials
    assert {trial.role for trial in found.log.trials} == {"identification", "validation"}
    present = {
        c for c in ("v", "tau", "current", "q_cmd", "tau_cmd") if getattr(found.log.trials[0], c) is not None
    }
    assert set(case.channels) <= present
    assert found.chart is not None, found.notes
    again = excite.convert(
        sorted((DATA / name).glob(case.files)),
        found.folder / "robot.urdf",
        tmp_path / "again",
        found.folder / "map.yaml",
    )
    for one, other in zip(found.log.trials, again.log.trials, strict=True):
        assert (one.name, one.role) == (other.name, other.role)
        np.testing.assert_array_equal(one.q, other.q)


@pytest.mark.parametrize("file", sorted(MAPS.glob("*.yaml")), ids=lambda file: file.stem)
def test_a_map_is_short(file):
    assert len(file.read_text().splitlines()) <= MOST_LINES
