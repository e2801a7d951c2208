"""What refuses candidates: by pair of links, joint, contact or limit, how many, and the worst of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from excite.results import Name, Stated
from excite.robot.prismatic import sliding_joints
from excite.robot.robot import Robot
from excite.safety.repairs.draft import Rejection
from excite.safety.repairs.time_scaling import SPEED_SHARE
from excite.safety.verdict import Verdict, Violation, unit_of

# Refusals that a summary lists; the documents have all.
_LISTED = 5
_SMALLER_IS_WORSE = frozenset(
    "self_collision zmp com weight_share foot_below_ground rate_too_low robust_joint_torque robust_zmp "
    "robust_friction".split()
)


@dataclass(frozen=True)
class Refused(Stated):
    """One thing that refuses candidates.

    Attributes:
        reason: what is violated, such as ``self_collision`` or ``joint_torque``.
        where: pair of links, joint, foot or contact.
        candidates: how many candidates it refuses; one that breaks several limits is counted with each.
        worst: the value furthest from its limit, None where there is no number.
        limit: what it must not pass, same unit.
        unit: of both; empty where there is none.
        time_s: when the worst happens in its motion [s], None where it has no time.
        candidate: whose the worst is.
    """

    reason: Name
    where: str
    candidates: int
    worst: float | None
    limit: float | None
    unit: str = ""
    time_s: float | None = None
    candidate: str = ""

    @property
    def excess(self) -> float:
        """How far the worst is beyond its limit."""
        if self.worst is None or self.limit is None:
            return float("-inf")
        if self.reason == "joint_position":
            return abs(self.worst - self.limit)
        below = self.unit == SPEED_SHARE or (
            self.reason in _SMALLER_IS_WORSE and self.unit != "of its weight"
        )
        return self.limit - self.worst if below else self.worst - self.limit

    @property
    def sentence(self) -> str:
        """How many candidates it refuses, and what it is."""
        return f"{self.candidates} {'is' if self.candidates == 1 else 'are'} refused by {self}"

    def __str__(self) -> str:
        text = f"{self.reason} of {self.where}"
        if self.worst is not None and self.limit is not None:
            text += f": {self.worst:.3g} {self.unit}".rstrip() + f" (limit {self.limit:.3g})"
        return text if self.time_s is None else f"{text} at {self.time_s:.2f} s"


class RefusalTally:
    """Counts refusals as outcomes come: memory grows with what refuses, never with the number of candidates."""

    def __init__(self, robot: Robot) -> None:
        self._sliding = sliding_joints(robot)
        self._found: dict[tuple[str, str], Refused] = {}

    def add(self, rejection: Rejection, verdict: Verdict | None) -> None:
        """Count one refused candidate, once for each thing that refuses it."""
        seen: dict[tuple[str, str], Refused] = {}
        for found in self._causes(rejection, verdict):
            known = seen.get((found.reason, found.where))
            if known is None or found.excess > known.excess:
                seen[found.reason, found.where] = found
        _count(self._found, seen.values())

    def refused(self) -> tuple[Refused, ...]:
        """All that refuses, the commonest first."""
        return _commonest_first(self._found.values())

    def _causes(self, rejection: Rejection, verdict: Verdict | None) -> Iterable[Refused]:
        if verdict is None or not verdict.violations:
            reason, where = (
                rejection.reason.removeprefix("check_"),
                rejection.where.removeprefix("transfer, "),
            )
            yield self._refused(reason, where, rejection, rejection.candidate, rejection.unit)
            return
        for item in verdict.violations:
            where = item.where
            if item.kind == "self_collision":
                # Shapes are named after their links and numbered.
                where = " - ".join(name.rsplit("_", 1)[0] for name in where.split(" - "))
            yield self._refused(item.kind, where, item, rejection.candidate)

    def _refused(
        self, reason: str, where: str, found: Violation | Rejection, candidate: str, unit: str | None = None
    ) -> Refused:
        unit = unit or unit_of(reason, where, self._sliding)
        return Refused(reason, where, 1, found.value, found.limit, unit, found.time_s, candidate)


def tally_refusals(robot: Robot, rejections: Iterable[Rejection]) -> tuple[Refused, ...]:
    """What refuses candidates of which no verdict says more, the commonest first."""
    tally = RefusalTally(robot)
    for rejection in rejections:
        tally.add(rejection, None)
    return tally.refused()


def joined_refusals(one: Iterable[Refused], other: Iterable[Refused]) -> tuple[Refused, ...]:
    """What refuses either of two sets of candidates, the commonest first."""
    found: dict[tuple[str, str], Refused] = {}
    _count(found, (*one, *other))
    return _commonest_first(found.values())


def _count(found: dict[tuple[str, str], Refused], more: Iterable[Refused]) -> None:
    """Count more refusals; of two of the same kind the worse stands, with the number of candidates of both."""
    for item in more:
        key = item.reason, item.where
        known = found.get(key)
        if known is not None:
            worse = item if item.excess > known.excess else known
            item = replace(worse, candidates=known.candidates + item.candidates)
        found[key] = item


def _commonest_first(found: Iterable[Refused]) -> tuple[Refused, ...]:
    return tuple(sorted(found, key=lambda item: (-item.candidates, item.reason, item.where)))


def refusals_table(refused: Iterable[Refused], generated: int) -> str:
    """A few lines for a person: how many candidates each refuses, and the worst; empty where nothing does."""
    items = tuple(refused)
    lines = [f"{item.candidates:>6} of {generated}  {item}" for item in items[:_LISTED]]
    if len(items) > _LISTED:
        lines.append(f"        and {len(items) - _LISTED} more")
    return "\n".join(["refused by (the worst of each):", *lines]) if lines else ""
