"""The verb ``campaign``: plan, run, identify, and again for what is not certain enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from excite.campaign.assessment import CheckReport, check
from excite.campaign.experiment import simulate
from excite.campaign.journal import CampaignSettings, Journal, PlannedMotions, motion_prefix
from excite.campaign.plan import plan
from excite.campaign.plan_document import conditioning_comparison, merged_plan, robot_file
from excite.campaign.result import (
    Earlier,
    findings_of,
    joints_to_aim_at,
    missed_targets,
)
from excite.display import Shown, count
from excite.documents.campaign import Campaign, Iteration, Miss
from excite.documents.plan import PlanDocument
from excite.errors import InputError, NoSolutionError
from excite.excitation.conditioning import (
    Conditioning,
    MotionFactor,
    compute_conditioning,
    motion_factor,
    unexcited_parameters,
)
from excite.folder_lock import claim_folder
from excite.identification.identify import identify
from excite.identification.judgement import Forecast
from excite.identification.result import Identification
from excite.logs.header_blocks import Role
from excite.logs.load_with_robot import join_logs
from excite.logs.log import Log
from excite.motion.motion import Motion
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.report.comparisons import ReportData, save_report_data
from excite.report.page import report
from excite.results import write_json
from excite.robot.load import RobotLike, as_robot, keep_description
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.simulation.effects.registry import inject_effects as inject_effects

# Stream of random numbers of the plans, apart from those of the virtual robot.
_PLAN_STREAM = 3


def campaign(
    robot: RobotLike,
    folder: Path,
    settings: CampaignSettings | None = None,
    *,
    resume: bool = False,
    jobs: Jobs = 1,
    progress: Progress = silent,
) -> Campaign:
    """Run the loop until all targets are met or nothing more can be expected.

    Each iteration plans motions (the first for every joint, later ones for the joints whose parameters miss
    the target), runs them on the virtual robot, and identifies from all logs so far. It ends when every
    essential parameter is certain enough, when what misses is beyond more motion, or after
    ``max_iterations``. With ``on_robot`` it stops after each plan and waits for a recording.

    Args:
        robot: the robot, or what :func:`~excite.robot.load.load_robot` takes.
        folder: where everything is written.
        settings: what is asked for; defaults if None.
        resume: go on with the campaign that ``folder`` holds.
        jobs: number of processes; the result does not depend on it.
        progress: told as work proceeds.

    Returns:
        The campaign; also written to ``campaign.json``. Of one that the user interrupts, the iterations that were
        complete: ``interrupted`` says so, and ``resume`` goes on.

    Raises:
        KeyboardInterrupt: the user interrupted before any iteration was complete.
        InputError: the folder holds a campaign, or another one than asked for, or another run writes there.
        NoSolutionError: no candidate is safe, or the estimator failed; what earlier iterations found is written.
        LogError: a recorded log does not fit.
    """
    robot = as_robot(robot)
    settings = settings or CampaignSettings()
    with claim_folder(Path(folder)):
        journal = Journal(Path(folder))
        journal.open(robot, settings, resume=resume)
        state = _State(keep_description(robot, Path(folder)), settings, journal, jobs, progress)
        try:
            return _run_loop(state)
        except KeyboardInterrupt:
            if not state.iterations:
                raise
            return state.finish(interrupted=True)


def _run_loop(state: _State) -> Campaign:
    settings, journal = state.settings, state.journal
    targets: tuple[str, ...] = ()
    for number in range(1, settings.max_iterations + 1):
        try:
            planned = state.plan(number, targets)
        except NoSolutionError:
            # What was identified so far is the best that there is.
            if state.iterations:
                state.finish()
            raise
        log = state.run(number, planned)
        if log is None:
            return state.finish(awaits=journal.log_folder(number))
        missed = state.identify(planned, log)
        targets = joints_to_aim_at(state.robot, missed)
        if not targets:
            break
    return state.finish()


@dataclass
class _State:
    """What the iterations hand on to each other."""

    robot: Robot
    settings: CampaignSettings
    journal: Journal
    jobs: Jobs
    progress: Progress

    def __post_init__(self) -> None:
        self.factors: list[MotionFactor] = []
        self.motions: list[Motion] = []
        self.logs: list[Log] = []
        self.documents: list[PlanDocument] = []
        self.iterations: list[Iteration] = []
        self.identification: Identification | None = None
        self.conditioning: Conditioning | None = None
        self.expected: Forecast | None = None
        self.promised: PlanDocument | None = None

    @property
    def aims(self) -> tuple[str, ...]:
        """What the first plan for minutes said they reach; empty where all essential parameters are aimed at."""
        return () if self.promised is None else self.promised.reaches

    def plan(self, number: int, targets: Sequence[str]) -> PlannedMotions:
        """The motions of an iteration, planned now or before."""
        planned = self.journal.planned(number, self.robot) or self._plan_anew(number, targets)
        self.expected = planned.document.forecast
        self.promised = self.promised or planned.document
        return planned

    def _plan_anew(self, number: int, targets: Sequence[str]) -> PlannedMotions:
        count = self.settings.n_candidates if number == 1 else max(1, self.settings.n_candidates // 4)
        # For minutes what is lacking is asked for itself, of what the first plan said they reach.
        missed = self.iterations[-1].missed if self.aims and self.iterations else ()
        made = plan(
            self.robot,
            n_candidates=count,
            targets=targets,
            parameters=[one.parameter for one in missed],
            seed=np.random.SeedSequence(self.settings.seed, spawn_key=(_PLAN_STREAM, number)),
            target_rsd=self.settings.target_rsd,
            minutes=self.settings.minutes,
            before=self.motions,
            prefix=motion_prefix(number),
            jobs=self.jobs,
            progress=self.progress,
        )
        if made.interrupted:
            # What is found complete when the campaign goes on was planned with all candidates.
            raise KeyboardInterrupt
        made.save(self.journal.iteration(number))
        return PlannedMotions(tuple(made.motions), tuple(made.validation_motions), made.document())

    def run(self, number: int, planned: PlannedMotions) -> Log | None:
        """The log of an iteration: recorded before, or simulated now; None if it is to be recorded."""
        motions = (*planned.chosen, *planned.validation)
        found = self.journal.logged(number, self.robot, None if self.settings.on_robot else motions)
        if found is not None or self.settings.on_robot:
            return found
        roles: dict[str, Role] = {motion.name: "identification" for motion in planned.chosen}
        roles |= {motion.name: "validation" for motion in planned.validation}
        experiment = simulate(
            self.robot,
            motions,
            roles=roles,
            seed=self.settings.seed,
            batch=number,
            jobs=self.jobs,
            progress=self.progress,
        )
        experiment = experiment.without_falls()
        experiment.save(self.journal.log_folder(number))
        return experiment.log

    def identify(self, planned: PlannedMotions, log: Log) -> tuple[Miss, ...]:
        """Identify from all logs so far; returns what misses the target."""
        self.factors += [motion_factor(self.robot, motion) for motion in planned.chosen]
        self.motions += planned.chosen
        self.logs.append(log)
        self.documents.append(planned.document)
        self.conditioning = compute_conditioning(self.robot, self.factors)
        self.progress("identify", len(self.iterations), self.settings.max_iterations)
        self.identification = identify(self.robot, join_logs(self.logs), self.settings.method)
        judged, unexcited = self.identification.essential, unexcited_parameters(self.conditioning)
        if self.aims:
            judged = tuple(one for one in self.identification.base if one.name in self.aims)
            unexcited = tuple(one for one in unexcited if one.label in self.aims)
        trials = [trial for entry in self.logs for trial in entry.role("identification")]
        seconds = float(sum(trial.time[-1] - trial.time[0] for trial in trials))
        missed = missed_targets(
            self.robot,
            judged,
            unexcited,
            self.settings.target_rsd,
            seconds=seconds,
            earlier=[Earlier(one.seconds, one.rsd_percent) for one in self.iterations],
        )
        self.iterations.append(
            Iteration(
                n_motions=len(planned.chosen) + len(planned.validation),
                seconds=seconds,
                rsd_percent={item.name: item.rsd_percent for item in judged},
                missed=missed,
                forecast=self.expected,
            )
        )
        self.progress("identify", len(self.iterations), self.settings.max_iterations)
        return missed

    def finish(self, awaits: Path | None = None, *, interrupted: bool = False) -> Campaign:
        """Write and return the result."""
        result = Campaign(
            robot=self.robot.name,
            target_rsd=self.settings.target_rsd,
            iterations=tuple(self.iterations),
            identification=self.identification,
            conditioning=self.conditioning,
            awaits=awaits,
            expected=self.expected,
            interrupted=interrupted,
            minutes=self.settings.minutes,
            aims=self.aims,
            out_of_reach=()
            if self.promised is None
            else tuple(one.parameter for one in self.promised.out_of_reach),
        )
        folder = self.journal.folder
        if self.identification is not None and self.conditioning is not None:
            data = self._report_data(self.identification, self.conditioning)
            save_report_data(data, folder / "report_data.npz")
            merged = merged_plan(self.robot, self.documents, self.conditioning)
            described = robot_file(self.robot, folder)
            write_json(replace(merged, **described).to_json(), folder / "plan.json")
            identified = {**self.identification.to_json(), **described, "log_file": self._log_of(data)}
            write_json(identified, folder / "identification.json")
        write_json(result.to_json(), folder / "campaign.json")
        return result

    def _report_data(self, identification: Identification, together: Conditioning) -> ReportData:
        first = compute_conditioning(self.robot, self.factors[:1], together.base)
        truth = self.journal.log_folder(1) / "truth.json"
        found = findings_of(self.robot, identification, join_logs(self.logs), truth=truth)
        return replace(
            found,
            conditioning=conditioning_comparison(first, together, "a single motion", "all chosen motions"),
        )

    def _log_of(self, data: ReportData) -> str:
        """The log that holds the trial that is shown, relative to the campaign's folder."""
        shown = None if data.forces is None else data.forces.trial
        names = [{trial.name for trial in log.trials} for log in self.logs]
        number = next((k for k, there in enumerate(names, 1) if shown in there), 1)
        return self.journal.log_folder(number).relative_to(self.journal.folder).as_posix()


# The verb ``demo``: the main job on a bundled humanoid, ending in a report.

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
        jobs: number of processes; the result does not depend on it.
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
