"""The motion library: what it promises of every set."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import excite
from excite.errors import InputError, UnknownNameError
from excite.motion.collection import library_folder, library_names
from excite.motion.content import content_hash, motion_columns
from excite.motion.files import load_motion, save_motion
from excite.regressor.base_parameters import structural_base_parameters
from excite.robot.loading import build_robot

ROBOTS = [
    *("g1", "g1_no_ft", "g1_suspended", "go2", "hrp2like", "iiwa14"),
    *("jaco2", "panda", "so101", "talos", "ur10"),
]
LARGEST_BYTES = 4_500_000


def test_names() -> None:
    assert library_names() == ROBOTS
    with pytest.raises(UnknownNameError, match=r"unknown motion set 'nao'; choose one of g1, g1_no_ft"):
        excite.load_motions("nao")
    with pytest.raises(InputError, match="hand over the robot too"):
        excite.load_motions([library_folder("ur10")])
    with pytest.raises(InputError, match="without a robot"):
        excite.load_motions(str(library_folder("ur10")))


@pytest.mark.parametrize("name", ROBOTS)
def test_a_set_holds_its_motions_and_what_is_said_of_them(name: str) -> None:
    folder, motions = library_folder(name), excite.load_motions(name)
    verdict = json.loads((folder / "check.json").read_text())
    said = json.loads((folder / "conditioning.json").read_text())
    names = {motion.name for motion in motions}
    assert 4 <= len(motions) == len(names)
    assert {entry["motion"] for entry in verdict["motions"]} == names
    assert verdict["safe"] and verdict["schema"] == "excite.check/1"
    assert {Path(entry["motion"]).stem for entry in said["motions"]} == names
    assert said["conditioning"]["rank"] == _reachable(name, said["conditioning"]["n_base_parameters"])
    picture = folder / "motions.png"
    assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size <= 60_000


def _reachable(name: str, whole: int) -> int:
    """Parameters that commanded motions can tell: a plan keeps a hanging base still, as if it were held."""
    robot = excite.load_robot(name)
    if robot.description.base != "suspended":
        return whole
    held = robot.description.model_copy(update={"base": "held"})
    return structural_base_parameters(build_robot(held, robot.source)).rank


@pytest.mark.parametrize("name", ROBOTS)
def test_every_motion_carries_the_verdict_on_it_for_the_robot_as_it_is(name: str) -> None:
    """Where this fails after a change of a robot: ``python docs/make_motion_library.py --judge``."""
    robot = excite.load_robot(name)
    for motion in excite.load_motions(name):
        verdict = motion.metadata.verdict
        assert verdict is not None and verdict["safe"] and not motion.metadata.stated_hash
        assert verdict["robot_hash"] == motion.metadata.robot_hash == robot.hash
        assert verdict["content_hash"] == content_hash(motion_columns(motion))


def test_the_library_is_small() -> None:
    files = [path for name in ROBOTS for path in library_folder(name).rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) <= LARGEST_BYTES


# One set of an arm and one of legs; of the others the verdicts that they carry are compared above.
_SAMPLE = {"jaco2", "go2"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in _SAMPLE else [pytest.mark.battery]) for name in ROBOTS]
)
def test_every_motion_passes_the_independent_check(name: str) -> None:
    robot = excite.load_robot(name)
    assert excite.check(robot, excite.load_motions(name)).safe


def test_single_precision_keeps_positions_to_a_microradian(tmp_path: Path) -> None:
    robot, motion = excite.load_robot("ur10"), excite.load_motions("ur10")[0]
    again = load_motion(save_motion(motion, tmp_path / f"{motion.name}.parquet", single=True), robot)
    np.testing.assert_allclose(again.q, motion.q, rtol=0, atol=1e-6)
    np.testing.assert_allclose(again.v, motion.v, rtol=2e-5, atol=1e-12)
    np.testing.assert_array_equal(again.time, motion.time)
