"""Fixtures of the tests of controller files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache

import pytest

from excite.export import export as clearance
from excite.motion.collection import library_folder
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.load import load_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.verdict import Verdict

# Short ready motions; of other robots the first.
_SHORT = {"ur10": "random_joint_015", "g1": "squat_009"}


@cache
def ready(name: str) -> tuple[Robot, Motion]:
    """A robot and a ready motion of it."""
    robot = load_robot(name)
    files = sorted((library_folder(name) / "motions").glob(f"{_SHORT.get(name, '*')}.parquet"))
    return robot, load_motion(files[0], robot)


@pytest.fixture(scope="module")
def arm(request: pytest.FixtureRequest) -> Robot:
    """The robot that a module of tests names, ``ROBOT``."""
    return ready(request.module.ROBOT)[0]


@pytest.fixture(scope="module")
def motion(request: pytest.FixtureRequest) -> Motion:
    """A ready motion of it."""
    return ready(request.module.ROBOT)[1]


@pytest.fixture(scope="module")
def judged_once() -> Iterator[None]:
    """What leaves is judged by the check itself, once: the same samples, flags and origin have the same verdict again.

    For tests that write one motion in every format. A motion that has neighbours is judged every time.
    """
    known: dict[bytes, Verdict] = {}

    def remembered(robot: Robot, motion: Motion, *, neighbours: Mapping[str, Motion]) -> Verdict:
        arrays = (motion.time, motion.q, motion.v, motion.a, *motion.contacts.values())
        said = (robot.hash, motion.robot, motion.joint_names, tuple(motion.contacts), motion.metadata)
        key = repr((said, [(a.shape, a.dtype) for a in arrays])).encode() + b"".join(
            a.tobytes() for a in arrays
        )
        if set(neighbours) - {motion.name}:
            return check_motion(robot, motion, neighbours=neighbours)
        if key not in known:
            known[key] = check_motion(robot, motion, neighbours=neighbours)
        return replace(known[key], motion=motion.name)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clearance, "check_motion", remembered)
        yield
