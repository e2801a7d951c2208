"""A plan without safe candidates says what refuses them, where, how many, and what would help."""

from __future__ import annotations

from dataclasses import replace

import pytest

from excite.campaign.candidates import Refusals
from excite.campaign.plan import Plan, plan
from excite.cli.outcome import of_error
from excite.errors import NothingSafeError
from excite.robot.robot import Robot
from excite.safety.refusals import Refused

PAIR = "forearm_link - wrist_2_link"


@pytest.fixture(scope="module")
def failure(ur10: Robot) -> NothingSafeError:
    """Of a plan for a robot of which two links always touch."""
    with pytest.raises(NothingSafeError) as caught:
        plan(touching(ur10, "wrist_2_link"), n_candidates=2, seed=1)
    return caught.value


def touching(robot: Robot, *links: str) -> Robot:
    """The robot whose pairs with these links, closer than the margin in every posture, are judged too."""
    block = robot.description.collision
    kept = tuple(pair for pair in block.ignored_pairs if not set(pair) & set(links))
    description = robot.description.model_copy(
        update={"collision": block.model_copy(update={"ignored_pairs": kept})}
    )
    return replace(robot, hash=f"{robot.hash} {links}", description=description)


def refusals(robot: Robot, jobs: int = 1, **asked: object) -> Refusals:
    """What refuses all candidates of a plan."""
    with pytest.raises(NothingSafeError) as caught:
        plan(robot, jobs=jobs, **asked)
    assert isinstance(caught.value.best, Refusals)
    return caught.value.best


def test_links_that_always_touch_are_named_with_the_change_that_helps(
    ur10: Robot, failure: NothingSafeError
) -> None:
    found = failure.best
    assert isinstance(found, Refusals)
    (only,) = found.refused
    assert (only.reason, only.where, only.candidates, only.unit) == ("self_collision", PAIR, 2, "m")
    assert only.limit == pytest.approx(0.02, abs=1e-3)
    assert only.worst is not None and 0.0 < only.worst < 0.02
    assert "ignored_pairs" in found.change
    again = refusals(touching(ur10, "wrist_2_link"), jobs=2, n_candidates=2, seed=1)
    assert again.to_json() == found.to_json()


def test_pairs_that_hide_behind_others_are_named_together(ur10: Robot) -> None:
    found = refusals(touching(ur10, "base_link", "wrist_2_link"), n_candidates=4, seed=1)
    assert {item.where for item in found.refused} == {"base_link - upper_arm_link", PAIR}
    assert sum(item.candidates for item in found.refused) == 4, "each is given up at its first pair"


def test_an_acceleration_limit_that_is_too_small_is_named_by_its_joint(ur10: Robot) -> None:
    acceleration = ur10.limits.acceleration.copy()
    acceleration[ur10.joint_names.index("elbow_joint")] = 1e-3
    robot = replace(ur10, limits=replace(ur10.limits, acceleration=acceleration))
    found = refusals(robot, n_candidates=2, seed=1, generator="fourier")
    first = found.refused[0]
    assert (first.reason, first.where, first.candidates) == ("joint_acceleration", "elbow_joint", 2)
    assert first.unit == "rad/s²" and first.limit == pytest.approx(0.92e-3)
    assert first.worst is not None and first.worst > 100.0 * 0.92e-3
    assert first.time_s is not None
    assert found.change.startswith("raise limits.acceleration")


def test_a_robot_that_cannot_balance_is_told_so(g1: Robot) -> None:
    """On soles of a seventh of their size."""
    feet = tuple(
        replace(foot, sole=foot.sole.mean(axis=0) + 0.15 * (foot.sole - foot.sole.mean(axis=0)))
        for foot in g1.feet
    )
    found = refusals(replace(g1, feet=feet, hash="points"), n_candidates=2, seed=1, generator="squat")
    first = found.refused[0]
    assert (first.reason, first.where, first.candidates) == ("zmp", "feet", 2)


def test_a_failure_is_one_line_and_a_table_and_fields(failure: NothingSafeError) -> None:
    told = of_error(failure)
    assert "\n" not in told.line
    assert f"2 are refused by self_collision of {PAIR}" in told.line and "ignored_pairs" in told.line
    assert "2 of 2  self_collision" in told.table
    document = told.to_json()
    assert document["refused"][0]["where"] == PAIR
    assert document["code"] == 3 and isinstance(document["remedy"], str)


@pytest.mark.parametrize(
    ("reason", "advice"),
    [
        ("no_collision_pairs", "collision.shapes"),
        ("unreachable", "posture.joints"),
        ("slipped_in_rehearsal", "controller.kp"),
        ("fell_in_rehearsal", "limits.torque"),
        ("touched_in_rehearsal", "posture.joints"),
        ("zmp", "feet as large"),
        ("mechanism", "see what refuses"),
    ],
)
def test_what_cannot_be_tried_is_advised_by_its_reason(reason: str, advice: str) -> None:
    found = Refusals(2, (Refused(reason, "legs", 2, None, None, "", None, "a"),), few=True)
    assert advice in found.change and advice in found.summary()


def test_a_plan_of_enough_motions_keeps_quiet(small_plan: Plan) -> None:
    document = small_plan.to_json()
    rejected = document["candidates"]["rejected"]
    assert bool(document["refused"]) == bool(rejected)
    assert "refused by" not in small_plan.summary()
    assert all(item["candidates"] >= 1 for item in document["refused"])
