"""Where a plan's candidates come from, generators and searches, and which motions are chosen of those that are safe."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from excite.arrays import Array
from excite.campaign.expected import TARGET_RSD, filtered_noise
from excite.campaign.optimised_series import Asked
from excite.campaign.pool import Keeper, OnDisk, Pool, write_value
from excite.campaign.searches import MIXTURE, SEARCHES
from excite.errors import NoSolutionError, NothingSafeError, UnknownNameError
from excite.excitation.conditioning import MotionFactor, motion_factor
from excite.excitation.selection import (
    Candidates,
    Selection,
    select_motions,
)
from excite.motion.generators.generator import child_seed
from excite.motion.generators.mixture import plan_proposals
from excite.motion.generators.registry import GENERATORS
from excite.motion.motion import Motion
from excite.parallel.jobs import Jobs
from excite.progress import Progress
from excite.regressor.base_parameters import BaseParameters
from excite.results import HIDDEN, Stated
from excite.robot.legs import too_soft_to_stand
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from excite.safety.filter import Filtered, filter_candidates
from excite.safety.filter_report import FilterReport
from excite.safety.refusals import Refused, joined_refusals, refusals_table, tally_refusals
from excite.safety.repairs.draft import Rejection
from excite.simulation.rehearsal import (
    FELL,
    LEAST_LOAD,
    SLIPPED,
    TOUCHED,
    UNKNOWN_LOAD,
    can_fall,
    rehearse_motions,
)

# Candidates of a plan as they are drawn and judged, turn by turn while too few are safe.

# Of a plan that nobody said the number of candidates for: how many are drawn at a time, how often at most, and how many
# motions make it stop. Random motions of the robots that come with excite are safe more often than not; of 60 others'
# models five had one or two safe candidates of six.
N_CANDIDATES, TURNS, ENOUGH = 140, 3, 3


@contextmanager
def add_seconds(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Add to the seconds of a stage what the block takes."""
    started = time.perf_counter()
    try:
        yield
    finally:
        seconds[stage] += time.perf_counter() - started


class Judged:
    """The candidates so far.

    Attributes:
        asked: for what.
        seconds: by stage of a plan [s].
    """

    def __init__(
        self, generator: str | None, asked: Asked, seed: np.random.SeedSequence, keeper: Keeper, turns: int
    ) -> None:
        self._generator, self.asked, self._seed, self._keeper = generator, asked, seed, keeper
        # A search has looked for the best already.
        self._left = 1 if generator in SEARCHES else turns
        self._turn = 0
        self._report: FilterReport | None = None
        self.seconds = dict.fromkeys(("generate", "filter", "rank", "choose"), 0.0)

    @property
    def exhausted(self) -> bool:
        """Whether no more may be drawn."""
        return self._left == 0

    def more(self) -> FilterReport:
        """Draw and judge until enough are safe in all or no more may be drawn, one turn at least.

        A user's interrupt ends it with those judged by then.
        """
        while True:
            report = self._another_turn()
            if len(report.kept) >= ENOUGH or self.exhausted:
                return report

    def _another_turn(self) -> FilterReport:
        asked = self.asked
        with add_seconds(self.seconds, "generate"):
            source = candidates_of(self._generator, asked, self._seed, self._turn)
        with add_seconds(self.seconds, "filter"):
            found = filter_candidates(
                asked.robot,
                source.candidates,
                jobs=asked.jobs,
                total=source.count,
                progress=asked.progress,
                keep=self._keeper,
                partial=True,
                robust=asked.robust,
            )
        self._report = found if self._report is None else self._report.joined(found)
        self._turn, self._left = self._turn + 1, 0 if found.interrupted else self._left - 1
        return self._report

    def refusals(self, report: FilterReport, fallen: Sequence[Rejection] = ()) -> Refusals:
        """What refuses them, in rehearsal too."""
        few = len(report.kept) - len(fallen) < _FEW * report.generated
        refused = joined_refusals(report.refused, tally_refusals(self.asked.robot, fallen))
        return Refusals(report.generated, refused, few)


# Why a plan has few motions, or none: what refuses its candidates, and what to do about it.

_ADVICE = {
    **{
        f"joint_{name}": f"raise limits.{name} of the joints named, if they bear more"
        for name in ("velocity", "acceleration", "jerk", "torque")
    },
    "self_collision": "add the pair to collision.ignored_pairs of robot.yaml, if it may touch; or state a "
    "posture.joints in which the two are further apart",
    "zmp": "state feet as large as they are, or a posture.joints whose centre of mass is well above them",
    "com": "state feet as large as they are, or a posture.joints whose centre of mass is well above them",
    "friction": "state the friction of the feet, if the ground gives more",
    "no_collision_pairs": "give every link that moves a shape: <collision> in the model, or collision.shapes",
    # To lift a foot ANYmal C shifts by 0.2 m where its feet stand 0.9 m apart, on legs of 0.5 m: none of 12 swings is
    # safe with knees at 1.0 … 1.4 rad, half of them unreachable, nor of 8 at 1.4 rad with the feet as wide. With hips
    # turned in by 0.2 rad and knees at 1.2 rad 8 of 8 are.
    "unreachable": "state a posture.joints in which the feet are nearer to one another and below the hips, the legs "
    "bent and away from their limits, or base: held",
    "joint_position": "state a posture.joints further from the limits of the joints named",
    # Of an X30 on assumed gains five sways drag its feet by 12 to 23 mm, on gains three times as stiff by 3 to 4.
    SLIPPED: "state controller.kp and kd of servos that are stiffer, under whose sag feet are dragged",
    FELL: "state limits.torque of the drives named, if they give more, and controller.kp and kd of "
    "servos that are stiffer: no feedback of balance is counted on",
    TOUCHED: "state controller.kp and kd of servos that are stiffer, or a posture.joints in which the "
    "links named are further apart",
}

