"""The verb ``campaign``: plan, run, identify, and again for what is not certain enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from excite.campaign.expected import Forecast
from excite.campaign.journal import CampaignSettings, Journal, PlannedMotions, motion_prefix
from excite.campaign.plan import plan
from excite.campaign.plan_document import conditioning_comparison, merged_plan, robot_file
from excite.campaign.result import (
    Campaign,
    Earlier,
    Iteration,
    Miss,
    findings_of,
    joints_to_aim_at,
    missed_targets,
)
from excite.display import Shown, count
from excite.errors import MotionError, NoSolutionError
from excite.excitation.conditioning import Conditioning, MotionFactor, compute_conditioning, motion_factor
from excite.excitation.unexcited_directions import unexcited_parameters
from excite.folder_lock import claim_folder
from excite.identification.identify import identify
from excite.identification.result import Identification
from excite.json_document import write_json
from excite.logs.files import save_log
from excite.logs.header_blocks import Role
from excite.logs.load_with_robot import join_logs
from excite.logs.log import Log
from excite.motion.collection import MotionsLike, as_motions
from excite.motion.motion import Motion
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.reading.number import check_seed
from excite.report.comparisons import ReportData, save_report_data
from excite.robot.load import RobotLike, as_robot, keep_description
from excite.robot.robot import Robot
from excite.safety.checks.motion import time_faults
from excite.simulation.effects.registry import inject_effects as inject_effects
from excite.simulation.replay import Replay
from excite.simulation.simulate import run_experiment
from excite.simulation.true_parameters import TrueParameters
from excite.simulation.virtual_robot import Injected, VirtualRobot, changed_robot, nominal_robot

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
        jobs: number of processes, or an executor; the result does not depend on it.
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
        self.documents: list[dict[str, Any]] = []
        self.iterations: list[Iteration] = []
        self.identification: Identification | None = None
        self.conditioning: Conditioning | None = None
        self.expected: Forecast | None = None

    def plan(self, number: int, targets: Sequence[str]) -> PlannedMotions:
        """The motions of an iteration, planned now or before."""
        planned = self.journal.planned(number, self.robot) or self._plan_anew(number, targets)
        self.expected = Forecast.from_json(planned.document.get("forecast"))
        return planned

    def _plan_anew(self, number: int, targets: Sequence[str]) -> PlannedMotions:
        count = self.settings.n_candidates if number == 1 else max(1, self.settings.n_candidates // 4)
        made = plan(
            self.robot,
            n_candidates=count,
            targets=targets,
            seed=np.random.SeedSequence(self.settings.seed, spawn_key=(_PLAN_STREAM, number)),
            target_rsd=self.settings.target_rsd,
            before=self.motions,
            prefix=motion_prefix(number),
            jobs=self.jobs,
            progress=self.progress,
        )
        if made.interrupted:
            # What is found complete when the campaign goes on was planned with all candidates.
            raise KeyboardInterrupt
        made.save(self.journal.iteration(number))
        return PlannedMotions(tuple(made.motions), tuple(made.validation_motions), made.to_json())

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
        if experiment.fell:
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
        essential = self.identification.essential
        trials = [trial for entry in self.logs for trial in entry.role("identification")]
        seconds = float(sum(trial.time[-1] - trial.time[0] for trial in trials))
        missed = missed_targets(
            self.robot,
            essential,
            unexcited_parameters(self.conditioning),
            self.settings.target_rsd,
            seconds=seconds,
            earlier=[Earlier(one.seconds, one.rsd_percent) for one in self.iterations],
        )
        self.iterations.append(
            Iteration(
                n_motions=len(planned.chosen) + len(planned.validation),
                seconds=seconds,
                rsd_percent={item.name: item.rsd_percent for item in essential},
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
        )
        folder = self.journal.folder
        if self.identification is not None and self.conditioning is not None:
            data = self._report_data(self.identification, self.conditioning)
            save_report_data(data, folder / "report_data.npz")
            merged = merged_plan(self.robot, self.documents, self.conditioning)
            described = robot_file(self.robot, folder)
            write_json({**merged, **described}, folder / "plan.json")
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
        """The log that holds the trial that is shown in motion, relative to the campaign's folder."""
        shown = None if data.path is None else data.path.trial
        names = [{trial.name for trial in log.trials} for log in self.logs]
        number = next((k for k, there in enumerate(names, 1) if shown in there), 1)
        return self.journal.log_folder(number).relative_to(self.journal.folder).as_posix()


