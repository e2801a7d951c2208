"""What has no name, as a stop, is said to be the gap only where it says more of it than what has one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from excite.diagnosis.arm import read
from excite.diagnosis.attribution import Attribution


def _term(nameless: str, evidence: float) -> Any:
    return SimpleNamespace(effect=SimpleNamespace(nameless=nameless), evidence=evidence, location="elbow")


@pytest.mark.parametrize(("named", "found"), [(61.0, False), (9.0, True), (None, True)])
def test_a_stop_beside_an_effect_that_says_more(
    named: float | None, found: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a real arm with constants in its torques, one of 61 nats, a stop of 17 was said to be the gap."""
    monkeypatch.setattr(read, "structured_joints", lambda *_: ("shoulder", "elbow"))
    none: Any = None
    likely = () if named is None else (_term("", named),)
    record = SimpleNamespace(
        _empty_attribution=Attribution(none, none, none, none),
        _terms_by_key={("end_stop", "elbow"): _term("position", 17.0)},
        _unnamed_likely_terms=likely,
        _score_terms=tuple,
        budget=SimpleNamespace(named=()),
        scorer=SimpleNamespace(spectral=none, baseline=none),
    )
    made, judgement = read.BudgetVerdict._judge_unnamed_gap(record)
    assert (made.stranger is not None) == found
    assert judgement.verdict == "unknown"
    assert judgement.structured == (("elbow", "shoulder") if found else ("shoulder", "elbow"))
