"""Where a plan's candidates come from: generators that draw them one by one, and searches for all of them at once."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from excite.campaign.optimised_series import Asked
from excite.campaign.pool import Keeper
from excite.campaign.searches import SEARCHES
from excite.errors import NothingSafeError, UnknownNameError
from excite.motion.generators.generator import child_seed
from excite.motion.generators.mixture import plan_proposals
from excite.motion.generators.registry import GENERATORS
from excite.results import HIDDEN, Stated
from excite.robot.robot import Robot
from excite.safety.filter import Filtered, filter_candidates
from excite.safety.filter_report import FilterReport
from excite.safety.refusals import Refused, joined_refusals, refusals_table, tally_refusals
from excite.safety.repairs.draft import Rejection
from excite.simulation.rehearsal import FELL, SLIPPED, TOUCHED

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
    """Raise UnknownNameError for a name that neither a generator nor a search has; None is the robot's mixture."""
    known = [*GENERATORS, *SEARCHES]
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
    mix = None if generator is None else {generator: 1.0}
    before = turn * asked.count
    proposals = plan_proposals(
        asked.robot, before + asked.count, seed, mix=mix, targets=asked.targets, beyond=before
    )
    return Source(proposals, asked.count)
