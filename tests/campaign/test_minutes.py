"""Plans for minutes at the robot: what they reach, what they say when they reach nothing, and repeatability."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from excite.campaign.plan import plan
from excite.cli.main import app
from excite.errors import InputError, NoSolutionError
from excite.robot.robot import Robot


def test_minutes_hold_and_say_what_they_reach(ur10: Robot) -> None:
    made = plan(ur10, n_candidates=2, minutes=0.4, seed=0)
    assert {motion.metadata.generator for motion in made.motions} == {"gradient"}
    assert made.duration_s <= 24.0
    document = made.to_json()
    assert document["minutes"] == 0.4
    rsd = {
        p["name"]: p["predicted_rsd_percent"] for p in document["base_parameters"] if abs(p["value"]) > 0.01
    }
    assert set(document["reaches"]) == {name for name, value in rsd.items() if value <= 15.0}
    for entry in document["out_of_reach"]:
        expected = made.duration_s / 60.0 * (rsd[entry["parameter"]] / 15.0) ** 2
        assert entry["minutes"] == pytest.approx(expected)
    curve = document["curve"]
    assert [point["reached"] for point in curve] == list(range(1, len(curve) + 1))
    have = made.duration_s / 60.0
    assert sum(point["minutes"] <= have for point in curve) == len(document["reaches"])
    assert document["undesigned"] == 0
    again = plan(ur10, n_candidates=2, minutes=0.4, seed=0, jobs=2)
    assert [m.q.tobytes() for m in again.motions] == [m.q.tobytes() for m in made.motions]


def test_minutes_that_reach_nothing_asked_for_end_in_3(tmp_path: Path) -> None:
    arguments = [
        "plan",
        "ur10",
        "--minutes",
        "0.4",
        "--targets",
        "wrist_3_link:inertia",
        "--target-rsd",
        "0.001",
    ]
    told = CliRunner().invoke(
        app, [*arguments, "--candidates", "1", "--jobs", "1", "--json", "--out", str(tmp_path)]
    )
    assert told.exit_code == 3
    document = json.loads(told.stdout)
    assert document["reaches"] == []
    least = min(entry["minutes"] for entry in document["out_of_reach"] if entry["minutes"] is not None)
    assert document["curve"][0] == {"minutes": least, "reached": 1}
    assert all(entry["minutes"] is None or entry["minutes"] > 0.4 for entry in document["out_of_reach"])
    assert {entry["parameter"].partition("(")[2] for entry in document["out_of_reach"]} == {"wrist_3_link)"}
    assert (tmp_path / "plan.json").is_file()


def test_minutes_too_short_for_any_motion_name_the_least(ur10: Robot) -> None:
    with pytest.raises(NoSolutionError, match=r"the shortest of them takes 0\.\d+ min"):
        plan(ur10, n_candidates=1, minutes=0.01)


def test_parameters_without_minutes_are_refused(ur10: Robot) -> None:
    with pytest.raises(InputError, match="--minutes"):
        plan(ur10, n_candidates=1, parameters=("wrist_3_link:mass",))
