"""What is known of single segments: nominal masses by hand, symmetry that does not hold, ranges of masses."""

from __future__ import annotations

import json

import numpy as np
import pinocchio as pin
import pytest
from typer.testing import CliRunner

from benchmarks.people.identified import wearing
from benchmarks.virtual_person import perform_exercise, record_performance
from excite.cli.main import app
from excite.errors import InputError, UnknownNameError
from excite.human.body import body_of
from excite.human.measure import write_person
from excite.human.segments import NAMES, Subject
from tests.human.recordings import write_c3d

pytestmark = pytest.mark.usefixtures("readers_here")

WHO = ["--mass", "70", "--height", "1.82", "--sex", "male"]


def masses(body) -> dict[str, float]:
    return dict(zip(NAMES, (inertia.mass for inertia in body.inertias), strict=True))


def test_masses_by_hand_leave_the_rest_in_proportion():
    body = body_of(Subject(70.0, 1.82, "male"))
    amputee = body.with_masses({"left_foot": 0.1, "left_shank": 1.5})
    before, after = masses(body), masses(amputee)
    assert after["left_foot"] == 0.1 and after["left_shank"] == 1.5
    assert sum(after.values()) == pytest.approx(70.0)
    assert after["torso"] / after["head"] == pytest.approx(before["torso"] / before["head"])
    k = NAMES.index("left_shank")
    ratio = amputee.inertias[k].inertia / body.inertias[k].inertia.clip(1e-12)
    assert ratio[0, 0] == pytest.approx(1.5 / before["left_shank"])
    with pytest.raises(UnknownNameError, match="segment 'tail'"):
        body.with_masses({"tail": 1.0})
    with pytest.raises(InputError, match="for a stump"):
        body.with_masses({"left_foot": 0.0})
    with pytest.raises(InputError, match="kilograms"):
        body.with_masses({"torso": 60.0, "pelvis": 15.0})


def test_a_worn_weight_adds_its_steiner_term():
    body = body_of(Subject(70.0, 1.82, "male"))
    weight = pin.Inertia(2.0, np.array([0.0, 0.0, -0.1]), np.zeros((3, 3)))
    k = NAMES.index("right_hand")
    hand, worn = body.inertias[k], wearing(body, "right_hand", weight).inertias[k]
    assert worn.mass == pytest.approx(hand.mass + 2.0)
    assert worn.mass * worn.lever == pytest.approx(hand.mass * hand.lever + 2.0 * weight.lever)
    assert worn.matrix()[3:, 3:] == pytest.approx(
        hand.matrix()[3:, 3:] + 2.0 * 0.01 * np.diag([1.0, 1.0, 0.0])
    )


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            ["identify", "{log}/robot.yaml", "{log}", "--mass-range", "left_foot=0.5", "--method", "lmi"],
            "'lmi'",
        ),
        (
            ["identify", "{log}/robot.yaml", "{log}", "--mass-range", "left_foot:0.5", "--method", "hqp"],
            "SEGMENT=NUMBER",
        ),
        (["human", "{trial}", *WHO, "--segment-mass", "tail=1", "--out", "{log}"], "unknown segment 'tail'"),
    ],
)
def test_wrong_options_are_named(session, person, tmp_path, words, says):
    trial = write_c3d(session.trial, tmp_path / "walk.c3d")
    write_person(person, tmp_path / "log")
    run = CliRunner().invoke(app, [word.format(trial=trial, log=tmp_path / "log") for word in words])
    assert isinstance(run.exception, InputError)
    assert says in str(run.exception) and "\n" not in str(run.exception)


@pytest.mark.slow
def test_hqp_keeps_ranges_and_lets_sides_differ(session, tmp_path):
    """Long enough that there are more instants than base parameters: of fewer the tables' masses would stay."""
    show = perform_exercise(session.who.body, 20.0, seed=2)
    moving = record_performance(session.who, show, np.random.default_rng(5), noise=0.5)
    trial = write_c3d(moving, tmp_path / "walk.c3d")
    out = tmp_path / "out"
    words = ["human", str(trial), *WHO, "--segment-mass", "left_foot=0.3", "--out", str(out)]
    assert CliRunner().invoke(app, words).exit_code == 0
    words = ["identify", str(out / "robot.yaml"), str(out), "--method", "hqp", "--asymmetric", "left_foot"]
    words += ["--mass-range", "0.2", "--mass-range", "torso=0.01"]
    run = CliRunner().invoke(app, [*words, "--json"])
    assert run.exit_code == 0, run.output
    links = json.loads(run.stdout)["standard_parameters"]
    nominal = {block["name"]: block["nominal_mass"] for block in links.values()}
    found = {block["name"]: block["mass"] for block in links.values()}
    assert nominal["left_foot"] == pytest.approx(0.3)
    assert 0.24 - 1e-6 <= found["left_foot"] <= 0.36 + 1e-6
    assert found["right_foot"] > 2.0 * found["left_foot"]
    assert found["torso"] == pytest.approx(nominal["torso"], rel=0.0101)
    for side in ("thigh", "hand"):
        assert 0.9 - 1e-6 <= found[f"left_{side}"] / found[f"right_{side}"] <= 1.0 / 0.9 + 1e-6
    reaction = json.loads(run.stdout)["fit"]
    assert reaction["fz"]["rmse"] < reaction["fz"]["reference_rmse"] < 30.0
