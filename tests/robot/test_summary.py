"""The list of bundled robots."""

from __future__ import annotations

import json

from excite.robot.catalogue import bundled_robots
from excite.robot.load import robot_summaries


def test_every_bundled_robot_in_a_line() -> None:
    summaries = robot_summaries()
    assert [summary.name for summary in summaries] == bundled_robots()
    by_name = {summary.name: summary for summary in summaries}
    assert (by_name["g1"].base, by_name["g1"].n_joints, by_name["g1"].mass) == ("floating", 29, 33.341)
    assert by_name["g1"].sensors == ("left_foot (foot_ft)", "right_foot (foot_ft)")
    assert by_name["ur10"].sensors == ("joint torque (motor_side)",)
    assert json.loads(json.dumps(by_name["human"].to_json()))["rate_hz"] == 200.0
