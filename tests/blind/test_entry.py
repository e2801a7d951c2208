"""Answers made elsewhere: read, refused in one line where they are malformed, and scored by hand-made numbers."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.blind.answers import read_entry
from benchmarks.blind.board import score_board
from benchmarks.blind.command import app
from benchmarks.blind.documents import Answer, HiddenEffect, JointGap
from benchmarks.blind.score import score_entry
from excite.errors import InputError
from excite.results import write_json
from tests.documents.small import SMALL

LIFT, ELBOW, WRIST = "shoulder_lift_joint", "elbow_joint", "wrist_1_joint"


def hidden(effect: str, place: str, **shares: float) -> HiddenEffect:
    return HiddenEffect(effect, place, 1.0, shares={f"{joint}_joint": x for joint, x in shares.items()})


def truth(*effects: HiddenEffect, quiet: tuple[str, ...] = ()) -> Answer:
    joints = {
        name: JointGap(gap=0.01 if name in quiet else 5.0, noise=1.0, together=0.0)
        for name in (LIFT, ELBOW, WRIST)
    }
    return Answer("everything", "ur10", ("rigid_body",), effects, 1.0, joints=joints)


ANSWER = truth(
    hidden("load_dependent_friction", LIFT, shoulder_lift=0.6, elbow=0.0, wrist_1=0.0),
    hidden("torque_bias", LIFT, shoulder_lift=0.35, elbow=0.0, wrist_1=0.0),
    hidden("base_tilt", "base", shoulder_lift=0.05, elbow=0.9, wrist_1=0.2),
    hidden("stribeck", WRIST, shoulder_lift=0.0, elbow=0.0, wrist_1=0.8),
    quiet=(WRIST,),
)
NONE = Answer("none", "ur10", ("rigid_body",), (), 1.0)


def said(*effects: dict, **fields: object) -> dict:
    return {"schema": "excite.blind_answer/1", "effects": list(effects), **fields}


def entry(folder: Path, **documents: dict) -> Path:
    for case, document in documents.items():
        write_json(document, folder / f"{case}.json")
    return folder


def figures(folder: Path, document: dict, answer: Answer = ANSWER) -> dict:
    answers = {"case_000": answer}
    return score_entry(answers, read_entry(entry(folder, case_000=document), answers)).figures()


def test_shares_found_named_and_stated_are_counted_as_by_hand(tmp_path: Path) -> None:
    got = figures(
        tmp_path,
        said(
            {"effect": "load_dependent_friction", "location": LIFT, "share": 0.7, "interval90": [0.65, 0.75]},
            {
                "effect": "base_tilt",
                "location": "base",
                "channel": ELBOW,
                "share": 0.85,
                "interval90": [0.8, 1],
            },
            {"effect": "base_tilt", "location": "base", "channel": LIFT, "share": 0.02},
            {"effect": "backlash", "location": ELBOW, "share": 0.15},
            {"effect": "joint_spring", "location": ELBOW, "share": 0.01},
        ),
    )
    # The wrist's gap is below its noise: nothing there is to be found.
    assert got["everything_effects"] == 3
    assert got["everything_share_found"] == pytest.approx((0.6 + 0.9) / (0.6 + 0.35 + 0.9))
    assert got["everything_found"] == pytest.approx(2 / 3)
    assert got["everything_named_right"] == pytest.approx(2 / 4)
    assert got["everything_large_named_right"] == pytest.approx(2 / 3)
    assert got["everything_share_error_median"] == pytest.approx((0.1 + 0.05) / 2)
    assert got["everything_share_inside"] == pytest.approx(1 / 2)


def test_an_asymmetry_is_a_bias_and_places_said_to_be_alike_count_as_one(tmp_path: Path) -> None:
    pair = said({"effect": "coulomb_asymmetry", "location": LIFT, "share": 0.35})
    assert figures(tmp_path / "pair", pair)["everything_named_right"] == 1.0
    places = [LIFT, ELBOW, WRIST, "wrist_2_joint"]
    hedged = said({"effect": "torque_bias", "location": ELBOW, "tied_locations": places})
    got = figures(tmp_path / "hedged", hedged)
    assert got["everything_found"] == pytest.approx(0.25 / 3)
    assert got["everything_named_right"] == pytest.approx(0.25)


def test_saying_nothing_finds_nothing_and_keeps_none(tmp_path: Path) -> None:
    got = figures(tmp_path / "all", said())
    assert (got["everything_found"], got["everything_named_right"]) == (0.0, None)
    assert figures(tmp_path / "none", said(), NONE)["none_kept"] == 1.0
    firm = said({"effect": "backlash", "location": ELBOW})
    got = figures(tmp_path / "firm", firm, NONE)
    assert (got["none_kept"], got["firm_wrong"]) == (0.0, 1.0)


def test_an_answer_says_of_ordinary_cases_what_a_diagnosis_says(tmp_path: Path) -> None:
    single = Answer("single", "ur10", ("rigid_body",), (HiddenEffect("backlash", ELBOW, 0.01),), 1.0)
    rival = {"effect": "backlash", "location": ELBOW}
    doubt = said({"effect": "stribeck", "location": ELBOW}, verdict="ambiguous", rivals=[rival])
    got = figures(tmp_path / "doubt", doubt, single)
    assert (got["single_named"], got["single_placed"], got["firm_wrong"]) == (1.0, 1.0, 0.0)
    unknown = Answer("unknown", "ur10", ("rigid_body",), (HiddenEffect("unknown", ELBOW, 1.0),), 1.0)
    got = figures(tmp_path / "unknown", said(verdict="unknown", location=ELBOW), unknown)
    assert (got["unknown_recognised"], got["unknown_placed"]) == (1.0, 1.0)


def test_a_diagnosis_is_an_answer_and_its_budget_says_the_shares(tmp_path: Path) -> None:
    share = {"effect": "load_dependent_friction", "location": LIFT, "share": 0.6, "interval90": [0.5, 0.7]}
    budget = {LIFT: {"noise_floor": 1, "gap": 5, "effects": [share], "unnamed": [], "rest": 0.4}}
    got = figures(tmp_path, {**SMALL["diagnosis"], "effects": [], "budget": budget})
    assert got["everything_share_found"] == pytest.approx(0.6 / 1.85)
    assert (got["everything_share_error_median"], got["everything_share_inside"]) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("{", "is no JSON"),
        ("[]", "is no JSON object"),
        ('{"schema": "mine/1"}', "schema is 'mine/1', not excite.blind_answer/1 or excite.diagnosis/1"),
        (json.dumps({"schema": "excite.blind_answer/1"}), "effects"),
        (json.dumps(said({"effect": "backlash"})), "location"),
        (json.dumps(said({"effect": "slop", "location": ELBOW})), "no effect is called 'slop'"),
        (json.dumps(said({"effect": "backlash", "location": "elbow"})), "ur10 has no 'elbow'"),
        (json.dumps(said({"effect": "base_tilt", "location": "base", "channel": "a"})), "no joint 'a'"),
        (json.dumps(said({"effect": "backlash", "location": ELBOW, "share": "half"})), "not a number"),
        (json.dumps(said({"effect": "backlash", "location": ELBOW, "share": float("nan")})), "no number"),
        (
            json.dumps(said({"effect": "backlash", "location": ELBOW, "share": 0.5, "interval90": [1, 0]})),
            "ends below",
        ),
        (json.dumps(said({"effect": "backlash", "location": ELBOW, "interval90": [0, 1]})), "of no share"),
        (json.dumps(said({"effect": "backlash", "location": ELBOW}, verdict="none")), "beside effects"),
        (json.dumps(said(verdict="effect")), "without an effect"),
        (None, "lacks case_000.json"),
    ],
)
def test_a_malformed_answer_is_refused_in_one_line(text: str | None, what: str, tmp_path: Path) -> None:
    if text is not None:
        (tmp_path / "case_000.json").write_text(text)
    with pytest.raises(InputError) as refused:
        read_entry(tmp_path, {"case_000": ANSWER})
    assert what in str(refused.value)
    assert "\n" not in str(refused.value)
    assert str(tmp_path) in str(refused.value)


def _made(folder: Path) -> Path:
    """A folder of two cases whose logs nobody looks at, and their answers beside it."""
    for name in ("case_000", "case_001"):
        (folder / "cases" / name).mkdir(parents=True)
    document = {"case_000": ANSWER.to_json(), "case_001": NONE.to_json()}
    write_json({"schema": "excite.blind/1", "seed": 1, "cases": document}, folder / "cases-answers.json")
    return folder / "cases"


def test_entries_are_scored_by_the_command_side_by_side(tmp_path: Path) -> None:
    cases = _made(tmp_path)
    good = said({"effect": "load_dependent_friction", "location": LIFT, "share": 0.6}, seconds=2.0)
    entry(tmp_path / "good", case_000=good, case_001=said(seconds=2.0))
    entry(tmp_path / "idle", case_000=said(), case_001=said())
    both = ["--entry", str(tmp_path / "good"), "--entry", str(tmp_path / "idle")]
    found = CliRunner().invoke(app, ["score", str(cases), *both])
    assert found.exit_code == 0, found.output
    lines = [line for line in found.stdout.splitlines() if line.startswith("|")]
    assert len(lines) == 4
    assert len({line.count("|") for line in lines}) == 1
    one = CliRunner().invoke(app, ["score", str(cases), *both[:2], "--json"])
    assert json.loads(one.stdout)["figures"]["everything_found"] == pytest.approx(1 / 3)
    lacking = CliRunner().invoke(app, ["score", str(cases), "--entry", str(tmp_path / "nowhere")])
    assert isinstance(lacking.exception, InputError)


def test_a_figure_without_a_case_is_a_dash(tmp_path: Path) -> None:
    answers = {"case_000": NONE}
    result = score_entry(answers, read_entry(entry(tmp_path, case_000=said()), answers))
    title, _, line = score_board({"a|b": result}).splitlines()
    cells = dict(zip(title.split(" | "), line.split(" | "), strict=True))
    assert (cells["| entry"], cells["none kept"], cells["placed"]) == ("| a/b", "100 %", "–")