# Where less than this share of the candidates is safe, what refuses the rest costs more than it leaves: it is said.
_FEW = 0.5


@dataclass(frozen=True)
class Refusals(Stated):
    """What refuses a plan's candidates.

    Attributes:
        generated: number of candidates.
        refused: by pair of links, joint, contact or limit, the commonest first.
        few: whether so few are safe that a person is told.
    """

    generated: int = field(default=0, metadata=HIDDEN)
    refused: tuple[Refused, ...] = ()
    few: bool = field(default=False, metadata=HIDDEN)

    @property
    def change(self) -> str:
        """What to do, in words."""
        first = self.refused[0].reason if self.refused else ""
        return _ADVICE.get(first, "see what refuses them")

    def table(self) -> str:
        """A few lines for a person; empty where nothing was refused."""
        return refusals_table(self.refused, self.generated)

    def summary(self) -> str:
        """The table and the change, where few candidates are safe; else empty."""
        return f"{self.table()}\nmost likely to help: {self.change}" if self.few and self.refused else ""


def none_is_safe(robot: Robot, refusals: Refusals) -> NothingSafeError:
    """The error of a plan without any safe candidate: in one line the first cause and the change."""
    cause = f": {refusals.refused[0].sentence}" if refusals.refused else ""
    n = refusals.generated
    none = "the one candidate is not safe" if n == 1 else f"none of {n} candidates is safe"
    return NothingSafeError(
        f"{none} for {robot.name}{cause}",
        best=refusals,
        remedy=refusals.change if refusals.refused else "ask for more candidates",
    )


# The candidates of a plan by the name of who makes them: a generator, a search, or the robot's mixture.


@dataclass(frozen=True, eq=False)
class Source:
    """Candidates, proposals that are drawn later, or motions that a search has finished.

    Attributes:
        candidates: each once.
        count: how many there are.
    """

    candidates: Iterable[Filtered]
    count: int


def check_generator(name: str | None) -> None:
    """Raise UnknownNameError for a name that neither a generator nor a search has, nor is the mixture's."""
    known = [*GENERATORS, *SEARCHES, MIXTURE]
    if name is not None and name not in known:
        raise UnknownNameError("generator", name, sorted(known))


def candidates_of(generator: str | None, asked: Asked, seed: np.random.SeedSequence, turn: int = 0) -> Source:
    """The candidates that a generator, a search or (None) the robot's mixture of generators makes of a seed.

    In a later ``turn`` these are as many more, as if all had been asked for at once; a search has only the first.

    Raises:
        UnknownNameError: a target is no joint of the robot.
        RobotError: the generator does not apply to the robot.
        NoSolutionError: a search found nothing.
        InputError: a search does not suit the robot, a target or a setting.
    """
    if generator is not None and generator in SEARCHES:
        found = SEARCHES.make(generator).candidates(asked, child_seed(seed, 0))
        return Source(found, len(found))
    mix = None if generator in (None, MIXTURE) else {str(generator): 1.0}
    before = turn * asked.count
    proposals = plan_proposals(
        asked.robot, before + asked.count, seed, mix=mix, targets=asked.targets, beyond=before
    )
    return Source(proposals, asked.count)


# The choice of a plan's motions: by a rule, rehearsed, and chosen again without those that fell.

# Motions kept back for cross-validation.
_N_VALIDATION = 4


@dataclass(frozen=True)
class Rule:
    """How motions are chosen.

    Attributes:
        name: in ``SELECTIONS``.
        budget_s: total duration that a greedy choice stays within [s]; as long as the best three take, if None.
        limits: by segment, the condition number that is good enough, for the choice by ``segments``.
        asked: parameters to reach, for the choice by ``targets``: see
            :func:`~excite.excitation.targets.asked_parameters`.
        target_rsd: relative standard deviation to reach with them [percent].
        before: motions that were run already, which the choice adds to where it weighs rows by their noise.
    """

    name: str
    budget_s: float | None = None
    limits: Mapping[str, float] = field(default_factory=dict)
    asked: tuple[str, ...] = ()
    target_rsd: float = TARGET_RSD
    before: tuple[Motion, ...] = ()


