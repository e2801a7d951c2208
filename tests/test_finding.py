"""Findings of one kind are one finding at several places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.doctor.examine import examine
from excite.finding import Finding, merge_findings
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log, changed


def test_findings_of_a_kind_that_ask_for_the_same_become_one() -> None:
    first = Finding("clipped", "a ends", {"share": 0.1, "bits": 12.0}, ("a",), remedy="more", sure=0.9)
    second = Finding("clipped", "b ends", {"share": 0.2, "bits": 12.0}, ("b",), remedy="more", sure=0.6)
    other = Finding("jitter", "stamps", {}, ("time",))
    one, rest = merge_findings((first, other, second))
    assert rest == other
    assert one.places == ("a", "b") and one.text == "a ends; b ends" and one.sure == 0.6
    assert one.figures == {"bits": 12.0, "share.a": 0.1, "share.b": 0.2}


def test_what_asks_for_something_else_stays_apart() -> None:
    mended = Finding("constant", "a", {}, ("a",), repaired=True)
    open_ = Finding("constant", "b", {}, ("b",))
    assert merge_findings((mended, open_)) == (mended, open_)


def test_trials_are_joined_unless_one_is_of_all() -> None:
    ones = [Finding("steps", "x", {}, ("a",), trials=trials) for trials in (("t0",), ("t1",))]
    assert merge_findings(tuple(ones))[0].trials == ("t0", "t1")
    assert merge_findings((*ones, replace(ones[0], trials=())))[0].trials == ()


def test_two_turned_positions_are_one_finding_of_a_log() -> None:
    robot = load_robot("ur10")
    signs = np.array([1.0, -1.0, 1.0, -1.0, 1.0, 1.0])
    log = changed(arm_log(robot, 3, duration=10.0), lambda t: replace(t, q=t.q * signs))
    found = [item for item in examine(robot, log).findings if item.kind == "position_sign"]
    assert [set(item.places) for item in found] == [{robot.joint_names[1], robot.joint_names[3]}]
