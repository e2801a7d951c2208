"""What documents of plans share: where the robot is described, condition numbers, all of a campaign's as one."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from excite.documents.plan import CandidateCounts, PlanDocument, Stage
from excite.excitation.conditioning import Conditioning
from excite.report.comparisons import ConditioningComparison
from excite.robot.catalogue import data_folder
from excite.robot.load import keep_description
from excite.robot.robot import Robot


def robot_file(robot: Robot, folder: Path) -> dict[str, Any]:
    """Where a robot of one's own is described, relative to a results folder; nothing for a bundled robot.

    The first description of a bare model is kept there.
    """
    if robot.source.resolve().is_relative_to(data_folder("robots").resolve()):
        return {}
    return {
        "robot_file": os.path.relpath(
            keep_description(robot, folder).source.resolve(), Path(folder).resolve()
        )
    }


def conditioning_comparison(
    before: Conditioning, after: Conditioning, before_label: str, after_label: str
) -> ConditioningComparison:
    """Condition numbers of two sets of motions, side by side."""
    return ConditioningComparison(
        segments=tuple(segment.segment for segment in after.segments),
        before=np.array([segment.condition for segment in before.segments]),
        after=np.array([segment.condition for segment in after.segments]),
        full_before=before.full,
        full_after=after.full,
        before_label=before_label,
        after_label=after_label,
    )


def merged_plan(robot: Robot, plans: Sequence[PlanDocument], together: Conditioning) -> PlanDocument:
    """One ``excite.plan/1`` document for all iterations, paths relative to the campaign's folder."""
    folders = [f"iteration_{number}/" for number in range(1, len(plans) + 1)]
    parts = list(zip(folders, plans, strict=True))
    rejected: Counter[str] = Counter()
    stages: dict[str, float] = {}
    for plan in plans:
        rejected.update(plan.candidates.rejected)
        for one in plan.stages:
            stages[one.stage] = stages.get(one.stage, 0.0) + one.seconds
    return PlanDocument(
        robot=robot.name,
        candidates=CandidateCounts(
            sum(plan.candidates.generated for plan in plans),
            sum(plan.candidates.accepted for plan in plans),
            dict(sorted(rejected.items())),
        ),
        selected=tuple(
            replace(one, motion=folder + one.motion) for folder, plan in parts for one in plan.selected
        ),
        conditioning=together,
        stages=tuple(Stage(*stage) for stage in stages.items()),
        validation=tuple(folder + one for folder, plan in parts for one in plan.validation),
        assumed=tuple(robot.description.assumed),
    )
