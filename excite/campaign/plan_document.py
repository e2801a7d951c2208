"""What documents of plans share: where the robot is described, condition numbers, all of a campaign's as one."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from excite.excitation.conditioning import Conditioning
from excite.report.comparisons import ConditioningComparison
from excite.robot.catalogue import data_folder
from excite.robot.load import keep_description
from excite.robot.robot import Robot


def robot_file(robot: Robot, folder: Path) -> dict[str, str]:
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


def merged_plan(robot: Robot, documents: Sequence[dict[str, Any]], together: Conditioning) -> dict[str, Any]:
    """One ``excite.plan/1`` document for all iterations, paths relative to the campaign's folder."""
    rejected: dict[str, int] = {}
    stages: dict[str, float] = {}
    selected, validation = [], []
    for number, document in enumerate(documents, start=1):
        folder = f"iteration_{number}/"
        for reason, count in document["candidates"]["rejected"].items():
            rejected[reason] = rejected.get(reason, 0) + count
        for stage in document["stages"]:
            stages[stage["stage"]] = stages.get(stage["stage"], 0.0) + stage["seconds"]
        selected += [{**item, "motion": folder + item["motion"]} for item in document["selected"]]
        validation += [folder + item for item in document.get("validation", [])]
    return {
        "schema": documents[0]["schema"],
        "robot": robot.name,
        "candidates": {
            "generated": sum(document["candidates"]["generated"] for document in documents),
            "accepted": sum(document["candidates"]["accepted"] for document in documents),
            "rejected": dict(sorted(rejected.items())),
        },
        "selected": selected,
        "validation": validation,
        "conditioning": dict(together.to_json()),
        "stages": [{"stage": stage, "seconds": seconds} for stage, seconds in stages.items()],
    }
