"""The verb campaign: the loop, its journal, and why it ends."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from excite.campaign import loop
from excite.campaign.experiment import simulate
from excite.campaign.journal import CampaignSettings
from excite.campaign.loop import campaign
from excite.campaign.plan import plan
from excite.documents.campaign import Campaign
from excite.errors import InputError, NoSolutionError
from excite.motion.collection import load_motions
from excite.robot.robot import Robot
from tests.campaign.conftest import SMALL


def test_campaign_document_has_what_scripts_read(small_campaign: tuple[Campaign, Path]) -> None:
    result, folder = small_campaign
    document = json.loads((folder / "campaign.json").read_text())
    assert document["schema"] == "excite.campaign/1"
    assert document["targets_met"] is result.targets_met
    for iteration in document["iterations"]:
        assert {"n_motions", "rsd_percent", "not_met"} <= set(iteration)
        missed = {name for name, rsd in iteration["rsd_percent"].items() if rsd > SMALL.target_rsd}
        assert missed <= set(iteration["not_met"])
    assert document["identification"]["schema"] == "excite.identification/1"


def test_every_miss_has_a_reason(small_campaign: tuple[Campaign, Path]) -> None:
    result, _ = small_campaign
    assert result.targets_met == (not result.missed)
    for miss in result.missed:
        assert miss.rsd_percent is None or miss.rsd_percent > SMALL.target_rsd
        assert miss.reason.value in str(miss)


def test_identified_arm_beats_the_nominal_one(small_campaign: tuple[Campaign, Path]) -> None:
    result, _ = small_campaign
    assert result.identification is not None
    for joint, fit in result.identification.validation.items():
        assert fit.rmse < fit.reference_rmse, joint


def test_second_iteration_makes_parameters_more_certain(small_campaign: tuple[Campaign, Path]) -> None:
    result, _ = small_campaign
    if len(result.iterations) < 2:
        pytest.fail("the small campaign is meant to need two iterations")
    first, second = (iteration.rsd_percent for iteration in result.iterations[:2])
    common = sorted(set(first) & set(second))
    better = sum(second[name] < first[name] for name in common)
    assert better > 0.7 * len(common)


def test_resuming_gives_the_same_result(
    ur10: Robot, small_campaign: tuple[Campaign, Path], tmp_path: Path
) -> None:
    _, folder = small_campaign
    again = tmp_path / "again"
    shutil.copytree(folder, again)
    (again / "campaign.json").unlink()
    shutil.rmtree(again / "iteration_2")
    campaign(ur10, again, SMALL, resume=True)
    assert (again / "campaign.json").read_bytes() == (folder / "campaign.json").read_bytes()


def test_a_folder_that_holds_a_campaign_is_not_overwritten(
    ur10: Robot, small_campaign: tuple[Campaign, Path]
) -> None:
    _, folder = small_campaign
    with pytest.raises(InputError, match="--resume"):
        campaign(ur10, folder, SMALL)
    with pytest.raises(InputError, match="seed 3, not 4"):
        campaign(ur10, folder, CampaignSettings(8, 5.0, 2, seed=4), resume=True)


def test_campaign_on_a_real_robot_waits_for_its_log(ur10: Robot, tmp_path: Path) -> None:
    settings = CampaignSettings(n_candidates=4, target_rsd=1e3, max_iterations=1, seed=5, on_robot=True)
    waiting = campaign(ur10, tmp_path, settings)
    assert not waiting.targets_met and waiting.awaits == tmp_path / "iteration_1" / "log"
    motions = load_motions([tmp_path / "iteration_1"], ur10)
    simulate(ur10, motions, seed=9).save(waiting.awaits)
    finished = campaign(ur10, tmp_path, settings, resume=True)
    assert finished.awaits is None and finished.identification is not None


def test_what_was_found_is_written_where_a_later_plan_fails(
    ur10: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first plan is the verb's own; no motion is safe for the second."""
    made = []

    def planned(*given: object, **named: object) -> object:
        if made:
            raise NoSolutionError("the one candidate is not safe")
        made.append(plan(*given, **named))
        return made[0]

    monkeypatch.setattr(loop, "plan", planned)
    asked = CampaignSettings(n_candidates=5, target_rsd=5.0, max_iterations=2, seed=3)
    with pytest.raises(NoSolutionError, match="the one candidate is not safe"):
        campaign(ur10, tmp_path / "campaign", asked)
    found = json.loads((tmp_path / "campaign" / "campaign.json").read_text(encoding="utf-8"))
    assert len(found["iterations"]) == 1
    assert not found["targets_met"]
    assert (tmp_path / "campaign" / "identification.json").is_file()


def test_minutes_are_kept_and_only_what_they_reach_is_aimed_at(ur10: Robot, tmp_path: Path) -> None:
    asked = CampaignSettings(n_candidates=2, max_iterations=2, minutes=0.25)
    result = campaign(ur10, tmp_path, asked)
    first = json.loads((tmp_path / "iteration_1" / "plan.json").read_text())
    assert list(result.aims) == first["reaches"]
    assert set(result.out_of_reach).isdisjoint(result.aims)
    assert result.iterations[0].seconds <= 15.0 + 0.1
    assert result.iterations[-1].seconds <= 30.0 + 0.1
    for one in result.iterations:
        assert set(one.rsd_percent) <= set(result.aims)
        assert set(one.not_met) <= set(result.aims)
        assert all(rsd <= 15.0 for name, rsd in one.rsd_percent.items() if name not in one.not_met)
    summary = result.summary()
    assert summary.startswith(f"0.25 min an iteration: {len(result.aims)} parameters aimed at")
    assert all(summary.count(name) == 1 for name in result.out_of_reach if name not in first["reaches"])
    document = json.loads((tmp_path / "campaign.json").read_text())
    assert document["aims"] == first["reaches"] and document["minutes"] == 0.25
