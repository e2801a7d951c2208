"""Refusals counted by what refuses, and where."""

from __future__ import annotations

import pytest

from excite.robot.loading import load_robot
from excite.safety.refusals import RefusalTally, refusals_table
from excite.safety.repairs.draft import Rejection
from excite.safety.verdict import Margins, Verdict, Violation


@pytest.fixture
def tally() -> RefusalTally:
    """Of a UR10, whose joints all turn."""
    return RefusalTally(load_robot("ur10"))


def judged(tally: RefusalTally, name: str, *violations: Violation) -> None:
    """Count a candidate that the check refuses."""
    first = violations[0]
    tally.add(
        Rejection(name, f"check_{first.kind}", first.where), Verdict(name, Margins(), tuple(violations))
    )


def test_a_candidate_counts_once_for_each_thing_that_refuses_it(tally: RefusalTally) -> None:
    torque = Violation("joint_torque", 1.0, "elbow_joint", 50.0, 40.0)
    worse = Violation("joint_torque", 2.0, "elbow_joint", 70.0, 40.0)
    judged(tally, "a", torque, Violation("zmp", 0.5, "feet", -0.02, 0.015))
    judged(tally, "b", worse, torque)
    judged(tally, "c", torque)
    elbow, feet = tally.refused()
    assert (elbow.reason, elbow.where, elbow.candidates) == ("joint_torque", "elbow_joint", 3)
    assert (elbow.worst, elbow.limit, elbow.unit, elbow.time_s) == (70.0, 40.0, "N·m", 2.0)
    assert elbow.candidate == "b"
    assert (feet.reason, feet.candidates, feet.worst, feet.unit) == ("zmp", 1, -0.02, "m")


@pytest.mark.parametrize(
    ("reason", "limit", "mild", "bad"),
    [
        ("self_collision", 0.02, 0.015, -0.01),
        ("zmp", 0.015, 0.01, -0.3),
        ("joint_position", -1.0, -1.1, -1.5),
        ("joint_position", 1.0, 1.1, 1.5),
        ("foot_below_ground", -0.003, -0.004, -0.05),
        ("foot_slip", 0.003, 0.004, 0.05),
        ("joint_velocity", 2.0, 2.1, 9.0),
    ],
)
def test_the_worst_is_the_furthest_beyond_its_limit(
    tally: RefusalTally, reason: str, limit: float, mild: float, bad: float
) -> None:
    for name, value in (("first", mild), ("second", bad), ("third", mild)):
        tally.add(Rejection(name, reason, "there", 1.0, value, limit), None)
    (found,) = tally.refused()
    assert (found.candidates, found.worst, found.candidate) == (3, bad, "second")


def test_repairs_and_check_speak_of_the_same_limit_and_pair(tally: RefusalTally) -> None:
    """The check numbers the shapes of a link, and a transfer is part of the motion."""
    judged(tally, "a", Violation("self_collision", 1.0, "one_link_0 - other_link_2", 0.001, 0.02))
    tally.add(Rejection("b", "self_collision", "transfer, one_link - other_link", None, 0.01, 0.02), None)
    (found,) = tally.refused()
    assert (found.where, found.candidates, found.worst) == ("one_link - other_link", 2, 0.001)


def test_a_value_counts_more_than_none(tally: RefusalTally) -> None:
    tally.add(Rejection("a", "unreachable", "legs"), None)
    tally.add(Rejection("b", "unreachable", "legs", None, 0.3, 0.1), None)
    tally.add(Rejection("c", "unreachable", "legs"), None)
    (found,) = tally.refused()
    assert (found.candidates, found.worst, found.candidate) == (3, 0.3, "b")


def test_memory_does_not_grow_with_candidates(tally: RefusalTally) -> None:
    for number in range(1000):
        tally.add(Rejection(f"c{number}", "joint_torque", f"joint_{number % 3}", 1.0, 5.0, 4.0), None)
    assert [item.candidates for item in tally.refused()] == [334, 333, 333]


def test_the_table_lists_the_commonest_and_counts_the_rest(tally: RefusalTally) -> None:
    for number in range(7):
        for _ in range(number + 1):
            tally.add(Rejection("x", "joint_torque", f"j{number}", 0.5, 5.0, 4.0), None)
    lines = refusals_table(tally.refused(), 28).splitlines()
    assert lines[1].strip() == "7 of 28  joint_torque of j6: 5 N·m (limit 4) at 0.50 s"
    assert len(lines) == 7 and lines[-1].strip() == "and 2 more"
    assert refusals_table((), 28) == ""
