"""The verb ``demo``: the main job on a bundled humanoid, ending in a report."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from excite.campaign.check import CheckReport, check
from excite.campaign.journal import CampaignSettings, Journal
from excite.campaign.loop import campaign
from excite.campaign.result import Campaign
from excite.display import Shown, count
from excite.errors import InputError
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.report.page import report
from excite.results import write_json
from excite.robot.loading import load_robot

ROBOT = "g1"
_SETTINGS = CampaignSettings(n_candidates=116, target_rsd=15.0, max_iterations=2, minutes=1.25)


@dataclass(frozen=True, eq=False, repr=False)
class Demo(Shown):
    """What the demo did.

    Attributes:
        campaign: the campaign.
        check: independent verdict on every motion that it ran.
        page: the report.
    """

    campaign: Campaign
    check: CheckReport
    page: Path

    def to_json(self) -> dict[str, Any]:
        """The campaign's document, with the verdict and the report's file name added."""
        return {**self.campaign.to_json(), "check": self.check.to_json(), "report": self.page.name}

    def summary(self) -> str:
        """A few lines for a person."""
        safe = "all safe" if self.check.safe else "NOT all safe"
        return "\n".join(
            [
                self.campaign.summary(),
                f"{count(len(self.check.verdicts), 'motion')} checked: {safe}",
                f"report: {self.page}",
            ]
        )


def demo(folder: Path, *, seed: int = 0, jobs: Jobs = 1, progress: Progress = silent) -> Demo:
    """Plan, check, run and identify on a virtual Unitree G1 that carries 5 kg which its model does not have.

    Args:
        folder: where everything is written; must not hold a campaign.
        seed: of all random numbers.
        jobs: number of processes, or an executor; the result does not depend on it.
        progress: told as work proceeds.

    Returns:
        The campaign, the verdicts on its motions, and the page.

    Raises:
        InputError: the folder holds a campaign already.
    """
    folder = Path(folder)
    if (folder / "journal.json").exists():
        raise InputError("holds a campaign already", source=folder, remedy="give another --out or remove it")
    robot = load_robot(ROBOT)
    result = campaign(robot, folder, replace(_SETTINGS, seed=seed), jobs=jobs, progress=progress)
    journal = Journal(folder)
    planned = [journal.planned(number, robot) for number in range(1, len(result.iterations) + 1)]
    motions = [motion for item in planned if item is not None for motion in (*item.chosen, *item.validation)]
    verdicts = check(robot, motions, jobs=jobs, progress=progress)
    write_json(verdicts.to_json(), folder / "check.json")
    return Demo(result, verdicts, report(folder))
