"""The filter: accepted motions are safe, rejections are counted, and processes change nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError
from excite.motion.generators.curves import SplineCurve
from excite.motion.generators.mixture import plan_candidates
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.filter import FilterReport, filter_candidate, filter_candidates


@pytest.fixture(scope="module")
def report(g1: Robot) -> FilterReport:
    return filter_candidates(g1, plan_candidates(g1, 12, np.random.SeedSequence(0)))


def test_most_are_accepted_and_all_of_those_are_safe(g1: Robot, report: FilterReport) -> None:
    assert len(report.motions) >= 9
    assert len(report.motions) + sum(report.rejected.values()) == 12
    for motion in report.motions:
        assert check_motion(g1, motion).safe
        assert motion.duration < 25.0
        assert motion.metadata.robot_hash == g1.hash


def test_stages_and_progress(g1: Robot) -> None:
    told: list[tuple[str, int, int]] = []
    candidates = plan_candidates(g1, 2, np.random.SeedSequence(1))
    report = filter_candidates(g1, candidates, progress=lambda *news: told.append(news))
    assert told == [("filter", 1, 2), ("filter", 2, 2)]
    assert report.generated == 2 and not report.rejected
    assert report.seconds > 0.0


def test_neither_processes_nor_order_change_anything(g1: Robot, report: FilterReport) -> None:
    candidates = plan_candidates(g1, 12, np.random.SeedSequence(0))[3::-1]
    together = filter_candidates(g1, candidates, jobs=2)
    assert [o.candidate for o in together.outcomes] == [c.name for c in candidates]
    assert len(together.motions) > 0
    alone = [o.motion for o in report.outcomes[3::-1] if o.motion is not None]
    for one, other in zip(alone, together.motions, strict=True):
        for name in ("time", "q", "v", "a"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


def test_rejection_says_why(g1: Robot) -> None:
    candidate = next(c for c in plan_candidates(g1, 10, np.random.SeedSequence(3)) if c.generator == "squat")
    pelvis = candidate.pelvis.control.copy()
    pelvis[4:8, 0] = -1.5
    outcome = filter_candidate(g1, replace(candidate, pelvis=SplineCurve(pelvis)))
    assert outcome.motion is None
    assert outcome.rejection is not None
    assert outcome.rejection.candidate == candidate.name
    assert outcome.rejection.reason in {"unreachable", "joint_position", "self_collision"}


def test_jobs_must_make_sense(g1: Robot) -> None:
    with pytest.raises(InputError, match="jobs"):
        filter_candidates(g1, [], jobs=0)


@pytest.mark.parametrize("name", ["panda", "ur10", "iiwa14"])
def test_arms(name: str) -> None:
    robot = load_robot(name)
    report = filter_candidates(robot, plan_candidates(robot, 4, np.random.SeedSequence(0)))
    assert len(report.motions) >= 3
    for motion in report.motions:
        assert np.allclose(motion.q[[0, -1]], robot.rest, atol=1e-9)
        assert np.allclose(motion.v[[0, -1]], 0.0, atol=1e-6)


def test_leg_swings_and_squats_complete_the_rank(g1: Robot) -> None:
    """All 213 base parameters of the base-link regressor, by pinocchio's own regressor."""
    candidates = plan_candidates(
        g1, 6, np.random.SeedSequence(0), mix={"leg_swing": 0.5, "random_joint": 0.5}
    )
    motions = filter_candidates(g1, candidates).motions
    data = g1.model.createData()
    rows = [
        pin.computeJointTorqueRegressor(g1.model, data, m.q[i], m.v[i], m.a[i])[:6]
        for m in motions
        for i in range(0, m.n_samples, 25)
    ]
    singular = np.linalg.svd(np.linalg.qr(np.vstack(rows), mode="r"), compute_uv=False)
    assert (singular > 1e-9 * singular[0]).sum() == 213
    assert singular[212] > 1e-5 * singular[0]
