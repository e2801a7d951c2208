"""The verb ``plan``: generate, filter, rank, choose."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from excite.campaign import optimised
from excite.campaign.choice import Pool, choose, first_seconds
from excite.campaign.findings import conditioning_comparison, robot_file
from excite.campaign.outlook import Outlook, outlook, predictable
from excite.errors import InputError, NoSolutionError, UnknownNameError
from excite.excitation.conditioning import Conditioning, MotionFactor, conditioning, motion_factor
from excite.excitation.selection import Selection, check_selection
from excite.json_document import write_json
from excite.motion.files import save_motion
from excite.motion.generators.generator import child_seed
from excite.motion.generators.registry import GENERATORS, plan_candidates
from excite.motion.motion import Motion
from excite.progress import Progress, silent
from excite.regressor.base_parameters import structural_base_parameters
from excite.report.data import ReportData, save_report_data
from excite.robot.robot import Robot
from excite.safety.filter import FilterReport, filter_candidates

SCHEMA = "excite.plan/1"

# Reason for which a motion is refused that topples the robot in simulation.
FELL = "fell_in_rehearsal"


@dataclass(frozen=True, eq=False)
class Plan:
    """Motions that were found safe and chosen because they excite the parameters.

    Attributes:
        robot: the robot.
        generated: number of candidates.
        rejected: by reason, how many candidates the filter refused.
        accepted: every accepted motion, in the order of the candidates.
        factors: R factor of each accepted motion.
        selection: which of them go on, and for which segments.
        validation: accepted motions that were not chosen and that judge the result, as indices.
        conditioning: of the chosen motions together.
        unchosen: conditioning of as many seconds of accepted motions taken as they come, for comparison.
        stages: seconds by stage.
    """

    robot: Robot
    generated: int
    rejected: Mapping[str, int]
    accepted: tuple[Motion, ...]
    factors: tuple[MotionFactor, ...]
    selection: Selection
    validation: tuple[int, ...]
    conditioning: Conditioning
    unchosen: Conditioning
    stages: Mapping[str, float]

    @property
    def motions(self) -> tuple[Motion, ...]:
        """The chosen motions."""
        return tuple(self.accepted[i] for i in self.selection.indices)

    @property
    def validation_motions(self) -> tuple[Motion, ...]:
        """Motions for cross-validation, not among the chosen ones."""
        return tuple(self.accepted[i] for i in self.validation)

    @property
    def chosen_factors(self) -> tuple[MotionFactor, ...]:
        """R factors of the chosen motions."""
        return tuple(self.factors[i] for i in self.selection.indices)

    @cached_property
    def outlook(self) -> Outlook | None:
        """What the chosen motions promise for each base parameter; None where the sensors' noise is not stated."""
        return outlook(self.robot, self.motions) if predictable(self.robot) else None

    @property
    def duration_s(self) -> float:
        """Duration of the chosen motions together [s]."""
        return sum(motion.duration for motion in self.motions)

    def to_json(self) -> dict[str, Any]:
        """The ``excite.plan/1`` document."""
        return {
            "schema": SCHEMA,
            "robot": self.robot.name,
            "candidates": {
                "generated": self.generated,
                "accepted": len(self.accepted),
                "rejected": dict(sorted(self.rejected.items())),
            },
            "selected": [
                {
                    "motion": f"motions/{item.motion}.parquet",
                    "segments": list(item.segments),
                    "duration_s": self.accepted[item.index].duration,
                }
                for item in self.selection.selected
            ],
            "validation": [f"motions/{motion.name}.parquet" for motion in self.validation_motions],
            "conditioning": dict(self.conditioning.to_json()),
            "base_parameters": []
            if self.outlook is None
            else [parameter.to_json() for parameter in self.outlook.parameters],
            "stages": [{"stage": stage, "seconds": seconds} for stage, seconds in self.stages.items()],
        }

    def summary(self) -> str:
        """A few lines for a person."""
        refused = ", ".join(f"{count} {reason}" for reason, count in sorted(self.rejected.items())) or "none"
        lines = [
            f"{self.robot.name}: {len(self.accepted)} of {self.generated} candidates accepted (refused: {refused})",
            f"{len(self.motions)} motions chosen, {self.duration_s:.0f} s in total",
            f"chosen:   {self.conditioning.summary()}",
            f"unchosen: {self.unchosen.summary()}",
        ]
        if self.outlook is not None:
            lines.append(self.outlook.summary())
        if self.selection.unserved:
            lines.append("excited by no single motion: " + ", ".join(self.selection.unserved))
        return "\n".join(lines)

    def report_data(self) -> ReportData:
        """What the report shows beside the JSON."""
        return ReportData(
            conditioning=conditioning_comparison(
                self.unchosen, self.conditioning, "as many seconds, unchosen", "chosen motions"
            )
        )

    def save(self, folder: Path) -> Path:
        """Write the chosen and the validation motions to ``motions/``, the report's arrays, last ``plan.json``."""
        folder = Path(folder)
        for motion in (*self.motions, *self.validation_motions):
            save_motion(motion, folder / "motions" / f"{motion.name}.parquet")
        save_report_data(self.report_data(), folder / "report_data.npz")
        write_json({**self.to_json(), **robot_file(self.robot, folder)}, folder / "plan.json")
        return folder