@dataclass(frozen=True, eq=False)
class Choice:
    """Motions that were chosen and rehearsed: indices are those of the pool.

    Attributes:
        pool: the motions that did not fall.
        selection: which of them go on.
        validation: which of the others judge the result.
        fallen: what went wrong with those that did not stand their rehearsal.
        load: that the robot carried in the rehearsal, of its mass; None of a robot that cannot fall, and where the
            user broke off before it.
        interrupted: whether the user broke off: a robot that can fall has not rehearsed them.
    """

    pool: Pool
    selection: Selection
    validation: tuple[int, ...]
    fallen: tuple[Rejection, ...]
    load: float | None
    interrupted: bool = False


Rehearsed: TypeAlias = dict[tuple[str, float], Rejection | None]
"""What became of motions in rehearsal, by name and load, so that none is rehearsed twice."""


def choose_motions(
    robot: Robot,
    pool: Pool,
    base: BaseParameters,
    rule: Rule,
    jobs: Jobs,
    progress: Progress,
    rehearsed: Rehearsed | None = None,
    *,
    interrupted: bool = False,
) -> Choice:
    """Choose motions by a rule, rehearse them, and choose again without those that fell; raises NoSolutionError.

    Where all of them fall under the load that a robot should carry, they are rehearsed with the least. What is known
    from rehearsals before stands in ``rehearsed``, and what these tell is added. Where the user broke off already, or
    does now, they are chosen without a rehearsal, and without those of which it is known that they fall.
    """
    known: Rehearsed = {} if rehearsed is None else rehearsed
    load = UNKNOWN_LOAD
    while True:
        try:
            choice = _select_standing(robot, pool, base, rule, known, load)
            if interrupted:
                return replace(choice, load=None, interrupted=True)
            names = choice.pool.names
            new = [
                i for i in (*choice.selection.indices, *choice.validation) if (names[i], load) not in known
            ]
            if not new:
                return choice
            motions = choice.pool.motions.only(new)
            outcomes = rehearse_motions(robot, motions, load=load, jobs=jobs, progress=progress)
            known.update(zip(((names[i], load) for i in new), outcomes, strict=True))
        except _AllFallError:
            if load == LEAST_LOAD:
                raise
            load = LEAST_LOAD
        except KeyboardInterrupt:
            interrupted = True


class _AllFallError(NoSolutionError):
    """No motion stands its rehearsal."""


def _select_standing(
    robot: Robot, pool: Pool, base: BaseParameters, rule: Rule, known: Rehearsed, load: float
) -> Choice:
    """What a rule selects of the motions not known to fall; raises NoSolutionError where that is nothing."""
    fallen = {name: refused for name in pool.names if (refused := known.get((name, load))) is not None}
    left = pool.without(set(fallen))
    if fallen and not left.entries:
        raise _AllFallError(
            f"all {len(fallen)} safe motions of {robot.name} fall or slip in rehearsal, with {load:.0%} of its "
            f"mass on its back: {tally_refusals(robot, fallen.values())[0].sentence}",
            best=left.motions,
            remedy=too_soft_to_stand(robot) or "ask for more candidates, or for calmer motions",
        )
    chosen = (
        select_motions(rule.name, selection_candidates(robot, left, base, rule)) if left.entries else None
    )
    if chosen is None or not chosen.indices:
        shortest = float(left.durations.min(initial=np.inf))
        too_short = rule.budget_s is not None and rule.budget_s < shortest < np.inf
        raise NoSolutionError(
            f"none of the {len(left.entries)} safe motions excites any segment of {robot.name} to full rank",
            best=left.motions,
            remedy=f"the shortest of them takes {shortest / 60.0:.2f} min: give at least that"
            if too_short
            else "ask for more candidates",
        )
    # Of those that were not chosen, generators taken in turn.
    others = [i for i in left.in_turn() if i not in chosen.indices][:_N_VALIDATION]
    carried = load if can_fall(robot) else None
    return Choice(left, chosen, tuple(sorted(others)), tuple(fallen.values()), carried)


def selection_candidates(robot: Robot, pool: Pool, base: BaseParameters, rule: Rule) -> Candidates:
    """What a rule of selection chooses from, within its bounds."""

    def weighted() -> tuple[Sequence[MotionFactor], Sequence[MotionFactor]]:
        motions, kept = pool.motions, pool.folder.path / "noise"
        if not kept.exists():
            write_value(filtered_noise(robot, motions), kept)
        noise = OnDisk[Array]((kept,), pool.folder)[0]
        files = tuple(pool.folder.path / f"{name}.weighted" for name in pool.names)
        for index, path in enumerate(files):
            # A choice without those that fell finds the others' there.
            if not path.exists():
                write_value(motion_factor(robot, motions[index], row_std=noise), path)
        before = [motion_factor(robot, motion, row_std=noise) for motion in rule.before]
        return OnDisk[MotionFactor](files, pool.folder), before

    return Candidates(
        robot=robot,
        ranking=pool.ranking,
        factors=pool.factors,
        durations=pool.durations,
        base=base,
        weighted=weighted,
        budget_s=rule.budget_s,
        limits=rule.limits,
        asked=rule.asked,
        target_rsd=rule.target_rsd,
        rows_hz=ProblemSettings().filters(floating=robot.measures_contacts).rate_hz,
    )
