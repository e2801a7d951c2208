"""Rehearsal: what a standing robot's motion does in simulation decides whether it is safe."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import excite
from excite.arrays import Moved
from excite.export.export import export_motion
from excite.motion.motion import Motion
from excite.regressor.kernels import base_link_regressor
from excite.robot.description import UncertaintyBlock
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.checks.joints import drive_torques
from excite.safety.checks.sweep import Sweep
from excite.safety.parameter_set import RowsOfSet, stated_parameters
from excite.simulation.rehearsal import (
    AT_LIMIT,
    MOST_SLIP_M,
    leaning_members,
    rehearse_alone,
    rehearse_motions,
)


@pytest.fixture(scope="module")
def squat(g1: Robot) -> Motion:
    return next(motion for motion in excite.load_motions("g1") if motion.metadata.generator == "squat")


def test_check_says_what_a_motion_did_in_simulation(g1: Robot, squat: Motion) -> None:
    report = excite.check(g1, [squat])
    (entry,) = report.to_json()["motions"]
    said = entry["rehearsal"]
    assert report.safe and list(said) == ["robots", "stands", "slip_m", "touches", "drive_share"]
    assert said["robots"] == ["model"]
    assert said["stands"] and not said["touches"]
    assert 0.0 <= said["slip_m"] < MOST_SLIP_M and 0.2 < said["drive_share"] < 1.0


def test_an_arm_is_not_rehearsed_nor_is_what_is_unsafe_anyway(g1: Robot, squat: Motion) -> None:
    faster = replace(squat, time=0.3 * squat.time, v=squat.v / 0.3, a=squat.a / 0.09)
    for report in (excite.check("jaco2", excite.load_motions("jaco2")[:1]), excite.check(g1, [faster])):
        assert "rehearsal" not in report.to_json()["motions"][0]


def test_a_drive_at_its_limit_without_a_load_refuses_the_motion(g1: Robot, squat: Motion) -> None:
    """Inverse dynamics leave the ankles a tenth; servos that hold the robot on soles need half as much again."""
    torque = g1.limits.torque.copy()
    ankles = [g1.joint_index(f"{side}_ankle_pitch_joint") for side in ("left", "right")]
    torque[ankles] = 1.1 * np.abs(drive_torques(Sweep(g1, squat))).max(axis=0)[ankles].max()
    weak = replace(g1, limits=replace(g1.limits, torque=torque))
    assert check_motion(weak, squat).safe
    alone = rehearse_alone(weak, squat)
    assert alone.stands and alone.drive_share >= 1.0 and alone.refused is not None
    report = excite.check(weak, [squat])
    (verdict,) = report.verdicts
    assert not report.safe and verdict.reason.startswith(f"{AT_LIMIT} of ")
    assert verdict.violations[0].limit == torque[g1.joint_index(verdict.violations[0].where)]
    (refused,) = rehearse_motions(weak, [squat], load=0.001)
    assert refused is not None and refused.reason == AT_LIMIT


def test_a_slip_of_more_than_a_centimetre_refuses_the_motion(g1: Robot, squat: Motion) -> None:
    """Soles on ice: what stands there by friction no longer does."""
    icy = replace(g1, feet=tuple(replace(foot, friction=0.02) for foot in g1.feet), hash="ice")
    sideways = next(m for m in excite.load_motions("g1") if m.metadata.generator == "random_joint")
    found = rehearse_alone(icy, sideways)
    assert found.refused is not None
    assert found.slip_m > MOST_SLIP_M or not found.stands


def test_export_refuses_what_falls_in_simulation(g1: Robot, squat: Motion, tmp_path: Path) -> None:
    """The independent check takes a foot's friction from the description, and finds nothing against the motion."""
    torque = g1.limits.torque.copy()
    ankles = [g1.joint_index(f"{side}_ankle_pitch_joint") for side in ("left", "right")]
    torque[ankles] = 1.1 * np.abs(drive_torques(Sweep(g1, squat))).max(axis=0)[ankles].max()
    weak = replace(g1, limits=replace(g1.limits, torque=torque))
    assert check_motion(weak, squat).safe
    with pytest.raises(excite.UnsafeMotionError, match=AT_LIMIT):
        export_motion(squat, weak, "csv", tmp_path / "squat.csv")
    assert not list(tmp_path.iterdir())
    export_motion(squat, g1, "csv", tmp_path / "squat.csv")
    assert (tmp_path / "squat.csv").is_file()


def test_a_robust_check_rehearses_the_members_that_lean_furthest(g1: Robot, squat: Motion) -> None:
    (verdict,) = excite.check(g1, [squat], robust=True).verdicts
    if verdict.robust is not None and verdict.robust.holds:
        assert verdict.rehearsal is not None and len(verdict.rehearsal.robots) == 3
    stated = replace(g1, description=g1.description.model_copy(update={"uncertainty": UncertaintyBlock()}))
    (verdict,) = excite.check(stated, [squat]).verdicts
    assert verdict.rehearsal is not None and verdict.rehearsal.robots[0] == "model"
    assert len(verdict.rehearsal.robots) == 3


def test_what_was_rehearsed_is_read_and_is_the_same(
    g1: Robot, squat: Motion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("EXCITE_CACHE", str(tmp_path))
    first = rehearse_alone(g1, squat)
    (file,) = (tmp_path / "rehearsals").iterdir()
    monkeypatch.setattr("excite.simulation.rehearsal.watched_run", None)
    assert rehearse_alone(g1, squat) == first
    # Another robot or motion is rehearsed anew, and so is what is damaged.
    weak = replace(g1, limits=replace(g1.limits, torque=0.9 * g1.limits.torque))
    for robot, motion in ((weak, squat), (g1, replace(squat, time=1.01 * squat.time))):
        with pytest.raises(TypeError):
            rehearse_alone(robot, motion)
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(TypeError):
        rehearse_alone(g1, squat)


@pytest.mark.parametrize("name", ["g1", "go2"])
def test_a_leaning_member_makes_the_most_of_a_moment(name: str) -> None:
    """The largest of a linear form over the set is its support function, and no drawn corner exceeds it."""
    robot = excite.load_robot(name)
    parameters, rng = stated_parameters(robot), np.random.default_rng(2)
    rest = Moved(robot.rest[None], *np.zeros((2, 1, robot.model.nv)))
    rows = RowsOfSet(robot, parameters).of_wrench(rest).of_wrench[0]
    regressor = base_link_regressor(robot.model, *rest)[0]
    turn = pin.Quaternion(robot.rest[3:7]).matrix()
    force, moment = turn @ regressor[:3], turn @ regressor[3:]
    wrench = np.vstack([force, moment + np.cross(robot.rest[:3, None], force, axis=0)])
    for form in rng.normal(size=(5, 6)):
        member = parameters.farthest(form @ rows)
        assert form @ wrench @ member == pytest.approx(float(parameters.rise(form @ rows)), rel=1e-9)
    members = leaning_members(robot)
    masses = robot.nominal_parameters[::10]
    shares = [phi[::10] / masses - 1.0 for phi in members.values()]
    assert len(members) == 2 and all(np.abs(share).max() < 0.11 for share in shares)
