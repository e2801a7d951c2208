"""Names that mean the same where a log has no torque."""

from __future__ import annotations

import pytest

from excite.diagnosis.candidate import Candidate
from excite.diagnosis.command_only.confirmation import confirmed, with_twin
from excite.diagnosis.gap import ChannelGap, Gap
from excite.diagnosis.result import Diagnosis


def gap(before: float, after: float, floor: float) -> Gap:
    return Gap(before, after, floor, 0.0, {"joint1": ChannelGap(before, after, floor, "rad")})


def named(effect: str) -> Diagnosis:
    found = Candidate(effect, "joint1", {}, 100.0, 0.1, 0.9)
    return Diagnosis("arm", "effect", effect, "joint1", (), (found,), (found,), gap(3.0, 1.0, 1.0), (), None)


@pytest.mark.parametrize(
    ("effect", "estimated", "tied"),
    [
        ("armature", True, {"armature", "torque_gain"}),
        ("armature", False, set()),
        ("actuator_lag", False, {"actuator_lag", "time_delay"}),
        ("stribeck", True, set()),
    ],
)
def test_a_wrong_gain_is_taken_for_inertia_only_where_gains_were_estimated(
    effect: str, estimated: bool, tied: set[str]
) -> None:
    result = with_twin(named(effect), estimated)
    assert result.verdict == ("ambiguous" if tied else "effect")
    assert {item.effect for item in result.candidates[: result.n_tied]} == tied


def test_noise_of_encoders_is_no_error_of_a_simulator() -> None:
    assert confirmed(gap(1.1, 1.04, 1.0))
    assert not confirmed(gap(1.1, 1.09, 0.0))
    assert not confirmed(gap(1.1, 1.2, 1.0))
