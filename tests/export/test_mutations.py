"""Whatever is done to a safe motion: it is harmless by an oracle of its own, or refused and nothing is written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from excite.errors import UnsafeMotionError
from excite.export.export import export_motion
from excite.motion.motion import Motion
from tests.export.oracle import unsafe
from tests.export.unsafe_cases import MUTATED, STARTS, kinds, outcome, start

_ARM, _HUMANOID = 0, 1


def test_there_are_many_ways_and_the_unspoilt_motions_pass_check_and_oracle(tmp_path: Path) -> None:
    assert len(MUTATED) >= 25
    for index in (_ARM, _HUMANOID):
        robot, motion = start(index)
        assert unsafe(robot, export_motion(motion, robot, "csv", tmp_path / STARTS[index][0])) == []


@pytest.mark.parametrize("kind", kinds(_ARM))
def test_a_spoilt_motion_of_an_arm_is_refused_or_harmless(kind: str) -> None:
    found = outcome(None, (_ARM, kind, 1))
    assert found.good, found


@settings(max_examples=8, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.sampled_from(kinds(_HUMANOID)), st.integers(0, 2**32 - 1))
def test_a_spoilt_motion_of_a_humanoid_is_refused_or_harmless(kind: str, seed: int) -> None:
    found = outcome(None, (_HUMANOID, kind, seed))
    assert found.good, found


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("much faster", "speed|acceleration|torque"),
        ("held beyond a limit", "position"),
        ("start cut", "moves at an end"),
        ("velocities scaled", "v is not the derivative"),
    ],
)
def test_the_oracle_sees_what_is_unsafe_by_itself(kind: str, reason: str, tmp_path: Path) -> None:
    import re

    from tests.export.mutations import spoilt

    robot, motion = start(_ARM)
    said: list[str] = []
    for seed in range(8):
        moved = spoilt(robot, motion, kind, seed, tmp_path)
        said += unsafe(
            robot, export_motion(moved, robot, "csv", tmp_path / "m", unsafe_anyway="for the oracle")
        )
        if any(re.match(reason, item) for item in said):
            return
    pytest.fail(f"{reason}: not among {said}")


def test_arrays_of_another_shape_leave_for_no_reason(tmp_path: Path) -> None:
    robot, motion = start(_ARM)
    for spoilt in (
        replace(motion, v=np.hstack([motion.v, motion.v])),
        replace(motion, q=motion.q[:, :, None]),
        replace(motion, a=np.full_like(motion.a, np.nan)),
    ):
        for reason in (None, "whatever"):
            with pytest.raises(UnsafeMotionError, match="nothing was written"):
                export_motion(spoilt, robot, "npz", tmp_path / "m", 100.0, unsafe_anyway=reason)
    assert not list(tmp_path.iterdir())


def test_a_chain_that_leads_back_to_itself_does_not_leave(tmp_path: Path) -> None:
    robot, motion = start(_ARM)
    time = np.arange(0.0, 2.0001, 0.01)
    q, still = np.tile(robot.rest, (len(time), 1)), np.zeros((len(time), robot.n_joints))
    v, a = still.copy(), still.copy()
    q[:, -1] += 0.3 * np.sin(np.pi * time)
    v[:, -1], a[:, -1] = 0.3 * np.pi * np.cos(np.pi * time), -0.3 * np.pi**2 * np.sin(np.pi * time)
    said = replace(motion.metadata, previous="loop", following="loop", verdict=None)
    loop = Motion("loop", robot.name, robot.joint_names, time, q, v, a, {}, said)
    with pytest.raises(UnsafeMotionError, match="leads back to it"):
        export_motion(loop, robot, "csv", tmp_path / "loop")
    assert not list(tmp_path.iterdir())