# The verb ``simulate``: an experiment on a virtual robot whose truth differs from the model.

# Streams of random numbers of one experiment, kept apart so that one does not shift the other.
_TRUTH_STREAM, _NOISE_STREAM = 1, 2


@dataclass(frozen=True, eq=False, repr=False)
class Experiment(Shown):
    """A log of a virtual robot, and the truth that a real one would keep to itself.

    Attributes:
        robot: the nominal robot.
        log: what its sensors said.
        truth: its true inertial parameters.
        replays: what became of each motion: falls, slips, touches, tracking.
        other_version: names of the motions that were made for this robot with another description or model.
        injected: effects that were injected.
    """

    robot: Robot
    log: Log
    truth: TrueParameters
    replays: tuple[Replay, ...]
    other_version: tuple[str, ...] = ()
    injected: tuple[Injected, ...] = ()

    @property
    def fallen(self) -> tuple[str, ...]:
        """Names of the motions during which it fell."""
        return tuple(replay.motion for replay in self.replays if replay.fell)

    @property
    def fell(self) -> bool:
        """Whether it fell in any motion."""
        return bool(self.fallen)

    def truth_json(self) -> dict[str, Any]:
        """True masses and what was added, for comparison afterwards; no part of the log."""
        masses = self.truth.phi[::10]
        return {
            "schema": "excite.truth/1",
            "robot": self.robot.name,
            "masses": {
                segment.link: float(m) for segment, m in zip(self.robot.segments, masses, strict=True)
            },
            "added": [{"what": part.what, "link": part.link, "mass": part.mass} for part in self.truth.parts],
            "parameters": self.truth.phi.tolist(),
            "injected": [asdict(one) for one in self.injected],
        }

    def to_json(self) -> dict[str, Any]:
        """The ``excite.simulation/1`` document."""
        return {
            "schema": "excite.simulation/1",
            "robot": self.robot.name,
            "log": "log.yaml",
            "trials": [
                {
                    "trial": trial.name,
                    "samples": len(trial.time),
                    "fell": replay.fell,
                    "self_collided": replay.self_collided,
                    "slip_m": replay.max_slip_m,
                    "tracking_error_rad": replay.max_tracking_error_rad,
                }
                for trial, replay in zip(self.log.trials, self.replays, strict=True)
            ],
            "fell": self.fell,
            "other_version": list(self.other_version),
        }

    def summary(self) -> str:
        """A few lines for a person."""
        seconds = sum(float(trial.time[-1] - trial.time[0]) for trial in self.log.trials)
        end = f"fell in {', '.join(self.fallen)}" if self.fell else "stayed on its feet"
        if not self.robot.floating:
            end = "done"
        said = f"{self.robot.name}: {count(len(self.log.trials), 'motion')}, {seconds:.0f} s, {end}"
        if self.other_version:
            names = ", ".join(self.other_version)
            said += f"\nmade for another version of this robot, and not known to be safe for it: {names}"
        return said

    def without_falls(self) -> Experiment:
        """The same experiment without the trials in which the robot fell.

        Raises:
            NoSolutionError: it fell in every one.
        """
        kept = [i for i, replay in enumerate(self.replays) if not replay.fell]
        if not kept:
            raise NoSolutionError(
                "the virtual robot fell in every motion", best=self, remedy="check the motions"
            )
        header = self.log.header.model_copy(update={"trials": tuple(self.log.header.trials[i] for i in kept)})
        log = replace(self.log, header=header, trials=tuple(self.log.trials[i] for i in kept))
        return replace(self, log=log, replays=tuple(self.replays[i] for i in kept))

    def save(self, folder: Path) -> Path:
        """Write the log folder and, beside the log, ``truth.json``."""
        save_log(self.log, folder)
        write_json(self.truth_json(), Path(folder) / "truth.json")
        return Path(folder)


