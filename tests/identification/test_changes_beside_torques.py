"""A load and a torque that reads wrong, both withheld from the log: what is named, and whether intervals hold it."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

import excite
from excite.cli.main import app

pytestmark = pytest.mark.slow
MOTIONS = Path(__file__).resolve().parents[2] / "motion_library"
WRISTS = {"wrist_1_link", "wrist_2_link", "wrist_3_link"}
# The arm, its load, the links that may be named for it, and the factor on a joint's torque.
CASES = {
    "load beyond the elbow": ("ur10", ("wrist_3_link", 0.7), WRISTS, ("elbow_joint", 1.1)),
    "factor at the shoulder": ("ur10", ("wrist_3_link", 0.7), WRISTS, ("shoulder_lift_joint", 1.1)),
    "load at the elbow": ("ur10", ("forearm_link", 1.0), {"forearm_link"}, ("elbow_joint", 0.9)),
    "another arm": ("panda", ("panda_link7", 0.8), {"panda_link7"}, ("panda_joint2", 1.08)),
    "load alone": ("ur10", ("wrist_3_link", 0.7), WRISTS, None),
    "factor alone": ("ur10", None, set(), ("elbow_joint", 1.1)),
}


def run(*arguments):
    found = CliRunner().invoke(app, [str(one) for one in arguments])
    assert found.exit_code == 0, found.output
    return found.stdout


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=[pytest.mark.battery] if case == "another arm" else []) for case in CASES],
)
def test_a_load_is_named_beside_the_factor_that_explains_the_rest(case, tmp_path):
    robot, load, links, factor = CASES[case]
    injected = [f"payload:{load[0]}:{load[1]}"] if load else []
    injected += [f"torque_gain:{factor[0]}:{factor[1]}"] if factor else []
    options = [part for one in injected for part in ("--inject", one)]
    run("simulate", robot, MOTIONS / robot / "motions", "--nominal", *options, "--out", tmp_path, "--jobs", 1)
    found = excite.identify(robot, tmp_path)
    document = found.to_json()
    named = document["changed_segments"]
    # One body at most, and one that a load at that place can be: a factor is no body.
    assert len(named) == (1 if load else 0) and {item["link"] for item in named} <= links
    for item in named:
        assert abs(item["mass_change_kg"] - load[1]) < 3.0 * item["std_kg"]
    beside = {item["name"]: item for item in document["changes"]["beside"]}
    if factor is None:
        assert beside == {}
    else:
        assert set(beside) == {f"gain.{factor[0]}"}
        item = beside[f"gain.{factor[0]}"]
        assert abs(item["value"] - (factor[1] - 1.0)) < 3.0 * item["std"]
        assert f"gain.{factor[0]}" in found.summary()
