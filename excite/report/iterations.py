"""Plans and checks of a campaign's iterations as one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

Document = dict[str, Any]


@dataclass(frozen=True)
class Part:
    """A document of one iteration.

    Attributes:
        folder: the iteration's folder, relative to the campaign's.
        document: its contents.
    """

    folder: str
    document: Document


def merge_plans(parts: Sequence[Part]) -> Document | None:
    """One ``excite.plan/1`` document: counts added up, motions in order, paths relative to the campaign.

    Condition numbers do not add up: they are kept where there is one iteration and left out otherwise.
    """
    if not parts:
        return None
    rejected: Counter[str] = Counter()
    stages: Counter[str] = Counter()
    for part in parts:
        rejected.update(part.document["candidates"]["rejected"])
        for entry in part.document.get("stages", ()):
            stages[entry["stage"]] += entry["seconds"]
    merged = dict(parts[0].document)
    merged["candidates"] = {
        "generated": sum(part.document["candidates"]["generated"] for part in parts),
        "accepted": sum(part.document["candidates"]["accepted"] for part in parts),
        "rejected": dict(rejected),
    }
    merged["selected"] = [
        entry | {"motion": f"{part.folder}/{entry['motion']}"}
        for part in parts
        for entry in part.document["selected"]
    ]
    merged["stages"] = [{"stage": stage, "seconds": seconds} for stage, seconds in stages.items()]
    if len(parts) > 1:
        merged.pop("conditioning", None)
    return merged


def merge_checks(parts: Sequence[Part]) -> Document | None:
    """One ``excite.check/1`` document of all iterations' motions."""
    if not parts:
        return None
    motions = [motion for part in parts for motion in part.document["motions"]]
    return dict(parts[0].document) | {
        "safe": all(part.document["safe"] for part in parts),
        "motions": motions,
    }
