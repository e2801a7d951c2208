"""Small logs made in memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.logs.files import save_log
from excite.logs.log import Log, LogHeader, Trial

ARM = """<robot name="two">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.01 0 0.15"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="100" velocity="5"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.4"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
</robot>
"""


def arm_trial(name: str, role: str, seed: int, n: int = 400) -> Trial:
    """A smooth motion with made-up torques."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) / 100.0
    phase = rng.uniform(0.0, 6.0, 2)
    return Trial(
        name=name,
        role=role,
        time=time,
        q=np.sin(time[:, None] * [1.1, 1.7] + phase),
        tau=rng.normal(size=(n, 2)),
        q_cmd=np.sin(time[:, None] * [1.1, 1.7] + phase),
    )


@pytest.fixture
def arm_log() -> Log:
    """Two trials of a two-joint arm."""
    header = LogHeader.model_validate(
        {
            "schema": "excite.log/1",
            "robot": "robot.urdf",
            "base": "fixed",
            "rate_hz": 100,
            "joints": ["shoulder", "elbow"],
            "torque": "motor_side",
            "modelled": ["rigid_body", "viscous_friction"],
            "trials": [
                {"file": "one.parquet", "role": "identification"},
                {"file": "two.csv", "role": "validation", "session": "monday", "start_s": 12.5},
                {"file": "three.npz", "role": "identification", "repeats": "one.parquet"},
            ],
        }
    )
    trials = (
        arm_trial("one", "identification", 1),
        replace(arm_trial("two", "validation", 2), session="monday", start_s=12.5),
        replace(arm_trial("three", "identification", 3), repeats="one"),
    )
    return Log(header, trials, robot_text=ARM)


@pytest.fixture
def edited(arm_log: Log, tmp_path: Path) -> Callable[[Callable[[dict], None]], Path]:
    """Save the log with the columns of its CSV trial changed by a function; gives the folder."""

    def edit(change: Callable[[dict], None]) -> Path:
        folder = save_log(arm_log, tmp_path / "log")
        file = folder / "two.csv"
        lines = [line.split(",") for line in file.read_text().splitlines()]
        columns = {name.strip(chr(34)): list(values) for name, *values in zip(*lines, strict=True)}
        change(columns)
        rows = zip(*columns.values(), strict=True)
        file.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n")
        return folder

    return edit
