"""A plan without safe candidates leaves a page that shows the worst of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import excite
from excite.cli.outcome import of_error, refusals_shown
from excite.documents.document import read_document
from excite.documents.plan import RefusalsDocument
from excite.errors import NothingSafeError
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_model
from tests.campaign.test_refusal import PAIR, touching


@pytest.fixture(scope="module")
def failure(ur10: Robot, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, NothingSafeError]:
    """Folder and error of a UR10 whose wrist is taken to touch its forearm."""
    folder = tmp_path_factory.mktemp("out")
    robot = touching(ur10, "wrist_2_link")
    with pytest.raises(NothingSafeError) as caught, refusals_shown(robot, folder):
        excite.plan(robot, n_candidates=2, seed=1)
    return folder, caught.value


def test_the_posture_that_is_shown_is_the_worst(failure: tuple[Path, NothingSafeError], ur10: Robot) -> None:
    """coal, asked for the distance of the two links in it, finds the very number."""
    folder, _ = failure
    entry = read_document(folder / "refusals.json", RefusalsDocument).to_json()["refused"][0]
    assert entry["where"] == PAIR
    robot = touching(ur10, "wrist_2_link")
    geometry = collision_model(robot)
    data, state = robot.model.createData(), geometry.createData()
    q = np.array(entry["posture"])
    pin.updateGeometryPlacements(robot.model, data, geometry, state, q)
    names = [part.name for part in geometry.geometryObjects]
    distances = [
        pin.computeDistance(geometry, state, k).min_distance
        for k, pair in enumerate(geometry.collisionPairs)
        if {names[pair.first].rsplit("_", 1)[0], names[pair.second].rsplit("_", 1)[0]}
        == set(PAIR.split(" - "))
    ]
    assert min(distances) == pytest.approx(entry["worst"], abs=1e-4)


def test_the_page_has_its_picture_and_the_table(failure: tuple[Path, NothingSafeError]) -> None:
    folder, error = failure
    page = (folder / "report.html").read_text()
    assert 'aria-label="The robot in the worst of the refused postures"' in page
    assert "forearm_link - wrist_2_link" in page and "collision.ignored_pairs" in page
    assert f"pictures of the worst: {folder / 'report.html'}" in of_error(error).table
    assert of_error(error).to_json()["report"] == str(folder / "report.html")


def test_a_later_plan_with_motions_takes_the_refusals_away(
    failure: tuple[Path, NothingSafeError], ur10: Robot
) -> None:
    folder, _ = failure
    made = excite.plan(ur10, n_candidates=2, seed=1)
    made.save(folder)
    assert not (folder / "refusals.json").exists()
    assert "selected" in json.loads((folder / "plan.json").read_text())


def test_what_refuses_a_speed_has_a_posture(ur10: Robot) -> None:
    acceleration = ur10.limits.acceleration.copy()
    acceleration[2] = 1e-3
    robot = replace(ur10, limits=replace(ur10.limits, acceleration=acceleration))
    with pytest.raises(NothingSafeError) as caught:
        excite.plan(robot, n_candidates=1, seed=1, generator="fourier")
    first = caught.value.best.refused[0]
    assert first.posture is not None and len(first.posture) == robot.model.nq