def plan(
    robot: Robot,
    *,
    n_candidates: int = 140,
    targets: Sequence[str] = (),
    generator: str | None = None,
    selection: str = "best_three",
    seed: int | np.random.SeedSequence = 0,
    prefix: str = "",
    jobs: int = 1,
    progress: Progress = silent,
) -> Plan:
    """Plan excitation motions (Jovic et al. 2015, section II.B).

    What is chosen was found safe by the independent check, and stood its rehearsal in simulation.

    Args:
        robot: the robot.
        n_candidates: how many candidate motions to generate.
        targets: joints to aim at; all, if empty.
        generator: the only one to use: a name of the registry, or ``optimised_fourier``, of which each candidate
            is a start of the search; None for the robot's mixture.
        selection: ``best_three`` motions of every segment; or, in as many seconds, greedily those of greatest
            ``log_det`` (log-determinant) or least ``rsd`` (sum of predicted relative standard deviations).
        seed: of all random numbers.
        prefix: put before the name of every motion.
        jobs: number of processes; the plan does not depend on it.
        progress: told as work proceeds.

    Returns:
        The plan.

    Raises:
        NoSolutionError: no candidate was accepted; the error says why they were refused.
        UnknownNameError: a target is no joint of the robot, or the generator or the selection is unknown.
        InputError: fewer than one candidate asked for.
    """
    if n_candidates < 1:
        raise InputError(f"{n_candidates} candidates", field="n_candidates", remedy="ask for at least one")
    check_selection(selection)
    root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    started = time.perf_counter()
    if generator == optimised.NAME:
        number = child_seed(root, 0)
        candidates = optimised.optimised_candidates(robot, n_candidates, number, jobs=jobs, progress=progress)
    else:
        if generator is not None and generator not in GENERATORS:
            raise UnknownNameError("generator", generator, sorted([*GENERATORS, optimised.NAME]))
        mix = None if generator is None else {generator: 1.0}
        candidates = plan_candidates(robot, n_candidates, root, mix=mix, targets=targets)
    generated = time.perf_counter()
    report: FilterReport = filter_candidates(robot, candidates, jobs=jobs, progress=progress)
    filtered = time.perf_counter()
    if not report.motions:
        refused = ", ".join(f"{count} {reason}" for reason, count in sorted(report.rejected.items()))
        raise NoSolutionError(
            f"none of {n_candidates} candidates is safe for {robot.name} ({refused})",
            best=report,
            remedy="see which limit refuses them, or ask for more candidates",
        )
    accepted = tuple(motion.renamed(prefix + motion.name) for motion in report.motions)
    base = structural_base_parameters(robot)
    pool = Pool(accepted, _factors(robot, accepted, progress))
    ranked = time.perf_counter()
    choice = choose(robot, pool, base, selection, jobs, progress)
    pool = choice.pool
    indices = choice.selection.indices
    chosen = conditioning(robot, [pool.factors[i] for i in indices], base)
    seconds = sum(pool.motions[i].duration for i in indices)
    unchosen = conditioning(robot, [pool.factors[i] for i in first_seconds(pool.motions, seconds)], base)
    rejected = {**report.rejected, FELL: choice.fallen} if choice.fallen else report.rejected
    finished = time.perf_counter()
    return Plan(
        robot=robot,
        generated=len(candidates),
        rejected=rejected,
        accepted=pool.motions,
        factors=pool.factors,
        selection=choice.selection,
        validation=choice.validation,
        conditioning=chosen,
        unchosen=unchosen,
        stages={
            "generate": generated - started,
            "filter": filtered - generated,
            "rank": ranked - filtered,
            "choose": finished - ranked,
        },
    )


def _factors(robot: Robot, motions: Sequence[Motion], progress: Progress) -> tuple[MotionFactor, ...]:
    factors = []
    for done, motion in enumerate(motions, start=1):
        factors.append(motion_factor(robot, motion))
        progress("rank", done, len(motions))
    return tuple(factors)
