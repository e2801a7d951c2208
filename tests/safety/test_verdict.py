"""What a verdict says: to scripts, to a person, and when nothing can be said."""

from __future__ import annotations

import pytest

from excite.safety.verdict import MARGIN_FIELDS, CheckReport, Margins, Verdict, Violation

ALL = Margins(*(0.1 * k for k in range(1, len(MARGIN_FIELDS) + 1)))
LATE = Violation("joint_torque", 1.25, "elbow", 151.0, 150.0, "N·m")


@pytest.mark.parametrize(
    ("violation", "text"),
    [
        (LATE, "joint_torque of elbow at 1.2500 s: 151 N·m (limit 150)"),
        (Violation("no_contact", 0.5, "feet", None, None), "no_contact of feet at 0.5000 s"),
        (Violation("too_few_samples", None, "time", 2.0, 3.0), "too_few_samples of time: 2 (limit 3)"),
        (Violation("shape", None, "q", None, None), "shape of q"),
    ],
)
def test_a_violation_is_one_phrase(violation: Violation, text: str) -> None:
    assert str(violation) == text


def test_safe_needs_every_margin_that_applies() -> None:
    assert Verdict("m", ALL, ()).safe
    for name in MARGIN_FIELDS:
        missing = Margins(**{field: None if field == name else 0.1 for field in MARGIN_FIELDS})
        assert Verdict("m", missing, (), not_applicable=(name,)).safe
        unknown = Verdict("m", missing, ())
        assert not unknown.safe
        assert unknown.not_computed == (name,)
        assert unknown.summary() == f"m: unsafe, could not compute {name}"


def test_a_margin_of_zero_was_computed() -> None:
    assert Verdict("m", Margins(*(0.0 for _ in MARGIN_FIELDS)), ()).not_computed == ()


def test_one_violation_is_enough_to_be_unsafe() -> None:
    verdict = Verdict("m", ALL, (LATE,))
    assert not verdict.safe
    assert verdict.summary() == f"m: unsafe, {LATE}"
    assert Verdict("m", ALL, (LATE, LATE, LATE)).summary() == f"m: unsafe, {LATE}, and 2 more"
    assert Verdict("m", ALL, ()).summary() == "m: safe"


def test_scripts_read_everything() -> None:
    entry = Verdict("m", ALL, (LATE,), ("zmp_m",)).to_json()
    assert entry == {
        "motion": "m",
        "safe": False,
        "as_far_as": [],
        "margins": {name: 0.1 * (k + 1) for k, name in enumerate(MARGIN_FIELDS)},
        "nearest": {},
        "not_applicable": ["zmp_m"],
        "violations": [
            {
                "kind": "joint_torque",
                "time_s": 1.25,
                "where": "elbow",
                "value": 151.0,
                "limit": 150.0,
                "unit": "N·m",
            }
        ],
    }


def test_a_document_is_safe_if_all_motions_are_and_there_is_one() -> None:
    good, bad = Verdict("good", ALL, ()), Verdict("bad", ALL, (LATE,))
    assert (
        CheckReport(
            (
                good,
                good,
            )
        ).to_json()["safe"]
        is True
    )
    assert (
        CheckReport(
            (
                good,
                bad,
            )
        ).to_json()["safe"]
        is False
    )
    assert CheckReport(()).to_json()["safe"] is False
    assert [
        entry["motion"]
        for entry in CheckReport(
            (
                good,
                bad,
            )
        ).to_json()["motions"]
    ] == ["good", "bad"]
