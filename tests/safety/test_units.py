"""Margins and violations of joints that slide are metres and newtons, beside those of joints that turn."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.campaign.assessment import check
from excite.motion.motion import Motion
from excite.report.page import report
from excite.results import write_json
from excite.robot.load import load_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.verdict import unit_of
from tests.safety.motions import RATE_HZ, joint_motion, smooth

LIFT = """<robot name="lifter">
{links}
<joint name="lift" type="prismatic"><parent link="base"/><child link="car"/><axis xyz="0 0 1"/>
<limit lower="0" upper="0.6" velocity="0.5" effort="200"/></joint>
<joint name="elbow" type="revolute"><parent link="car"/><child link="arm"/><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="2" effort="40"/></joint>
</robot>"""
LINK = """<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    path = tmp_path_factory.mktemp("lifter") / "lifter.urdf"
    path.write_text(LIFT.format(links="".join(LINK.format(name=name) for name in ("base", "car", "arm"))))
    return load_robot(path)


def moved(robot: Robot, lift: float, elbow: float) -> Motion:
    """Both joints there and back, from the middle of the lift."""
    time = np.arange(0.0, 8.0, 1.0 / RATE_HZ)
    there = smooth(time / 3.5) - smooth((time - 3.6) / 3.5)
    return joint_motion(robot, time, np.column_stack([0.3 + lift * there, elbow * there]))


def test_each_margin_is_in_what_its_joint_moves_in(robot: Robot) -> None:
    """0.07 m and 0.37 rad are left of the ranges less their margins: neither hides the other."""
    verdict = check_motion(robot, moved(robot, 0.2, 1.6))
    assert verdict.safe, verdict.reason
    said = verdict.margins_in_words()
    assert re.search(r"position 0\.07 m \(lift\) and 0\.37 rad \(elbow\)", said)
    for units in (("m/s", "rad/s"), ("m/s²", "rad/s²"), ("N", "N·m")):
        for joint, unit in zip(("lift", "elbow"), units, strict=True):
            assert f" {unit} ({joint})" in said
    entry = verdict.to_json()
    # The field that scripts read stays the smallest number.
    assert entry["margins"]["joint_position_rad"] == pytest.approx(0.07, abs=1e-6)
    assert [(n["where"], n["unit"]) for n in entry["nearest"]["joint_position_rad"]] == [
        ("lift", "m"),
        ("elbow", "rad"),
    ]


def test_a_robot_whose_joints_all_turn_says_one_unit() -> None:
    robot = load_robot("ur10")
    time = np.arange(0.0, 8.0, 1.0 / RATE_HZ)
    still = joint_motion(robot, time, np.tile(robot.rest, (len(time), 1)))
    said = check_motion(robot, still).margins_in_words()
    assert re.match(
        r"position [\d.]+ rad, velocity [\d.]+ rad/s, acceleration [\d.]+ rad/s², jerk [\d.]+ rad/s³, "
        r"torque [\d.]+ N·m",
        said,
    )


def test_a_violation_has_the_unit_of_its_joint_in_words_and_on_the_page(robot: Robot, tmp_path: Path) -> None:
    result = check(robot, [moved(robot, 0.5, 2.5), replace(moved(robot, 0.1, 0.1), name="small")])
    first = {violation.where: violation for violation in result.verdicts[0].violations}
    assert (first["lift"].unit, first["elbow"].unit) == ("m", "rad")
    assert re.search(r"joint_position of lift at .* s: 0\.57\S* m \(limit 0\.57\)", result.summary())
    write_json(result.to_json(), tmp_path / "check.json")
    page = report(tmp_path).read_text(encoding="utf-8")
    text = re.sub(r"\|+", "|", re.sub(r"<[^>]+>", "|", page[page.index('id="safety"') :]))
    assert "|joint position [m]|−0.230|lift|made|" in text
    assert "|joint position [rad]|−0.530|elbow|made|" in text
    assert re.search(r"\|joint_position\|[\d.]+\|lift\|[\d.]+\|0\.570\|m\|", text)


def test_a_motion_that_starts_moving_says_how_fast_in_the_joints_unit(robot: Robot) -> None:
    verdict = check(robot, [running(robot)]).verdicts[0]
    units = {(v.kind, v.where): v.unit for v in verdict.violations}
    assert units["starts_moving", "lift"] == "m/s" and units["starts_moving", "elbow"] == "rad/s"


@pytest.mark.parametrize(
    ("kind", "where", "unit"),
    [
        ("starts_moving", "base.z", "m/s"),
        ("ends_moving", "base.wz", "rad/s"),
        ("time_gap", "time", "s"),
        ("rate_too_low", "time", "Hz"),
    ],
)
def test_coordinates_of_a_base_and_times_have_units(kind: str, where: str, unit: str) -> None:
    assert unit_of(kind, where, frozenset()) == unit


def running(robot: Robot) -> Motion:
    """Both joints at a tenth of a unit a second from the first row to the last."""
    time = np.arange(0.0, 2.0, 1.0 / RATE_HZ)
    still = joint_motion(robot, time, np.tile(robot.rest, (len(time), 1)))
    return replace(still, q=still.q + 0.1 * time[:, None], v=np.full_like(still.v, 0.1))
