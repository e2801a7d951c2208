"""What planned motions are for: to identify from, or to validate on, as the plan beside them says."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from excite.documents.document import read_document
from excite.documents.plan import Plan

Role = Literal["identification", "validation"]


def planned_roles(paths: Iterable[Path]) -> dict[str, Role]:
    """Roles of motions by their names, from the ``plan.json`` in or above their folders; empty where there is none."""
    found: dict[str, Role] = {}
    for folder in dict.fromkeys(
        f for path in paths for f in (Path(path), *Path(path).absolute().parents[:2])
    ):
        file = folder / "plan.json"
        if not file.is_file():
            continue
        plan = read_document(file, Plan)
        found |= {Path(item.motion).stem: "identification" for item in plan.selected}
        found |= {Path(item).stem: "validation" for item in plan.validation}
    return found
