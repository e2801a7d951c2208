"""Cases with withheld answers: what is hidden is not in the log's folder, and is found from the log alone."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from benchmarks.blind.arm_case import arm_of
from benchmarks.blind.case import build_case, recordings_of
from benchmarks.blind.case_score import parameter_error
from benchmarks.blind.detectability import DETECTABLE, effect_detectability
from benchmarks.blind.documents import Answer, HiddenEffect
from benchmarks.blind.draw import Draft
from benchmarks.blind.forms import hide_effect
from benchmarks.blind.make import answers_file, load_answers, make_cases
from benchmarks.blind.score import score_case, score_diagnoses
from excite.diagnosis.diagnose import diagnose
from excite.errors import InputError
from excite.logs.files import load_log, save_log
from excite.robot.loading import load_robot
from tests.diagnosis.few_trials import few_trials


@pytest.mark.parametrize(
    ("plan", "seed"),
    [
        pytest.param(
            Draft("iiwa14", "single", (("torque_gain", "plain"),), False, 1.0, (), False),
            5,
            marks=pytest.mark.slow,
        ),
        (Draft("panda", "none", (), False, 2.0, ("repeated_rows",), False), 6),
    ],
)
def test_a_hidden_effect_is_found_and_none_is_kept(plan: Draft, seed: int, tmp_path) -> None:
    log, answer = build_case(plan, np.random.default_rng(seed))
    save_log(log, tmp_path / "case")
    found = diagnose(few_trials(load_log(tmp_path / "case")))
    result = score_case("case", answer, found.to_json())
    assert result.named, f"{result.truth} | {result.said}"
    assert result.placed
    assert result.extras == 0


def test_answers_are_not_in_the_folder_of_the_cases(tmp_path) -> None:
    target = make_cases(tmp_path / "cases", seed=4, cases=1, robots=("jaco2",))
    assert target == answers_file(tmp_path / "cases")
    assert target.parent != tmp_path / "cases"
    answer = load_answers(tmp_path / "cases")["case_000"]
    header = yaml.safe_load((tmp_path / "cases" / "case_000" / "log.yaml").read_text())
    text = json.dumps(header)
    assert answer.effects[0].effect not in text
    assert set(header["modelled"]) == set(answer.modelled)
    with pytest.raises(InputError, match="not empty"):
        make_cases(tmp_path / "cases", seed=4, cases=1)


def _document(verdict: str, *effects: tuple[str, str], tied: int = 0) -> dict:
    made = [{"effect": e, "location": p, "tied_locations": [p]} for e, p in effects]
    return {
        "verdict": verdict,
        "effect": effects[0][0] if effects else None,
        "location": effects[0][1] if effects else None,
        "tied_locations": [],
        "candidates": made,
        "effects": made[: max(1, len(made) - tied + 1)] if verdict == "ambiguous" else made,
        "gap": {"share_closed": 0.9, "share_closed_90": None},
        "n_tied": tied,
    }


def _answer(*effects: tuple[str, str]) -> Answer:
    hidden = tuple(HiddenEffect(e, p, 1.0) for e, p in effects)
    return Answer("double" if len(effects) > 1 else "single", "panda", ("rigid_body",), hidden, 1.0)


def test_a_firm_wrong_name_is_worse_than_a_doubt() -> None:
    answer = _answer(("backlash", "joint2"))
    firm = score_case("a", answer, _document("effect", ("stribeck", "joint2")))
    doubt = score_case(
        "a", answer, _document("ambiguous", ("stribeck", "joint2"), ("backlash", "joint2"), tied=2)
    )
    silent = score_case("a", answer, _document("unknown"))
    assert (firm.named, firm.placed, firm.firm_wrong, firm.extras) == (False, True, True, 1)
    assert (doubt.named, doubt.placed, doubt.firm_wrong) == (True, True, False)
    assert (silent.named, silent.firm_wrong) == (False, False)


def test_two_effects_are_counted_each() -> None:
    answer = _answer(("backlash", "joint2"), ("torque_bias", "joint4"))
    both = score_case(
        "a", answer, _document("effect", ("coulomb_asymmetry", "joint4"), ("backlash", "joint2"))
    )
    assert (both.found, both.hidden, both.extras) == (2, 2, 0)
    figures = score_diagnoses({"a": answer}, {"a": _document("effect", ("backlash", "joint2"))}, {}).figures()
    assert figures["double_found"] == 0.5


def test_an_effect_below_the_noise_is_called_hardly_detectable() -> None:
    lost, clear = (
        Answer(
            "single",
            "panda",
            ("rigid_body",),
            (HiddenEffect("torque_bias", "joint2", 1.0, detectability=d),),
            1.0,
        )
        for d in (0.01, 3.0)
    )
    documents = {"a": _document("none"), "b": _document("effect", ("torque_bias", "joint2"))}
    result = score_diagnoses({"a": lost, "b": clear}, documents, {})
    assert result.figures()["single_named"] == 0.5
    assert result.detectable.figures()["single_named"] == 1.0
    assert result.to_json()["figures_detectable"]["cases"] == 1


def test_detectability_grows_with_the_effect_and_falls_with_noise() -> None:
    def clear(size: float, noise: float) -> float:
        changed, _ = hide_effect(arm.virtual, arm, "torque_gain", "plain", 1, size, np.random.default_rng(4))
        sigma = noise * (0.01 * plain[0].tau_motor.std(axis=0) + 1e-3)
        return effect_detectability(arm.virtual.robot, recordings_of(changed, arm), plain, modelled, sigma)

    arm = arm_of(load_robot("iiwa14"), True, np.random.default_rng(3))
    arm = replace(arm, motions=arm.motions[:1])
    plain = recordings_of(arm.virtual, arm)
    modelled = ("rigid_body_fixed", "viscous_friction", "coulomb_friction", "armature")
    strong, weak, loud, none = clear(1.0, 1.0), clear(0.3, 1.0), clear(1.0, 10.0), clear(0.0, 1.0)
    assert strong > 2.0 * weak > 2.0 * DETECTABLE
    assert loud < 0.3 * strong
    assert none < 1e-6


@pytest.mark.battery
def test_a_wave_that_never_repeats_in_the_record_is_no_ripple(tmp_path) -> None:
    plan = Draft("jaco2", "unknown", (("unknown", "stop"),), False, 1.0, (), False)
    log, answer = build_case(plan, np.random.default_rng(11))
    document = diagnose(few_trials(log), load_robot("jaco2")).to_json()
    result = score_case("case", answer, document)
    assert result.named, f"{result.truth} | {result.said}"
    assert result.placed
    assert document["n_tied"] == 0
    assert not document["effects"]
    assert document["gap"]["share_closed"] == 0.0


def test_a_stated_size_is_compared_with_the_hidden_one() -> None:
    hidden = {
        "gain": HiddenEffect("torque_gain", "joint2", 1.1),
        "drift": HiddenEffect("friction_drift", "joint2", -0.4, details={"time_constant": 94.0}),
        "lag": HiddenEffect("actuator_lag", "torque", 0.01, "second_order"),
        "wave": HiddenEffect("torque_ripple", "joint2", 5.0),
        "stop": HiddenEffect("joint_spring", "joint2", 3.0, "hardening"),
    }

    def error(what: str, **values: float) -> float | None:
        said = {name: {"value": value, "std": None, "unit": "1"} for name, value in values.items()}
        return parameter_error(hidden[what], {"effect": hidden[what].effect, "parameters": said})

    assert error("gain", gain=1.133, gain_error=0.133) == pytest.approx(0.03)
    # A session of eight trials ends 94 s after its start: after one time constant.
    assert error("drift", relative_change=-0.4 * (1.0 - np.exp(-1.0))) == pytest.approx(0.0, abs=1e-9)
    assert error("lag", time_constant=0.022) == pytest.approx(0.1)
    assert error("wave", cosine=3.0, sine=-4.0) == pytest.approx(0.0)
    assert error("stop", stiffness=3.0) is None
    assert error("gain", bias=1.0) is None


def test_median_errors_are_of_effects_found_at_their_place() -> None:
    answer = _answer(("torque_bias", "joint2"), ("backlash", "joint4"))
    document = _document("effect", ("torque_bias", "joint2"), ("backlash", "joint5"))
    for item, name in zip(document["effects"], ("bias", "width"), strict=True):
        item["parameters"] = {name: {"value": 1.2, "std": None, "unit": "1"}}
    result = score_diagnoses({"a": answer}, {"a": document}, {})
    assert result.parameter_errors == {"torque_bias": {"median": pytest.approx(0.2), "count": 1}}
    assert "error of torque bias" in result.summary()


def test_brier_is_the_mean_square_of_what_was_stated_too_much() -> None:
    sure, wrong = (_document("effect", ("torque_bias", place)) for place in ("joint2", "joint2"))
    sure["candidates"][0]["probability"], wrong["candidates"][0]["probability"] = 0.9, 0.7
    answers = {"a": _answer(("torque_bias", "joint2")), "b": _answer(("backlash", "joint2"))}
    result = score_diagnoses(answers, {"a": sure, "b": wrong}, {})
    assert result.brier == pytest.approx(0.5 * (0.1**2 + 0.7**2))
