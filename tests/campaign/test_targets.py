"""Why a parameter misses its target, and whether more motion is proposed."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest

from excite.campaign.loop import Earlier, joints_to_aim_at, missed_targets
from excite.documents.campaign import Campaign, Reason
from excite.report.conclusions import draw_conclusion
from excite.report.folder import read_folder
from excite.robot.robot import Robot

NAME = "mx(wrist_2_link)"


@dataclass(frozen=True)
class Estimate:
    """What is asked of an estimate here."""

    name: str
    rsd_percent: float


@pytest.mark.parametrize(
    ("before", "now", "reason"),
    [
        # By the square root, 12 % from 9 % is four times the motion of 100 s.
        ((), 12.0, Reason.MORE_MOTION),
        (((25.0, 24.0),), 12.0, Reason.MORE_MOTION),
        # Faster than the square root, which later motions do not keep up.
        (((50.0, 30.0),), 12.0, Reason.MORE_MOTION),
        # As a UR10's did over 117 s.
        (((41.0, 9.0), (66.0, 13.6)), 12.4, Reason.STALLED),
        # From 12.6 to 12 % with four times the motion.
        (((25.0, 12.6),), 12.0, Reason.STALLED),
        (((25.0, 60.0),), 30.0, Reason.NOISE),
    ],
)
def test_a_deviation_that_does_not_fall_is_not_helped_by_motion(
    ur10: Robot, before: tuple[tuple[float, float], ...], now: float, reason: Reason
) -> None:
    earlier = [Earlier(seconds, {NAME: rsd}) for seconds, rsd in before]
    (found,) = missed_targets(ur10, [Estimate(NAME, now)], (), 6.0, seconds=100.0, earlier=earlier)  # type: ignore[list-item]
    assert found.reason is reason
    assert bool(joints_to_aim_at(ur10, [found])) is (reason is Reason.MORE_MOTION)


@pytest.mark.parametrize(
    ("helped", "said", "command"),
    [
        ([], "and more motion would help none of them", "model"),
        ([NAME], "more motion may help 1 of them", "campaign"),
        (None, "not enough for", "campaign"),
    ],
)
def test_more_motion_is_proposed_where_it_helps(
    small_campaign: tuple[Campaign, Path],
    tmp_path: Path,
    helped: list[str] | None,
    said: str,
    command: str,
) -> None:
    result, made = small_campaign
    folder = shutil.copytree(made, tmp_path / "campaign")
    document = json.loads((folder / "campaign.json").read_text())
    last = document["iterations"][-1]
    document["targets_met"] = False
    assert last["helped"] == [m.parameter for m in result.missed if m.reason.helped_by_motion]
    last |= {"not_met": [NAME, "Ixx(wrist_1_link)"], "helped": helped}
    (folder / "campaign.json").write_text(json.dumps(document))
    found = draw_conclusion(read_folder(folder))
    assert found is not None and said in found.found and found.command[0] == command
    assert found.good is False