def virtual_robot(
    robot: Robot, seed: int, *, nominal: bool = False, inject: Sequence[str] = ()
) -> VirtualRobot:
    """The virtual robot of a seed.

    Args:
        robot: the nominal robot.
        seed: decides where it differs from its model.
        nominal: give it the model's own inertial parameters and drives.
        inject: effects as ``EFFECT[:LOCATION[:VALUE]]``.

    Raises:
        InputError: an effect is malformed; UnknownNameError: an effect or its place is unknown.
    """
    check_seed(seed)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_TRUTH_STREAM,)))
    return inject_effects(nominal_robot(robot) if nominal else changed_robot(robot, rng), inject)


def simulate(
    robot: RobotLike,
    motions: MotionsLike,
    *,
    inject: str | Sequence[str] = (),
    nominal: bool = False,
    roles: Mapping[str, Role] | None = None,
    seed: int = 0,
    batch: int = 0,
    jobs: Jobs = 1,
    progress: Progress = silent,
) -> Experiment:
    """Run motions on a virtual robot and log them.

    Args:
        robot: the nominal robot, or what :func:`~excite.robot.load.load_robot` takes.
        motions: what to run, motions, files or folders; every fifth, in order, is logged as validation unless
            ``roles`` says otherwise.
        inject: effects as ``EFFECT[:LOCATION[:VALUE]]``, or one; the log's ``modelled`` names none of them, the truth
            all.
        nominal: give the virtual robot the model's own parameters.
        roles: by motion name, ``identification`` or ``validation``.
        seed: decides the virtual robot, and with ``batch`` the sensors' noise.
        batch: number of the experiment on the same robot.
        jobs: number of processes, or an executor; the log does not depend on it.
        progress: told after each motion.

    Returns:
        The log of the virtual robot, and what is true of it.

    Raises:
        InputError: no motions, an effect is malformed; UnknownNameError: an effect or its place is unknown.
        MotionError: a motion is not for this robot, or its samples are none that a controller could run.
    """
    robot = as_robot(robot)
    motions = as_motions(motions, robot)
    for motion in motions:
        _check_runs(robot, motion)
    effects = [inject] if isinstance(inject, str) else inject
    virtual = virtual_robot(robot, seed, nominal=nominal, inject=effects)
    noise = np.random.SeedSequence(seed, spawn_key=(_NOISE_STREAM, batch))
    chosen = dict(roles) if roles is not None else _every_fifth(motions)
    runs = run_experiment(virtual, motions, seed=noise, roles=chosen, jobs=jobs, progress=progress)
    others = tuple(m.name for m in motions if m.metadata.robot_hash not in ("", robot.hash))
    log = _without_injected(runs.log, virtual.injected)
    return Experiment(robot, log, virtual.truth, runs.replays, others, virtual.injected)


def _check_runs(robot: Robot, motion: Motion) -> None:
    """Refuse a motion of another robot, and one that time makes none of; raises MotionError."""
    if motion.robot != robot.name:
        raise MotionError(
            f"is a motion of {motion.robot!r}, not of {robot.name!r}",
            source=motion.name,
            field="robot",
            remedy="name the robot that it was made for",
        )
    for fault in time_faults(motion):
        raise MotionError(
            f"cannot be run: {fault}",
            source=motion.name,
            field="time",
            remedy="resample it evenly, 20 Hz or faster, without gaps",
        )


def _without_injected(log: Log, injected: Sequence[Injected]) -> Log:
    """The log whose baseline lacks what was injected: what it names, no diagnosis would look for."""
    names = {one.effect for one in injected}
    modelled = tuple(name for name in log.header.modelled if name not in names)
    return replace(log, header=log.header.model_copy(update={"modelled": modelled}))


def _every_fifth(motions: Sequence[Motion]) -> dict[str, Role]:
    if len(motions) < 5:
        return {}
    return {motion.name: "validation" for motion in motions[4::5]}
