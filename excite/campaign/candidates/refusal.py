"""Why a plan has few motions, or none: what refuses its candidates, and the change that lets most of them pass."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from excite.campaign.candidates.search import Asked
from excite.campaign.plan_document import robot_file
from excite.campaign.rehearsal import FELL, SLIPPED, TOUCHED
from excite.errors import NothingSafeError
from excite.json_document import write_json
from excite.motion.generators.candidate import Candidate
from excite.motion.generators.proposal import Proposal
from excite.robot.robot import Robot
from excite.safety.filter_report import FilterReport
from excite.safety.refusals import Refused, joined_refusals, refusals_table, tally_refusals
from excite.safety.remedy import TRIED, Remedy, find_remedy
from excite.safety.repairs.draft import Rejection

SCHEMA = "excite.refusals/1"
REFUSALS_FILE = "refusals.json"

# What to do about refusals that no limit lifted takes away, and that no candidate was tried again without.
_ADVICE = {
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


class FirstOf:
    """Candidates as they are read, of which the first are remembered, so that refused ones can be tried again."""

    # Among these are as many refused ones as are tried, where few are safe.
    _HELD = 64

    def __init__(self) -> None:
        self.held: list[Candidate | Proposal] = []

    def reading(self, candidates: Iterable[Candidate | Proposal]) -> Iterator[Candidate | Proposal]:
        """The candidates, once; others may be read after them."""
        for candidate in candidates:
            if len(self.held) < self._HELD:
                self.held.append(candidate)
            yield candidate


@dataclass(frozen=True)
class Refusals:
    """What refuses a plan's candidates.

    Attributes:
        generated: number of candidates.
        refused: by pair of links, joint, contact or limit, the commonest first.
        few: whether so few are safe that a person is told.
        remedy: the change with which most of the refused ones pass, None where there is none or enough are safe.
        page: where pictures of the worst are, None where nobody has drawn them.
    """

    generated: int = 0
    refused: tuple[Refused, ...] = ()
    few: bool = False
    remedy: Remedy | None = None
    page: str | None = None

    def save(self, robot: Robot, folder: Path) -> Path:
        """Write ``refusals.json`` into a folder, for a report of a plan without any motion."""
        document = {
            "schema": SCHEMA,
            "robot": robot.name,
            "generated": self.generated,
            **self.to_json(),
            "assumed": [one.model_dump() for one in robot.description.assumed],
            **robot_file(robot, folder),
        }
        return write_json(document, folder / REFUSALS_FILE)

    def to_json(self) -> dict[str, Any]:
        """The fields ``refused`` and ``remedy`` of a document."""
        return {
            "refused": [item.to_json() for item in self.refused],
            "remedy": None if self.remedy is None else self.remedy.to_json(),
        }

    @property
    def change(self) -> str:
        """What to do, in words."""
        first = self.refused[0].reason if self.refused else ""
        if self.remedy is not None:
            # It was tried on candidates that the filter refused, not on what fell afterwards.
            return (
                f"{_ADVICE[first]}; {self.remedy}" if first in (FELL, SLIPPED, TOUCHED) else str(self.remedy)
            )
        return _ADVICE.get(
            first,
            "see what refuses them: no single limit lifted lets any of those pass that were tried again",
        )

    def table(self) -> str:
        """A few lines for a person; empty where nothing was refused."""
        lines = [refusals_table(self.refused, self.generated)]
        if self.page is not None:
            lines.append(f"pictures of the worst: {self.page}")
        return "\n".join(line for line in lines if line)

    def summary(self) -> str:
        """The table and the change, where few candidates are safe; else empty."""
        return f"{self.table()}\nmost likely to help: {self.change}" if self.few and self.refused else ""


def refusals_of(
    asked: Asked, report: FilterReport, first: FirstOf, fallen: Sequence[Rejection] = ()
) -> Refusals:
    """What refuses a plan's candidates, those that do not stand their rehearsal too; where few are safe, changes are
    tried on some that the filter refused, unless the user broke off."""
    few = len(report.kept) - len(fallen) < _FEW * report.generated
    remedy = None
    if few and not report.interrupted:
        again = [first.held[index] for index in report.first_refused if index < len(first.held)]
        remedy = find_remedy(asked.robot, report.refused, again[:TRIED], jobs=asked.jobs, robust=asked.robust)
    refused = joined_refusals(report.refused, tally_refusals(asked.robot, fallen))
    return Refusals(report.generated, refused, few, remedy)


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
