"""Fixtures of the tests of controller files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import pytest

from excite.export import clearance
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.verdict import Verdict


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
