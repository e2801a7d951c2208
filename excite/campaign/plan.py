"""The verb ``plan``: generate, filter, rank, choose."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from excite.atomic import all_or_nothing
from excite.campaign.candidates import (
    ENOUGH,
    N_CANDIDATES,
    TURNS,
    Choice,
    Judged,
    Refusals,
    Rehearsed,
    Rule,
    add_seconds,
    check_generator,
    choose_motions,
    none_is_safe,
)
from excite.campaign.expected import TARGET_RSD, Outlook, check_target, is_predictable, outlook
from excite.campaign.optimised_series import Asked, SeriesSettings
from excite.campaign.plan_document import conditioning_comparison, robot_file
from excite.campaign.pool import Keeper, OnDisk, Pool, ranked_segments
from excite.campaign.searches import SEARCHES
from excite.display import Row, Tabled, count
from excite.documents.document import read_document
from excite.documents.plan import CandidateCounts, CurvePoint, OutOfReach, PlanDocument, SelectedMotion, Stage
from excite.errors import InputError, NoSolutionError
from excite.excitation.conditioning import Conditioning, MotionFactor, compute_conditioning
from excite.excitation.design_rows import ArmRows, can_design
from excite.excitation.gradient_design import GRADIENT
from excite.excitation.selection import (
    BEST_THREE,
    TARGETS,
    Selection,
    check_selection,
)
from excite.excitation.state_bound import bound_log_det, d_efficiency
from excite.excitation.targets import NEGLIGIBLE, asked_parameters
from excite.formats.number import check_count, check_number, check_seed
from excite.identification.judgement import PATIENCE, Forecast
from excite.motion.files import save_motion
from excite.motion.motion import Motion
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.regressor.base_parameters import BaseParameters, structural_base_parameters
from excite.report.comparisons import ReportData, save_report_data
from excite.results import write_json
from excite.robot.load import RobotLike, as_robot
from excite.robot.robot import Robot
from excite.robot.shapes.stand_ins import shape_conditions
from excite.safety.checks.robustness import judge_robustness
from excite.safety.checks.sweep import Sweep
from excite.safety.filter_report import FilterReport
from excite.safety.parameter_set import stated_parameters
from excite.safety.verdict import Robustness, conditions, robustness_of_all
from excite.simulation.rehearsal import UNKNOWN_LOAD
from excite.temporary_folder import TemporaryFolder

# Each takes some ten milliseconds, and those that are safe wait on disk: a million are a night's work of one machine.
MAX_CANDIDATES = 1_000_000
# From one sample to a season at the robot [s].
BUDGETS_S = (1e-3, 1e7)


def plan(
    robot: RobotLike,
    *,
    n_candidates: int | None = None,
    targets: Sequence[str] = (),
    generator: str | None = None,
    series: SeriesSettings | None = None,
    selection: str = BEST_THREE,
    budget_s: float | None = None,
    target_rsd: float = TARGET_RSD,
    minutes: float | None = None,
    parameters: Sequence[str] = (),
    before: Sequence[Motion] = (),
    robust: bool = False,
    seed: int | np.random.SeedSequence = 0,
    prefix: str = "",
    jobs: Jobs = 1,
    progress: Progress = silent,
) -> Plan:
    """Plan excitation motions (Jovic et al. 2015, section II.B).

    What is chosen was found safe by the independent check, and stood its rehearsal in simulation. Accepted motions
    wait in a temporary folder (of ``TMPDIR``) for as long as the plan is there, so that memory does not grow with
    their number. A user who interrupts (Ctrl-C) after the first of them gets the best so far, not rehearsed:
    ``interrupted`` of the plan says so.

    Args:
        robot: the robot, or what :func:`~excite.robot.load.load_robot` takes.
        n_candidates: how many candidate motions to generate; if None 140, and twice as many more while fewer than
            three motions come of them.
        targets: joints to aim at; all, if empty.
        generator: the only one to use: a name of the registry, or of a search such as ``optimised_fourier``,
            of which each candidate is a start; None for the robot's mixture.
        series: criterion and period of ``optimised_fourier``, with which alone they go.
        selection: ``best_three`` motions of every segment; or, within ``budget_s``, those of greatest ``log_det``
            (log-determinant), of least ``rsd`` (sum of predicted relative standard deviations), or few that give
            all ``segments`` together low condition numbers.
        budget_s: duration that the chosen motions stay within together [s], except for ``best_three``; as long as
            the best three take, if None.
        target_rsd: relative standard deviation that the plan says how much motion it would take to reach [percent].
        minutes: at the robot: motions are chosen within them for what is asked, of arms and of robots on force sensors
            among those designed by gradients. The plan says which parameters they reach.
        parameters: asked for, such as ``elbow_joint:friction``, ``forearm_link:com`` or ``Ixx(forearm_link)``; all, if
            empty.
        before: motions that were run already: what they tell is known to the choice for minutes and to the design, and
            what is to be expected counts them too.
        robust: plan for all robots of the set that the description states under ``uncertainty`` (or of its default):
            torque, zero-moment point and friction keep their limits whichever of them is there. Of an arm whose masses
            no file stated it is so in any case.
        seed: of all random numbers.
        prefix: put before the name of every motion.
        jobs: number of processes, or an executor; the plan does not depend on it.
        progress: told as work proceeds.

    Returns:
        The plan.

    Raises:
        KeyboardInterrupt: the user interrupted before any candidate was accepted.
        NoSolutionError: no candidate was accepted; the error says what refuses most and what would help; its
            ``best`` are the :class:`~excite.campaign.candidates.Refusals`.
        UnknownNameError: a target is no joint of the robot, or the generator or the selection is unknown.
        InputError: fewer than one candidate asked for, or settings that do not go together.
    """
    robot = as_robot(robot)
    check_target(target_rsd)
    _check_settings(generator, series, selection, budget_s)
    if minutes is not None:
        check_number(60.0 * minutes, "minutes", *BUDGETS_S, "s")
        selection, budget_s = TARGETS, 60.0 * minutes
        generator = generator or _designer(robot)
    if parameters and selection != TARGETS:
        raise InputError(
            "parameters to reach without minutes", field="targets", remedy="say how many: --minutes"
        )
    base = structural_base_parameters(robot)
    asked_parameters(parameters, base.labels)
    usual = (
        None
        if generator is None or generator not in SEARCHES
        else SEARCHES.make(generator).usual_count(robot)
    )
    count = (usual or N_CANDIDATES) if n_candidates is None else n_candidates
    check_count(count, "n_candidates", 1, MAX_CANDIDATES)
    root = check_seed(seed)
    # What a robot weighs that nobody weighed is a guess: its first motions hold for all that it may be.
    robust = robust or robot.description.has_assumed_masses
    asked = Asked(
        robot, count, targets, series, jobs, progress, robust, budget_s, tuple(parameters), target_rsd, before
    )
    folder = TemporaryFolder()
    judged = Judged(generator, asked, root, Keeper(folder.path, prefix), TURNS if n_candidates is None else 1)
    stages = judged.seconds
    rule = Rule(selection, budget_s, asked=tuple(parameters), target_rsd=target_rsd, before=tuple(before))
    report, choice = _judge_and_choose(judged, rule, base, folder)
    refusals = judged.refusals(report, choice.fallen)
    with add_seconds(stages, "choose"):
        pool, indices = choice.pool, choice.selection.indices
        chosen = compute_conditioning(robot, pool.factors.only(indices), base)
        seconds = float(pool.durations[list(indices)].sum())
        unchosen = compute_conditioning(robot, pool.factors.only(pool.first_seconds(seconds)), base)
        robust_margins = () if choice.interrupted else _robustness(asked, pool.motions.only(indices))
    return Plan(
        robot=robot,
        generated=report.generated,
        rejected={**report.rejected, **Counter(refused.reason for refused in choice.fallen)},
        refusals=refusals,
        pool=pool,
        selection=choice.selection,
        validation=choice.validation,
        conditioning=chosen,
        unchosen=unchosen,
        stages=stages,
        load=choice.load,
        interrupted=choice.interrupted,
        target_rsd=target_rsd,
        before=tuple(before),
        robust=robust_margins,
        minutes=minutes,
        parameters=tuple(parameters),
        undesigned=sum(pool.entries[i].generator != generator for i in indices)
        if generator in SEARCHES
        else 0,
    )


def _designer(robot: Robot) -> str | None:
    """The search that designs motions of a robot; None where there is none."""
    able = (robot.floating or not robot.feet) and can_design(robot)
    return GRADIENT if able and is_predictable(robot) else None


def _robustness(asked: Asked, motions: Sequence[Motion]) -> tuple[Robustness, ...]:
    """Least margins of motions over the robots that the description states."""
    shared = (asked.robot, asked.robust)
    return tuple(in_order(_robustness_of, motions, jobs=asked.jobs, shared=shared, total=len(motions)))


def _robustness_of(shared: tuple[Robot, bool], motion: Motion) -> Robustness:
    robot, decides = shared
    # The verdict has looked between the samples.
    sweep = Sweep(robot, motion, (motion.n_samples - 1) / motion.duration)
    return judge_robustness(sweep, stated_parameters(robot), decides=decides)


def _judge_and_choose(
    judged: Judged, rule: Rule, base: BaseParameters, folder: TemporaryFolder
) -> tuple[FilterReport, Choice]:
    """Candidates judged, and motions chosen of the safe ones: of more while there are too few, as far as that goes."""
    asked, rehearsed = judged.asked, Rehearsed()
    while True:
        report = judged.more()
        if not report.kept:
            if report.interrupted:
                raise KeyboardInterrupt
            raise none_is_safe(asked.robot, judged.refusals(report))
        with add_seconds(judged.seconds, "rank"):
            pool = Pool(report.kept, folder, ranked_segments(asked.robot))
        with add_seconds(judged.seconds, "choose"):
            try:
                choice = choose_motions(
                    asked.robot,
                    pool,
                    base,
                    rule,
                    asked.jobs,
                    asked.progress,
                    rehearsed,
                    interrupted=report.interrupted,
                )
            except NoSolutionError:
                if judged.exhausted:
                    raise
                continue
        if len(choice.pool.entries) >= ENOUGH or judged.exhausted or choice.interrupted:
            return report, choice


def _check_settings(
    generator: str | None, series: SeriesSettings | None, selection: str, budget_s: float | None
) -> None:
    """Raise InputError or UnknownNameError where settings are unknown or do not go together."""
    check_selection(selection)
    check_generator(generator)
    if series is not None and generator not in SEARCHES:
        raise InputError(
            "criterion and period are those of optimised series",
            field="series",
            remedy=f"ask for the generator {' or '.join(map(repr, SEARCHES))}, or leave them out",
        )
    if budget_s is None:
        return
    check_number(budget_s, "budget", *BUDGETS_S, "s")
    if selection == BEST_THREE:
        raise InputError(
            "the best three of every segment take as long as they take",
            field="budget",
            remedy="choose by another selection, or leave it out",
        )


# What a plan is: motions that were found safe and chosen, and what they promise.


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Tabled):
    """Motions that were found safe and chosen because they excite the parameters.

    Attributes:
        robot: the robot.
        generated: number of candidates.
        rejected: by reason, how many candidates the filter refused.
        refusals: what refused them, and where.
        pool: every accepted motion, in the order of the candidates.
        selection: which of them go on, and for which segments.
        validation: accepted motions that were not chosen and that judge the result, as indices.
        conditioning: of the chosen motions together.
        unchosen: conditioning of as many seconds of accepted motions taken as they come, for comparison.
        stages: seconds by stage.
        load: that the robot carried on its back in the rehearsal, of its mass; None of a robot that cannot fall.
        target_rsd: that is asked for of the essential parameters [percent].
        before: motions that were run already, which what is to be expected counts too.
        interrupted: whether the user broke off: chosen from what was accepted by then, and not rehearsed.
        robust: least margins of each chosen motion over the robots that it may be; none where the user broke off.
        minutes: at the robot, within which motions were chosen for what is asked for; None where nobody said.
        parameters: that were asked for; all, if empty.
        undesigned: chosen motions that are as their own generator drew them, though a search was asked.
    """

    robot: Robot
    generated: int
    rejected: Mapping[str, int]
    refusals: Refusals
    pool: Pool
    selection: Selection
    validation: tuple[int, ...]
    conditioning: Conditioning
    unchosen: Conditioning
    stages: Mapping[str, float]
    load: float | None = None
    target_rsd: float = TARGET_RSD
    before: tuple[Motion, ...] = ()
    interrupted: bool = False
    robust: tuple[Robustness, ...] = ()
    minutes: float | None = None
    parameters: tuple[str, ...] = ()
    undesigned: int = 0

    tables = ("motions", "segments", "base_parameters", "rejected")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.display.Tabled`.

        The chosen motions, condition numbers by segment, what is to be expected of each base parameter (none where the
        sensors' noise is not stated), or how many candidates were refused for what.
        """
        if table == "motions":
            return [
                {
                    "motion": item.motion,
                    "segments": item.segments,
                    "duration_s": self.pool.entries[item.index].duration_s,
                }
                for item in self.selection.selected
            ]
        if table == "segments":
            return [one.row() for one in self.conditioning.segments]
        if table == "rejected":
            return [{"reason": reason, "candidates": n} for reason, n in sorted(self.rejected.items())]
        return [] if self.outlook is None else [one.row() for one in self.outlook.parameters]

    @property
    def accepted(self) -> OnDisk[Motion]:
        """The accepted motions, read from disk one by one."""
        return self.pool.motions

    @property
    def factors(self) -> OnDisk[MotionFactor]:
        """R factor of each accepted motion."""
        return self.pool.factors

    @property
    def motions(self) -> OnDisk[Motion]:
        """The chosen motions."""
        return self.accepted.only(self.selection.indices)

    @property
    def validation_motions(self) -> OnDisk[Motion]:
        """Motions for cross-validation, not among the chosen ones."""
        return self.accepted.only(self.validation)

    @cached_property
    def outlook(self) -> Outlook | None:
        """What all motions promise for each base parameter; None where the sensors' noise is not stated."""
        return outlook(self.robot, (*self.before, *self.motions)) if is_predictable(self.robot) else None

    @property
    def forecast(self) -> Forecast | None:
        """What that makes of the target; None without an outlook."""
        if self.outlook is None:
            return None
        return Forecast.of(self.outlook.essential_rsd, self.target_rsd, self._whole_s)

    @cached_property
    def needed_min(self) -> dict[str, float]:
        """Minutes of motion like this with which each parameter asked for reaches the target, fewest first.

        Of all of them those whose value in the model counts, which the choice aims at: what identification will keep as
        essential changes with the motions. Infinite where the motions say nothing.
        """
        if self.outlook is None:
            return {}
        asked = set(asked_parameters(self.parameters, [p.name for p in self.outlook.parameters]))
        rsd = {
            p.name: np.inf if p.rsd_percent is None else p.rsd_percent
            for p in self.outlook.parameters
            if p.name in asked and (self.parameters or abs(p.value) > NEGLIGIBLE)
        }
        needed = Forecast.of(rsd, self.target_rsd, self._whole_s).needed_s
        return dict(sorted(((name, s / 60.0) for name, s in needed.items()), key=lambda item: item[1]))

    @property
    def reaches(self) -> tuple[str, ...]:
        """Parameters asked for that the chosen motions are expected to bring to the target."""
        return tuple(name for name, minutes in self.needed_min.items() if minutes <= self._whole_s / 60.0)

    @cached_property
    def d_efficiency(self) -> float | None:
        """What the chosen motions of minutes tell a second, of the most that any states within the limits could.

        None without minutes, and of robots that no bound is known for.
        """
        if self.minutes is None or self.robot.floating or _designer(self.robot) is None:
            return None
        rows = ArmRows(self.robot)
        return d_efficiency(rows, list(self.motions), bound_log_det(rows))

    def _undesigned_in_words(self) -> list[str]:
        drawn = count(self.undesigned, "motion")
        return [f"chosen as drawn, for no safe design says more: {drawn}"] if self.undesigned else []

    @property
    def _left(self) -> dict[str, float]:
        """Minutes of those that the chosen motions do not bring to the target."""
        reached = self.reaches
        return {name: minutes for name, minutes in self.needed_min.items() if name not in reached}

    @property
    def reached_by_minutes(self) -> tuple[CurvePoint, ...]:
        """How many parameters asked for minutes of motion like this reach, wherever one more does."""
        finite = (minutes for minutes in self.needed_min.values() if 0.0 < minutes < np.inf)
        return tuple(CurvePoint(minutes, reached) for reached, minutes in enumerate(finite, start=1))

    def minutes_in_words(self) -> list[str]:
        """What the minutes reach, what a minute more would add, and what is out of reach; empty where nobody asked."""
        if self.minutes is None or not self.needed_min:
            return []
        reached, left, have = self.reaches, self._left, self._whole_s / 60.0
        line = f"{self.minutes:g} min reach {len(reached)} of {count(len(self.needed_min), 'parameter')} asked for"
        added = sum(minutes <= have + 1.0 for minutes in left.values())
        far = [name for name, minutes in left.items() if minutes > PATIENCE * have]
        line += f"; a minute more adds {added}" if left else ""
        if left and not reached:
            line += f"; the least that reach any are {min(left.values()):.3g} min"
        lines = [line + (f"; out of reach: {', '.join(far)}" if far else "")]
        if self.d_efficiency is not None:
            lines.append(
                f"information a second: {self.d_efficiency:.0%} of a bound that no motion reaches: any states within "
                "limits of position, velocity, acceleration and torque, without a way from one to the next"
            )
        return lines

    @property
    def _whole_s(self) -> float:
        """Duration of the chosen motions and of those before them [s]."""
        return self.duration_s + sum(motion.duration for motion in self.before)

    @property
    def duration_s(self) -> float:
        """Duration of the chosen motions together [s]."""
        return float(sum(self.pool.durations[list(self.selection.indices)]))

    def to_json(self) -> dict[str, Any]:
        """The ``excite.plan/1`` document."""
        return self.document().to_json()

    def document(self, **place: Any) -> PlanDocument:
        """What scripts read, and where the robot's file is, as :func:`robot_file` says."""
        names, chosen = self.pool.names, self.selection.selected
        return PlanDocument(
            robot=self.robot.name,
            candidates=CandidateCounts(
                self.generated, len(self.pool.entries), dict(sorted(self.rejected.items()))
            ),
            selected=tuple(
                SelectedMotion(
                    _motion_file(one.motion), one.segments, self.pool.entries[one.index].duration_s
                )
                for one in chosen
            ),
            conditioning=self.conditioning,
            stages=tuple(Stage(*stage) for stage in self.stages.items()),
            refused=self.refusals.refused,
            robust={item.motion: one for item, one in zip(chosen, self.robust, strict=False)},
            rehearsed_load=self.load,
            interrupted=self.interrupted,
            validation=tuple(_motion_file(names[i]) for i in self.validation),
            base_parameters=() if self.outlook is None else self.outlook.parameters,
            forecast=self.forecast,
            minutes=self.minutes,
            reaches=() if self.minutes is None else self.reaches,
            out_of_reach=()
            if self.minutes is None
            else tuple(OutOfReach(*item) for item in self._left.items()),
            curve=() if self.minutes is None else self.reached_by_minutes,
            d_efficiency=self.d_efficiency,
            undesigned=self.undesigned,
            as_far_as=shape_conditions(self.robot),
            assumed=tuple(self.robot.description.assumed),
            **place,
        )

    def summary(self) -> str:
        """A few lines for a person."""
        refused = ", ".join(f"{n} {reason}" for reason, n in sorted(self.rejected.items())) or "none"
        judged = f"{len(self.pool.entries)} of {count(self.generated, 'candidate')} accepted"
        lines = [
            f"{self.robot.name}: {judged} (refused: {refused})",
            f"{count(len(self.selection.indices), 'motion')} chosen, {self.duration_s:.0f} s in total"
            + (f"; safe{conditions(shapes)}" if (shapes := shape_conditions(self.robot)) else ""),
        ]
        if len(self.selection.indices) < len(self.pool.entries):
            lines += [f"chosen: {self.conditioning.summary()}", f"gained: {self._gain_of_choice()}"]
        else:
            lines += [f"all that were accepted: {self.conditioning.summary()}"]
            lines += ["none is left to validate on: plan more candidates"]
        if self.interrupted:
            rehearsed = ", and nobody has rehearsed them in simulation" if self.robot.floating else ""
            lines.append(f"interrupted: the best of those accepted by then{rehearsed}")
        if self.validation:
            names = ", ".join(f"{self.pool.names[i]}.parquet" for i in self.validation)
            lines.append(f"written too, to validate on and not to identify from: motions/{names}")
        if self.robust:
            lines.append(robustness_of_all(self.robust))
        if self.load is not None and self.load < UNKNOWN_LOAD:
            lines.append(
                f"rehearsed with {self.load:.0%} of the robot's mass on its back: with {UNKNOWN_LOAD:.0%} every motion "
                "falls or slips, so its model must know its mass"
            )
        if self.refusals.few:
            lines.append(self.refusals.summary())
        if self.outlook is not None:
            lines.append(self.outlook.summary())
        lines += [*self._undesigned_in_words(), *self.minutes_in_words()]
        if self.forecast is not None and self.forecast.needed_s:
            lines.append(self.forecast.summary())
        if self.selection.unserved:
            lines.append("excited by no single motion: " + ", ".join(self.selection.unserved))
        lines += [f"assumed: {one}" for one in self.robot.description.assumed]
        return "\n".join(lines)

    def _gain_of_choice(self) -> str:
        """What choosing gains over as many seconds of accepted motions taken as they come.

        The mean is the geometric one over the axes of the confidence ellipsoid: its volume goes with the root of the
        information's determinant.
        """
        chosen, unchosen = self.conditioning, self.unchosen
        if unchosen.rank < chosen.rank:
            return f"rank {chosen.rank}, as many seconds unchosen have {unchosen.rank}"
        if not np.isfinite(chosen.log_det):
            return "no rank: as many seconds unchosen excite as many base parameters"
        ratio = np.exp((unchosen.log_det - chosen.log_det) / (2.0 * chosen.rank))
        change = f"{abs(1.0 - ratio):.1%} {'smaller' if ratio <= 1.0 else 'larger'}"
        return (
            f"standard deviations {change} in the mean than of as many seconds unchosen "
            f"(log-determinant {unchosen.log_det:.4g})"
        )

    def report_data(self) -> ReportData:
        """What the report shows beside the JSON."""
        all_chosen = len(self.selection.indices) == len(self.pool.entries)
        before = "all that were accepted" if all_chosen else "as many seconds, unchosen"
        return ReportData(
            conditioning=conditioning_comparison(self.unchosen, self.conditioning, before, "chosen motions")
        )

    def save(self, folder: Path) -> Path:
        """Write chosen and validation motions to ``motions/``, the report's arrays and ``plan.json``: all or none.

        Motions that a plan before this one wrote into the folder are removed; other files there stay.
        """
        folder = Path(folder)
        before = _written_before(folder / "plan.json")
        with all_or_nothing():
            for motion in (*self.motions, *self.validation_motions):
                save_motion(motion, folder / "motions" / f"{motion.name}.parquet")
            save_report_data(self.report_data(), folder / "report_data.npz")
            document = self.document(**robot_file(self.robot, folder))
            write_json(document.to_json(), folder / "plan.json")
        # Motions of a plan before this one are of another robot, or were chosen beside others.
        for name in before - {motion.name for motion in (*self.motions, *self.validation_motions)}:
            (folder / "motions" / f"{name}.parquet").unlink(missing_ok=True)
        return folder


def _motion_file(name: str) -> str:
    return f"motions/{name}.parquet"


def _written_before(file: Path) -> set[str]:
    """Names of the motions that a plan says it wrote; none where there is no plan, or none that can be read."""
    if not file.is_file():
        return set()
    try:
        plan = read_document(file, PlanDocument)
    except InputError:
        return set()
    return {Path(name).stem for name in (*(item.motion for item in plan.selected), *plan.validation)}
