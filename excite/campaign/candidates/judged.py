"""Candidates of a plan as they are drawn and judged, turn by turn while too few are safe."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from excite.campaign.candidates.refusal import FirstOf, Refusals, refusals_of
from excite.campaign.candidates.registry import SEARCHES
from excite.campaign.candidates.search import Asked
from excite.campaign.candidates.source import candidates_of
from excite.campaign.pool import Keeper
from excite.safety.filter import filter_candidates
from excite.safety.filter_report import FilterReport
from excite.safety.repairs.draft import Rejection

# Of a plan that nobody said the number of candidates for: how many are drawn at a time, how often at most, and how many
# motions make it stop. Random motions of the robots that come with excite are safe more often than not; of 60 others'
# models five had one or two safe candidates of six.
N_CANDIDATES, TURNS, ENOUGH = 140, 3, 3


class Judged:
    """The candidates so far.

    Attributes:
        asked: for what.
        seconds: by stage, ``generate`` and ``filter`` [s].
    """

    def __init__(
        self, generator: str | None, asked: Asked, seed: np.random.SeedSequence, keeper: Keeper, turns: int
    ) -> None:
        self._generator, self.asked, self._seed, self._keeper = generator, asked, seed, keeper
        # A search has looked for the best already.
        self._left = 1 if generator in SEARCHES else turns
        self._first, self._turn = FirstOf(), 0
        self._report: FilterReport | None = None
        self.seconds = {"generate": 0.0, "filter": 0.0}

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
        robot, jobs, progress = self.asked.robot, self.asked.jobs, self.asked.progress
        started = time.perf_counter()
        source = candidates_of(self._generator, self.asked, self._seed, self._turn)
        generated = time.perf_counter()
        read = self._first.reading(source.candidates)
        found = filter_candidates(
            robot,
            read,
            jobs=jobs,
            total=source.count,
            progress=progress,
            keep=self._keeper,
            partial=True,
            robust=self.asked.robust,
        )
        self._report = found if self._report is None else self._report.joined(found)
        self._turn, self._left = self._turn + 1, 0 if found.interrupted else self._left - 1
        self.seconds["generate"] += generated - started
        self.seconds["filter"] += time.perf_counter() - generated
        return self._report

    def refusals(self, report: FilterReport, fallen: Sequence[Rejection] = ()) -> Refusals:
        """What refuses them, in rehearsal too; where few are safe, changes are tried on some."""
        started = time.perf_counter()
        found = refusals_of(self.asked, report, self._first, fallen)
        self.seconds["filter"] += time.perf_counter() - started
        return found
