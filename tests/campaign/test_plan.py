"""The verb plan."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from excite.campaign.assessment import check, rank
from excite.campaign.plan import Plan, plan
from excite.campaign.pool import OnDisk
from excite.errors import InputError, NoSolutionError, UnknownNameError
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.repairs.draft import Rejection
from excite.simulation.rehearsal import loaded_robot, rehearse_motions
from excite.simulation.virtual_robot import VirtualRobot
from tests.simulation.motions import replay_motion

FALLEN = Rejection("any", "fell_in_rehearsal", "base")


def test_plan_document_has_what_scripts_read(small_plan: Plan) -> None:
    document = small_plan.to_json()
    assert document["schema"] == "excite.plan/1"
    counts = document["candidates"]
    assert counts["generated"] == 8
    assert counts["accepted"] + sum(counts["rejected"].values()) == 8
    assert {"full", "log_det", "n_base_parameters", "segments"} <= set(document["conditioning"])
    assert document["conditioning"]["n_base_parameters"] == 36 + 12
    assert [stage["stage"] for stage in document["stages"]] == ["generate", "filter", "rank", "choose"]
    for entry in document["selected"]:
        assert entry["segments"] and entry["duration_s"] > 0.0
        over_set = document["robust"][Path(entry["motion"]).stem]
        assert over_set["joint_torque_nm"] > 0.0 and over_set["decides"] is False


def test_best_three_of_every_segment_are_chosen(ur10: Robot, small_plan: Plan) -> None:
    report = {item.motion: item.conditioning for item in rank(ur10, small_plan.accepted).motions}
    chosen = {motion.name for motion in small_plan.motions}
    for place, segment in enumerate(small_plan.conditioning.segments):
        by_condition = sorted(report, key=lambda name: report[name].segments[place].condition)
        assert set(by_condition[:3]) <= chosen, segment.segment


def test_plan_does_not_depend_on_the_number_of_processes(
    ur10: Robot, small_plan: Plan, tmp_path: Path
) -> None:
    other = plan(ur10, n_candidates=8, seed=3, jobs=2)
    one, two = small_plan.save(tmp_path / "one"), other.save(tmp_path / "two")
    files = sorted(path.name for path in (one / "motions").iterdir())
    assert files == sorted(path.name for path in (two / "motions").iterdir())
    for name in files:
        assert (one / "motions" / name).read_bytes() == (two / "motions" / name).read_bytes()
    assert small_plan.to_json()["selected"] == other.to_json()["selected"]
    assert small_plan.to_json()["conditioning"] == other.to_json()["conditioning"]


def test_saved_motions_are_safe_and_come_back_equal(ur10: Robot, small_plan: Plan, tmp_path: Path) -> None:
    folder = small_plan.save(tmp_path)
    motions = [load_motion(folder / entry["motion"], ur10) for entry in small_plan.to_json()["selected"]]
    for motion, saved in zip(small_plan.motions, motions, strict=True):
        np.testing.assert_array_equal(motion.q, saved.q)
    assert check(ur10, motions[:2]).safe


def test_a_plan_takes_the_place_of_the_one_before_it(small_plan: Plan, tmp_path: Path) -> None:
    folder = small_plan.save(tmp_path)
    file = folder / "plan.json"
    ours = sorted(path.name for path in (folder / "motions").iterdir())
    # A plan of another robot that had one motion more, and a file that is nobody's.
    document = json.loads(file.read_text())
    document["selected"].append({**document["selected"][0], "motion": "motions/sway_007.parquet"})
    file.write_text(json.dumps(document))
    (folder / "motions" / "sway_007.parquet").write_bytes(b"old")
    (folder / "motions" / "mine.parquet").write_bytes(b"mine")
    small_plan.save(folder)
    assert sorted(path.name for path in (folder / "motions").iterdir()) == sorted([*ours, "mine.parquet"])
    file.write_text("{")
    small_plan.save(folder)


def test_targets_are_aimed_at(ur10: Robot) -> None:
    aimed = plan(ur10, n_candidates=2, targets=("wrist_2_joint",), seed=1)
    assert {target for motion in aimed.accepted for target in motion.metadata.targets} == {"wrist_2_joint"}


def test_bad_arguments_are_refused(ur10: Robot) -> None:
    with pytest.raises(InputError, match="n_candidates: is 0"):
        plan(ur10, n_candidates=0)
    with pytest.raises(UnknownNameError, match="no_such_joint"):
        plan(ur10, n_candidates=1, targets=("no_such_joint",))
    with pytest.raises(UnknownNameError, match="unknown selection 'no_such_rule'"):
        plan(ur10, n_candidates=1, selection="no_such_rule")


@pytest.fixture(scope="module")
def standing_plan(g1: Robot) -> Plan:
    """A plan of six candidates for a robot that can fall."""
    return plan(g1, n_candidates=6, seed=4, jobs=2)


def test_chosen_motions_of_a_humanoid_were_rehearsed(g1: Robot, standing_plan: Plan) -> None:
    generators = {motion.metadata.generator for motion in standing_plan.accepted}
    assert generators == {"random_joint", "leg_swing", "squat"}
    assert standing_plan.conditioning.n_base_parameters == 199
    assert replay_motion(g1, standing_plan.motions[0]).on_its_feet


def test_a_motion_that_topples_the_robot_does_not_stand_its_rehearsal(g1: Robot, standing_plan: Plan) -> None:
    motion = standing_plan.accepted[0]
    leaning = motion.q.copy()
    waist = g1.n_base_q + g1.joint_index("waist_pitch_joint")
    ankles = [g1.n_base_q + g1.joint_index(f"{side}_ankle_pitch_joint") for side in ("left", "right")]
    leaning[:, waist] += 0.5
    leaning[:, ankles] += 0.4
    stands, falls = rehearse_motions(g1, [motion, replace(motion, q=leaning)])
    assert stands is None and falls is not None
    assert falls.reason == "fell_in_rehearsal" and falls.time_s is not None
    assert falls.where == "base" or falls.where.endswith("at its torque limit")


def test_what_a_motion_does_not_stand_is_said_with_where_and_how_much(
    g1: Robot, standing_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    rehearsal = import_module("excite.simulation.rehearsal")
    monkeypatch.setattr(rehearsal, "cached_file", lambda *_: None)
    really, motion = rehearsal.watched_run, standing_plan.accepted[0]
    waist = g1.joint_index("waist_pitch_joint")

    def becomes(clipped: bool = False, **changes: object) -> Rejection:
        def run(*args: object, **settings: object) -> object:
            found = really(*args, **settings)
            lacking, touches = np.zeros_like(found.recording.clipped), np.ones_like(found.recording.touches)
            lacking[:, waist] = clipped
            record = replace(found.recording, touches=touches, clipped=lacking)
            return replace(found, recording=record, replay=replace(found.replay, **changes))

        monkeypatch.setattr(rehearsal, "watched_run", run)
        (refused,) = rehearse_motions(g1, [motion])
        assert refused is not None
        return refused

    fell = becomes(clipped=True, fell=True, fell_at_s=1.5)
    assert (fell.reason, fell.time_s) == ("fell_in_rehearsal", 1.5)
    assert fell.where == "base, waist_pitch_joint at its torque limit"
    assert becomes(fell=True).where == "base"
    touched = becomes(self_collided=True)
    assert touched.reason == "touched_in_rehearsal" and touched.time_s == 0.0
    monkeypatch.setattr(rehearsal, "may_slip_m", lambda robot: 0.004)
    monkeypatch.setattr(type(g1.feet[0]), "flat", property(lambda foot: False))
    slipped = becomes(slip_m={"left_foot": (0.002,), "right_foot": (0.001, 0.005)})
    assert (slipped.reason, slipped.where) == ("slipped_in_rehearsal", "right_foot")
    assert (slipped.value, slipped.limit) == (0.005, 0.004)


def test_a_motion_near_falling_has_to_stand_without_the_load_too(
    g1: Robot, standing_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is on its back may hold it up, where a drive has nothing left or the robot tilts far."""
    rehearsal = import_module("excite.simulation.rehearsal")
    monkeypatch.setattr(rehearsal, "cached_file", lambda *_: None)
    really, motion = rehearsal.watched_run, standing_plan.accepted[0]

    def verdict(tilt: float, saturation: float, unloaded_stands: bool) -> tuple[bool, ...]:
        def run(virtual: VirtualRobot, *args: object, **settings: object) -> object:
            found = really(virtual, *args, **settings)
            loaded = virtual.truth.added_mass > 0.0
            fell = not loaded and not unloaded_stands
            changed = replace(found.replay, max_tilt_rad=tilt, torque_saturation=saturation, fell=fell)
            return replace(found, replay=changed)

        monkeypatch.setattr(rehearsal, "watched_run", run)
        return tuple(refused is None for refused in rehearse_motions(g1, [motion]))

    assert verdict(0.01, 0.0, unloaded_stands=False) == (True,)
    assert verdict(0.01, 0.1, unloaded_stands=False) == verdict(0.06, 0.0, unloaded_stands=False) == (False,)
    assert verdict(0.06, 0.1, unloaded_stands=True) == (True,)


