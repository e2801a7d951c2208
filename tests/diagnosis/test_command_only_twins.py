"""Names that mean the same where a log has no torque."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.answer.candidate import Candidate, Estimate
from excite.diagnosis.answer.gap import ChannelGap, Gap
from excite.diagnosis.attribution import Attribution
from excite.diagnosis.servo.diagnose import is_confirmed, mark_twins
from excite.diagnosis.servo.servo import drop_faint_effects, effect_strength


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
        ("viscous_friction", True, {"viscous_friction", "torque_gain"}),
        ("viscous_friction", False, set()),
        ("actuator_lag", False, set()),
        ("stribeck", True, set()),
    ],
)
def test_a_wrong_gain_is_taken_for_inertia_only_where_gains_were_estimated(
    effect: str, estimated: bool, tied: set[str]
) -> None:
    result = mark_twins(named(effect), estimated)
    assert result.verdict == ("ambiguous" if tied else "effect")
    assert {item.effect for item in result.candidates[: result.n_tied]} == tied


def test_a_delay_in_the_place_of_a_lag_has_its_own_size() -> None:
    result = mark_twins(named("actuator_lag"), False, Estimate(0.006, 1e-4, "s"))
    lag, delay = result.ambiguous_with
    assert (lag.effect, lag.parameters) == ("actuator_lag", {})
    assert (delay.effect, delay.parameters) == ("time_delay", {"delay": Estimate(0.006, 1e-4, "s")})


def test_noise_of_encoders_is_no_error_of_a_simulator() -> None:
    assert is_confirmed(gap(1.1, 1.04, 1.0))
    assert not is_confirmed(gap(1.1, 1.09, 0.0))
    assert not is_confirmed(gap(1.1, 1.2, 1.0))


def test_an_effect_below_what_rebuilt_torques_can_tell_is_not_believed():
    """A roll-out that gains ever so much does not make up for a torque of one part in a hundred."""
    rng = np.random.default_rng(0)
    tau = rng.standard_normal((500, 2)) * np.array([1.0, 50.0])
    samples = SimpleNamespace(trials=[SimpleNamespace(measured_torque=tau)], to_rows=np.concatenate)
    extra = np.zeros((2, 500, 1))
    extra[1, :, 0] = np.sign(tau[:, 1])
    hypothesis = SimpleNamespace(
        baseline=SimpleNamespace(samples=samples),
        columns=SimpleNamespace(extra=extra),
        fit=SimpleNamespace(extra=np.array([0.5])),
    )
    faint = SimpleNamespace(hypothesis=hypothesis)
    assert effect_strength(faint) == pytest.approx(0.01, rel=0.1)
    whole = SimpleNamespace(hypothesis=replace_columns(hypothesis, None))
    assert effect_strength(whole) == np.inf
    # A constant is an effect though it does not vary.
    constant = np.zeros((2, 500, 1))
    constant[1] = 1.0
    steady = SimpleNamespace(hypothesis=replace_columns(hypothesis, constant))
    assert effect_strength(steady) == pytest.approx(0.01, rel=0.1)


def replace_columns(hypothesis: SimpleNamespace, extra: np.ndarray | None) -> SimpleNamespace:
    return SimpleNamespace(**(vars(hypothesis) | {"columns": SimpleNamespace(extra=extra)}))


@pytest.mark.parametrize(("sizes", "left"), [((0.5, 0.5, 0.5), 3), ((0.5, 0.01, 0.5), 1), ((0.01, 0.5), 0)])
def test_effects_end_where_rebuilt_torques_do(sizes: tuple[float, ...], left: int) -> None:
    rng = np.random.default_rng(0)
    tau = rng.standard_normal((500, 1))
    samples = SimpleNamespace(trials=[SimpleNamespace(measured_torque=tau)], to_rows=np.concatenate)
    accepted = []
    for k, size in enumerate(sizes):
        fit = SimpleNamespace(extra=np.array([size]))
        columns = SimpleNamespace(extra=np.ones((1, 500, 1)))
        base = SimpleNamespace(samples=samples, fit=f"fit before {k}")
        accepted.append(SimpleNamespace(hypothesis=SimpleNamespace(baseline=base, columns=columns, fit=fit)))
    last, first = SimpleNamespace(fit="fit of all"), accepted[0].hypothesis.baseline
    kept = drop_faint_effects(Attribution(first, last, np.ones(1), np.ones(1), accepted=tuple(accepted)))
    assert len(kept.accepted) == left
    assert kept.final.fit == ("fit of all" if left == len(sizes) else f"fit before {left}")
