"""Two thousand drawn problems: what a second judge is sure of, the check says too."""

from __future__ import annotations

from collections import Counter

from tests.properties.__main__ import disagreements

N_PROBLEMS = 2000


def test_the_check_says_of_drawn_motions_what_a_second_judge_does() -> None:
    counts = Counter[str]()
    assert list(disagreements(0, range(N_PROBLEMS), counts)) == []
    # Nothing is learnt from problems that nobody can decide, or that all end alike.
    assert counts["decided"] > 0.25 * N_PROBLEMS
    assert 0.2 * N_PROBLEMS < counts["unsafe"] < 0.95 * N_PROBLEMS


def test_a_check_that_overlooks_jerk_is_found_out(monkeypatch) -> None:
    from excite.safety import check as registry

    monkeypatch.delitem(registry.CHECKS, "joint_jerk")
    found = list(disagreements(0, range(60), Counter()))
    assert any("missed ['joint_jerk']" in line for line in found)