def test_when_every_motion_falls_that_is_what_is_said(ur10: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    choice = import_module("excite.campaign.candidates")
    monkeypatch.setattr(choice, "rehearse_motions", lambda robot, motions, **_: (FALLEN,) * len(motions))
    with pytest.raises(
        NoSolutionError, match=r"all 2 safe motions of ur10 fall or slip in rehearsal, with 5%.* of base"
    ):
        plan(ur10, n_candidates=2, seed=1)


def test_a_robot_that_cannot_carry_much_is_rehearsed_with_less(
    ur10: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    choice = import_module("excite.campaign.candidates")
    monkeypatch.setattr(choice, "can_fall", lambda robot: True)
    monkeypatch.setattr(
        choice,
        "rehearse_motions",
        lambda robot, motions, load, **_: (None if load < 0.1 else FALLEN,) * len(motions),
    )
    found = plan(ur10, n_candidates=2, seed=1)
    assert found.load == 0.05 and found.to_json()["rehearsed_load"] == 0.05
    assert "rehearsed with 5% of the robot's mass" in found.summary()


def test_a_one_leg_stance_carries_a_load_of_which_the_model_does_not_know(
    g1: Robot, standing_plan: Plan
) -> None:
    swings = [motion for motion in standing_plan.accepted if motion.metadata.generator == "leg_swing"]
    for offset in ((0.0, 0.05, 0.1), (0.0, -0.05, 0.1)):
        carrying = loaded_robot(g1, offset)
        assert carrying.truth.added_mass == pytest.approx(0.15 * g1.mass)
        assert replay_motion(carrying, swings[0]).on_its_feet


def test_where_few_are_safe_more_candidates_are_drawn(ur10: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a plan that asks for as many at once; who says a number gets that number."""
    judged = import_module("excite.campaign.candidates")
    planned = import_module("excite.campaign.plan")
    for module in (judged, planned):
        monkeypatch.setattr(module, "N_CANDIDATES", 1)
    few = plan(ur10, seed=3, generator="fourier")
    once = plan(ur10, n_candidates=3, seed=3, generator="fourier")
    assert few.generated == once.generated == 3 and few.pool.names == once.pool.names
    assert few.to_json()["selected"] == once.to_json()["selected"]
    assert plan(ur10, n_candidates=2, seed=3, generator="fourier").generated == 2


def test_more_are_drawn_where_motions_fall(ur10: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    choice = import_module("excite.campaign.candidates")
    rehearsed: list[str] = []

    def falls(
        robot: Robot, motions: OnDisk[Motion], load: float, **_: object
    ) -> tuple[Rejection | None, ...]:
        names = [motion.name for motion in motions]
        rehearsed.extend(f"{name} {load}" for name in names)
        return tuple(None if int(name[-3:]) >= 3 else FALLEN for name in names)

    monkeypatch.setattr(choice, "rehearse_motions", falls)
    monkeypatch.setattr(import_module("excite.campaign.plan"), "N_CANDIDATES", 3)
    found = plan(ur10, seed=3, generator="fourier")
    assert found.generated in (6, 9) and found.rejected["fell_in_rehearsal"] >= 2
    assert len(found.pool.names) >= 3 and all(int(name[-3:]) >= 3 for name in found.pool.names)
    assert len(rehearsed) == len(set(rehearsed)), "none is rehearsed twice with one load"


def test_where_all_are_chosen_they_are_compared_with_nothing():
    found = plan(load_robot("ur10"), n_candidates=2, seed=1, jobs=1)
    assert len(found.selection.indices) == len(found.pool.entries)
    said = found.summary()
    assert "unchosen" not in said and said.count("condition number") == 1
    assert "none is left to validate on" in said
