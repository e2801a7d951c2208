"""One small campaign, shared by the tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from excite.campaign.journal import CampaignSettings
from excite.campaign.loop import campaign
from excite.campaign.plan import Plan, plan
from excite.documents.campaign import Campaign
from excite.robot.robot import Robot

SMALL = CampaignSettings(n_candidates=8, target_rsd=5.0, max_iterations=2, seed=3)


@pytest.fixture(scope="session")
def small_plan(ur10: Robot) -> Plan:
    """A plan of eight candidates."""
    return plan(ur10, n_candidates=8, seed=3)


@pytest.fixture(scope="session")
def small_campaign(ur10: Robot, tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, Path]:
    """A campaign of two iterations at most, and its folder."""
    folder = tmp_path_factory.mktemp("campaign")
    return campaign(ur10, folder, SMALL, jobs=2), folder
