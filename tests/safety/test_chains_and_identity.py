"""Motions start and end at rest unless a neighbour fits; they are this robot's, and hold what was judged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import pytest

from excite.campaign.assessment import check
from excite.motion.content import content_hash, motion_columns, with_verdict
from excite.motion.files import load_motion, save_motion
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.check import check_motion


def part(motion: Motion, rows: slice, name: str, **chain: str) -> Motion:
    return replace(
        motion,
        name=name,
        time=motion.time[rows],
        q=motion.q[rows],
        v=motion.v[rows],
        a=motion.a[rows],
        contacts={foot: flags[rows] for foot, flags in motion.contacts.items()},
        metadata=replace(motion.metadata, **chain),
    )


def halves(motion: Motion) -> tuple[Motion, Motion]:
    """The motion cut where it moves; each half names the other."""
    middle = motion.n_samples * 2 // 5
    return (
        part(motion, slice(None, middle + 1), "first", following="second"),
        part(motion, slice(middle, None), "second", previous="first"),
    )


def kinds(robot: Robot, motion: Motion, *others: Motion) -> set[str]:
    verdict = check_motion(robot, motion, neighbours={other.name: other for other in others})
    return {violation.kind for violation in verdict.violations}


def test_halves_are_safe_together_and_in_any_file(
    arm: Robot, swinging: Motion, humanoid: Robot, squatting: Motion, tmp_path: Path
) -> None:
    for robot, motion in ((arm, swinging), (humanoid, squatting)):
        first, second = halves(motion)
        assert check(robot, [second, first]).safe
        assert not check(robot, [first]).safe and kinds(robot, first) == {"chain_does_not_fit"}
        for suffix, single in ((".parquet", True), (".csv", False), (".npz", False)):
            files = [
                save_motion(item, tmp_path / f"{item.name}{suffix}", single=single)
                for item in (first, second)
            ]
            assert check(robot, [load_motion(file, robot) for file in files]).safe


def test_halves_that_do_not_say_so_are_not(arm: Robot, swinging: Motion) -> None:
    first, second = halves(swinging)
    alone = replace(first, metadata=replace(first.metadata, following=""))
    assert "ends_moving" in kinds(arm, alone, second)
    alone = replace(second, metadata=replace(second.metadata, previous=""))
    assert "starts_moving" in kinds(arm, alone, first)


def test_a_neighbour_that_does_not_fit_is_none(
    arm: Robot, swinging: Motion, humanoid: Robot, squatting: Motion
) -> None:
    first, second = halves(swinging)
    elsewhere = replace(second, q=second.q + 1e-3)
    quicker = replace(second, v=1.1 * second.v)
    stranger = replace(second, metadata=replace(second.metadata, previous="third"))
    for neighbour in (elsewhere, quicker, stranger):
        assert "chain_does_not_fit" in kinds(arm, first, neighbour)
    one, other = halves(squatting)
    lifted = {foot: np.zeros_like(flags) for foot, flags in other.contacts.items()}
    assert "chain_does_not_fit" in kinds(humanoid, one, replace(other, contacts=lifted))


def test_a_chain_that_never_rests_is_none(arm: Robot, swinging: Motion) -> None:
    """A ring: each motion goes on from the other, and no robot can get onto it."""
    rows = [k for k in range(1, swinging.n_samples) if np.abs(swinging.v[k]).max() > 0.1]
    one = part(swinging, slice(rows[0], rows[40] + 1), "one", following="back", previous="back")
    back = replace(one.renamed("back"), q=one.q[::-1], v=one.v[::-1], a=-one.a[::-1])
    back = replace(back, metadata=replace(one.metadata, following="one", previous="one"))
    loop = replace(one, metadata=replace(one.metadata, following="one", previous="one"))
    assert kinds(arm, one, back) >= {"chain_does_not_fit"} and kinds(arm, loop, loop) >= {
        "chain_does_not_fit"
    }
    first, second = halves(swinging)
    third = replace(second.renamed("third"), metadata=replace(second.metadata, previous="first"))
    assert not kinds(arm, first, second, third)
    assert "chain_does_not_fit" in kinds(arm, third, first, second)


def test_a_motion_is_of_its_robot_only(arm: Robot, swinging: Motion) -> None:
    assert check_motion(arm, swinging).safe
    assert kinds(arm, replace(swinging, robot="another")) == {"other_robot"}
    other = replace(swinging, metadata=replace(swinging.metadata, robot_hash="0" * 64))
    assert kinds(arm, other) == {"other_version_of_robot"}
    assert not kinds(arm, replace(swinging, metadata=replace(swinging.metadata, robot_hash=arm.hash)))


@pytest.mark.parametrize("column", ["q.elbow_joint", "v.wrist_1_joint", "time"])
def test_samples_that_changed_after_they_were_written_are_found(
    column: str, arm: Robot, swinging: Motion, tmp_path: Path
) -> None:
    path = save_motion(swinging, tmp_path / "m.parquet")
    assert not load_motion(path, arm).metadata.stated_hash
    table = parquet.read_table(path)
    values = table[column].to_numpy().copy()
    values[7] = np.nextafter(values[7], 10.0)
    changed = table.set_column(table.column_names.index(column), column, [values])
    parquet.write_table(changed.replace_schema_metadata(table.schema.metadata), path)
    assert kinds(arm, load_motion(path, arm)) == {"changed_since_written"}


def test_a_verdict_travels_with_the_samples_that_it_belongs_to(
    arm: Robot, swinging: Motion, humanoid: Robot, squatting: Motion, tmp_path: Path
) -> None:
    for robot, motion in ((arm, swinging), (humanoid, squatting)):
        sealed = with_verdict(motion, check_motion(robot, motion).to_json(), robot.hash)
        for suffix in (".parquet", ".csv", ".npz"):
            again = load_motion(save_motion(sealed, tmp_path / f"m{suffix}"), robot)
            verdict = again.metadata.verdict
            assert verdict is not None and verdict["safe"] and verdict["robot_hash"] == robot.hash
            assert verdict["content_hash"] == content_hash(motion_columns(again))
        # Rounded to single precision it is another motion, and nobody judged that one.
        coarse = load_motion(save_motion(sealed, tmp_path / "c.parquet", single=True), robot)
        assert coarse.metadata.verdict is None and not coarse.metadata.stated_hash
        moved = replace(sealed, q=sealed.q + 1e-9)
        assert load_motion(save_motion(moved, tmp_path / "d.parquet"), robot).metadata.verdict is None
