"""Solo12's records (Khorshidi et al. 2024): joint torques and contact flags, no force sensor.

They stand in the history of github.com/ShahramKhorshidi/system_identification (commit 88426de) and look simulated: the
robot starts in free fall from exactly 0.25 m.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from excite.identification.identify import identify
from excite.identification.judgement import ChannelFit
from excite.logs.header_blocks import FootHeader, TrialHeader
from excite.logs.log import Log, LogHeader, Trial
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.quadruped import quadruped_description

FILES = "solo12_khorshidi"
_LEGS = ("FL", "FR", "HL", "HR")
# Three recordings in one file, as jumps of the base show; the step of each fits its positions to its velocities.
_RECORDINGS = ((100, 2000, 0.005), (2000, 3200, 0.01), (3200, 4400, 0.01))


def _solo12(folder: Path) -> Robot:
    said = {"source": "test"}
    description = quadruped_description()
    description |= {
        "model": {"package": "example-robot-data", "path": "solo_description/robots/solo12.urdf", **said},
        "posture": {"base_height": 0.25, **said},
        "feet": [
            {"name": leg, "link": f"{leg}_FOOT", "sole": [[0, 0, 0]], "friction": 0.6, **said}
            for leg in _LEGS
        ],
        "drives": {},
        "sensors": {
            "rate_hz": 200,
            "noise_position": 0.0,
            "joint_torque": "motor_side",
            "noise_torque": {"default": 0.05, **said},
            **said,
        },
        "collision": {"geometry": "collision", "margin": 0.0, **said},
    }
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(description))
    return load_robot(path)


def fits_left_out(data: Path, folder: Path) -> dict[str, ChannelFit]:
    """Predicted torques by joint on the last third of each recording, which was left out, beside the URDF's.

    Args:
        data: folder of recordings; Solo12's are in :data:`FILES`.
        folder: where the robot's description is written.
    """
    robot = _solo12(folder)
    files = data / FILES
    q, tau, contact = (np.loadtxt(files / f"solo_robot_{name}.dat").T for name in ("q", "tau", "contact"))
    trials, headers = [], []
    for start, stop, step in _RECORDINGS:
        # The last third of each recording is left out.
        middle = start + 2 * (stop - start) // 3
        for role, rows in (("identification", slice(start, middle)), ("validation", slice(middle, stop))):
            name = f"{role}_{start}"
            headers.append(TrialHeader(file=f"{name}.parquet", role=role))
            flags = {leg: contact[rows, i] > 0.5 for i, leg in enumerate(_LEGS)}
            time = step * np.arange(len(q[rows]))
            trials.append(Trial(name, role, time, q[rows, 7:], tau[rows], base=q[rows, :7], contacts=flags))
    header = LogHeader(
        schema="excite.log/1",
        robot="robot.urdf",
        base="floating",
        rate_hz=200.0,
        joints=robot.joint_names,
        torque="motor_side",
        base_link="base_link",
        feet=tuple(FootHeader(name=leg, link=f"{leg}_FOOT", sole=((0.0, 0.0, 0.0),)) for leg in _LEGS),
        modelled=("rigid_body", "viscous_friction", "coulomb_friction", "armature"),
        trials=tuple(headers),
    )
    found = identify(robot, Log(header, tuple(trials), robot_text=robot.urdf), "map")
    fits = dict(found.validation)
    assert set(fits) == set(robot.joint_names)
    return fits
