"""da Vinci Research Kit, patient-side arm: the same motion without and with 105 g on it.

Wang, Gondokaryono, Munawar, Fischer: A convex optimization-based dynamic model identification package for the
da Vinci Research Kit. IEEE Robotics and Automation Letters 4(4), 2019. Kinematics: the package's table of frames.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin
from scipy.signal import butter, filtfilt

from excite.formats.registry import format_of
from excite.logs.columns import read_columns
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, LogHeader

JOINTS = ("yaw", "pitch", "insertion")
RATE_HZ = 200.0
MASS = 0.105
Place = Literal["insertion", "parallel"]

# The arm turns about its remote centre: both axes lie level in the zero posture, and the instrument hangs down from
# there. Links weigh nothing: the torques of the run without weight stand for them.
URDF = """<robot name="dvrk_psm">
  <link name="base"/>
  <link name="yaw_link"><inertial><mass value="1e-6"/>
    <inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="pitch_link"><inertial><mass value="1e-6"/>
    <inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="insertion_link"><inertial><mass value="1e-6"/>
    <inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="yaw" type="revolute">
    <parent link="base"/><child link="yaw_link"/><axis xyz="0 -1 0"/>
    <limit lower="-1.6" upper="1.6" effort="20" velocity="4"/>
  </joint>
  <joint name="pitch" type="revolute">
    <parent link="yaw_link"/><child link="pitch_link"/><axis xyz="-1 0 0"/>
    <limit lower="-1" upper="1" effort="20" velocity="4"/>
  </joint>
  <joint name="insertion" type="prismatic">
    <parent link="pitch_link"/><child link="insertion_link"/><axis xyz="0 0 -1"/>
    <limit lower="0" upper="0.25" effort="20" velocity="1"/>
  </joint>
</robot>
"""


def dvrk_log(
    data_dir: Path, folder: Path, place: Place, split: float = 0.5, against: Place | None = None
) -> Log:
    """Torques with the weight less those without it, on the motion with it: the bare arm's run is the simulator.

    Both runs follow one command, row by row; their positions differ by about two milliradians.

    Args:
        data_dir: folder of the recordings.
        folder: where the log goes.
        place: which of the two runs with a weight.
        split: share of the run that trains; the rest judges.
        against: where the weight is in the run that is taken off, if it is there at all.
    """
    bare = _columns(data_dir, _run(against))
    loaded = _columns(data_dir, _run(place))
    n = len(loaded["q1"])
    border = round(split * n)
    columns = {"time": np.arange(n) / RATE_HZ}
    for number, joint in enumerate(JOINTS, start=1):
        columns[f"q.{joint}"] = loaded[f"q{number}"]
        columns[f"tau.{joint}"] = loaded[f"tau{number}"] - bare[f"tau{number}"]
    entries = [
        {"file": "first.parquet", "role": "identification"},
        {"file": "rest.parquet", "role": "validation"},
    ]
    header = LogHeader.model_validate(
        {
            "schema": "excite.log/1",
            "robot": "dvrk_psm.urdf",
            "base": "fixed",
            "rate_hz": RATE_HZ,
            "joints": JOINTS,
            "torque": "motor_side",
            "modelled": ["rigid_body_fixed"],
            "trials": entries,
        }
    )
    parts = (slice(None, border), slice(border, None))
    trials = tuple(
        read_columns(
            {name: values[part] for name, values in columns.items()}, entry, header, folder / entry.file
        )
        for entry, part in zip(header.trials, parts, strict=True)
    )
    return load_log(save_log(Log(header, trials, robot_text=URDF), folder / f"dvrk_{place}_{against}"))


def _run(place: Place | None) -> str:
    return "no_weight" if place is None else f"105g_at_{place}"


def by_hand(data_dir: Path, place: Place, against: Place | None = None) -> tuple[float, float]:
    """First moment of a body that turns with the pitch axis [kg·m] and constant at that axis [N·m], by least squares.

    Of both turning axes' torques below 5 Hz, each weighted by what is left of it; nothing of the toolkit is in it.

    Args:
        data_dir: folder of the recordings.
        place: where the weight is.
        against: where it is in the run that is taken off; None for the run without.
    """
    runs = [_columns(data_dir, _run(where)) for where in (place, against)]
    low = butter(4, 5.0, fs=RATE_HZ)
    tau = [filtfilt(*low, np.column_stack([run[f"tau{k}"] for k in (1, 2)]), axis=0) for run in runs]
    q = filtfilt(*low, np.column_stack([runs[0][f"q{k}"] for k in (1, 2, 3)]), axis=0)
    v = np.gradient(q, 1.0 / RATE_HZ, axis=0)
    a = np.gradient(v, 1.0 / RATE_HZ, axis=0)
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    # Of the body's ten parameters the mass is not felt; the last column is the constant.
    columns = np.zeros((len(q), 2, 10))
    for k, row in enumerate(zip(q, v, a, strict=True)):
        columns[k, :, :9] = pin.computeJointTorqueRegressor(model, data, *row)[:2, 11:20]
    columns[:, 1, 9] = 1.0
    inside = slice(round(0.5 * RATE_HZ), -round(0.5 * RATE_HZ))
    columns, y, weight = columns[inside], (tau[0] - tau[1])[inside], np.ones(2)
    x = np.zeros(10)
    for _ in range(8):
        rows = (columns * weight[:, None]).reshape(-1, 10)
        x = np.linalg.lstsq(rows, (y * weight).ravel(), rcond=1e-8)[0]
        weight = 1.0 / (y - columns @ x).std(axis=0)
    return float(np.linalg.norm(x[:3])), float(x[9])


def typical_difference(data_dir: Path, place: Place) -> float:
    """Median difference between the positions of the two runs, of the joint where it is largest [rad or m]."""
    bare, loaded = _columns(data_dir, "no_weight"), _columns(data_dir, f"105g_at_{place}")
    both = np.column_stack([loaded[f"q{k}"] - bare[f"q{k}"] for k in (1, 2, 3)])
    return float(np.median(np.abs(both), axis=0).max())


def _columns(data_dir: Path, name: str) -> dict[str, np.ndarray]:
    file = data_dir / "dvrk_psm_payload" / f"traj_one_{name}.csv"
    return format_of(file).read(file).columns
