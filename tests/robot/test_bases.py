"""Bases and feet that a description may state."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import RobotError
from tests.quadruped import quadruped, quadruped_description


def test_a_point_foot_stands_upright_at_rest(tmp_path: Path) -> None:
    robot = quadruped(tmp_path)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.rest)
    for foot in robot.feet:
        assert not foot.flat
        assert foot.radius == 0.02
        assert np.allclose((data.oMi[foot.joint] * foot.placement).rotation, np.eye(3), atol=1e-9)
        assert data.oMi[foot.joint].act(foot.sole[0])[2] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("base", "floating", "feet"), [("floating", 1, 4), ("suspended", 1, 0), ("held", 0, 0)]
)
def test_what_carries_it_decides_what_moves(tmp_path: Path, base: str, floating: int, feet: int) -> None:
    robot = quadruped(tmp_path, base)
    assert robot.floating == bool(floating)
    assert robot.n_base_v == 6 * floating
    assert len(robot.feet) == feet
    assert not robot.measures_contacts
    assert robot.n_equations == 12


def _feet(**changes: Any) -> list[dict[str, Any]]:
    first, *others = quadruped_description()["feet"]
    return [first | changes, *others]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"feet": []}, "feet.*suspended or held"),
        ({"feet": _feet(sole=[[0, 0, 0], [0, 0, 0]], radius=0.0)}, "two corners coincide"),
        ({"feet": _feet(sole=[[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]], radius=0.0)}, "on a line"),
        ({"feet": _feet(sole=[[0, 0, 0], [0.1, 0, 0]])}, "radius goes with a point foot"),
        (
            {"sensors": {"rate_hz": 200, "noise_position": 0.0, "source": "toy"}},
            "wrench sensors.*or joint_torque",
        ),
        (
            {
                "sensors": {
                    **quadruped_description()["sensors"],
                    "imu": {"link": "FL_shank", "noise_gyro": 0.0, "noise_acceleration": 0.0},
                }
            },
            "FL_shank.*moves against the base",
        ),
    ],
)
def test_what_no_robot_can_have_is_refused_by_name(
    tmp_path: Path, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(RobotError, match=words):
        quadruped(tmp_path, **changes)


def test_an_edge_lies_along_its_corners(tmp_path: Path) -> None:
    edge = [[0.0, -0.03, -0.2], [0.0, 0.03, -0.2]]
    foot = quadruped(tmp_path, feet=_feet(sole=edge, radius=0.0)).feet[0]
    assert np.allclose(np.abs(foot.placement.rotation[:, 0]), [0.0, 1.0, 0.0])
    assert np.linalg.det(foot.placement.rotation) == pytest.approx(1.0)
