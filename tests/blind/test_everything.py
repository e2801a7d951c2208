"""Arms with a little of everything: the true shares are those of the simulated gap, and add up."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import benchmarks.blind.arm_case
import benchmarks.blind.make
from benchmarks.blind.arms_with_everything import (
    FEWEST,
    LARGEST,
    MOST,
    SMALLEST,
    Ingredient,
    Mixture,
    build_mixture,
    draw_mixture,
    true_shares,
)
from benchmarks.blind.documents import Answer
from benchmarks.blind.make import load_answers, make_cases
from excite.errors import InputError


@pytest.fixture
def short_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trials of three seconds: the arithmetic is that of ten."""
    monkeypatch.setattr(benchmarks.blind.arm_case, "TRIAL_S", 3.0)


def test_shares_of_torques_that_add_up_are_their_shapley_values_and_sum_to_one() -> None:
    parts = np.random.default_rng(1).standard_normal((4, 500, 3)) + 0.4

    def power(*kept: int) -> np.ndarray:
        return (parts[list(kept)].sum(axis=0) ** 2).mean(axis=0) + 0.01

    every = range(4)
    found = true_shares(
        power(*every),
        [power(*(k for k in every if k != out)) for out in every],
        [power(only) for only in every],
        power(),
        np.zeros(3),
    )
    whole = parts.sum(axis=0)
    # Of a sum of squares the Shapley value of a term is its product with the sum.
    expected = (parts * whole).mean(axis=1) / (whole**2).mean(axis=0)
    assert found.share == pytest.approx(expected)
    assert found.share.sum(axis=0) == pytest.approx(1.0)
    assert found.together == pytest.approx(0.0, abs=1e-12)
    assert found.gap == pytest.approx((whole**2).mean(axis=0))


def test_a_joint_without_a_gap_has_no_shares() -> None:
    one = np.array([1.0, 1.0])
    found = true_shares(one, [one], [one], np.array([0.5, 1.0]), np.array([0.01, 0.01]))
    assert found.gap.tolist() == [0.5, 0.0]
    assert found.share[0, 1] == found.together[1] == 0.0


def test_a_bias_and_a_gain_take_the_gap_of_their_joints(short_trials: None) -> None:
    made = (Ingredient("torque_bias", "plain", 1, 1.0, 3), Ingredient("torque_gain", "plain", 3, 1.0, 4))
    log, answer = build_mixture(Mixture("jaco2", True, 1.0, (), made), np.random.default_rng(2))
    shares = {item.effect: item.shares for item in answer.effects}
    bias, gain = log.header.joints[1], log.header.joints[3]
    assert shares["torque_bias"][bias] == pytest.approx(1.0, abs=0.02)
    assert shares["torque_gain"][gain] == pytest.approx(1.0, abs=0.02)
    # The gap of a joint with a bias alone is the bias: the log says what it is, and simulations without noise do.
    value = next(item.value for item in answer.effects if item.effect == "torque_bias")
    assert answer.joints[bias].gap == pytest.approx(abs(value), rel=0.1)
    for joint, there in answer.joints.items():
        assert sum(item.get(joint, 0.0) for item in shares.values()) + there.together == pytest.approx(1.0)
        assert there.together == pytest.approx(0.0, abs=1e-9)
    assert answer == Answer.from_json(json.loads(json.dumps(answer.to_json())))


def test_three_to_eight_effects_are_drawn_from_nothing_to_large_and_none_twice_at_a_place() -> None:
    drawn = [draw_mixture(np.random.default_rng(k), ("jaco2",)) for k in range(200)]
    counts = {len(one.ingredients) for one in drawn}
    assert counts == set(range(FEWEST, MOST + 1))
    sizes = [item.size for one in drawn for item in one.ingredients]
    assert min(sizes) < 1.5 * SMALLEST and max(sizes) > LARGEST / 1.5
    assert {item.joint for one in drawn for item in one.ingredients} == set(range(7))
    for one in drawn:
        places = [(item.effect, item.joint) for item in one.ingredients]
        assert len(set(places)) == len(places)
        names = [item.effect for item in one.ingredients]
        assert sum(name in {"time_delay", "actuator_lag"} for name in names) <= 1
        assert one.fixed or not {"payload", "link_inertia", "encoder_offset"} & set(names)


def test_same_seed_same_bytes_and_the_answers_lie_beside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def few(rng: np.random.Generator, robots: tuple[str, ...]) -> Mixture:
        plan = draw_mixture(rng, robots)
        return replace(plan, ingredients=plan.ingredients[:2])

    monkeypatch.setattr(benchmarks.blind.make, "draw_mixture", few)
    monkeypatch.setattr(benchmarks.blind.arm_case, "TRIAL_S", 1.5)
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        make_cases(folder, seed=5, cases=1, robots=("jaco2",), kind="everything")
    for file in sorted(path for path in folders[0].rglob("*") if path.is_file()):
        assert (folders[1] / file.relative_to(folders[0])).read_bytes() == file.read_bytes(), file
    texts = [(tmp_path / f"{folder.name}-answers.json").read_bytes() for folder in folders]
    assert texts[0] == texts[1]
    assert not list(folders[0].rglob("*answers*"))
    answer = load_answers(folders[0])["case_000"]
    assert answer.kind == "everything"
    assert answer.joints
    assert all(set(item.shares) == set(answer.joints) for item in answer.effects)


@pytest.mark.parametrize("asked", [{"torque": "none"}, {"base": "floating"}, {"base": "both"}])
def test_a_little_of_everything_is_for_arms_with_torques(asked: dict, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="arms with torques only"):
        make_cases(tmp_path / "cases", seed=1, cases=1, kind="everything", **asked)
