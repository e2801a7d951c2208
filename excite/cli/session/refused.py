"""A plan without any safe candidate leaves a page behind that shows why."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import excite
from excite.errors import NothingSafeError

if TYPE_CHECKING:
    from excite.robot.robot import Robot


@contextmanager
def refusals_shown(robot: Robot, folder: Path) -> Iterator[None]:
    """Write ``refusals.json`` and ``report.html`` into a folder where no candidate is safe; the error goes on."""
    try:
        yield
    except NothingSafeError as error:
        from excite.campaign.candidates.refusal import Refusals  # lazy: pinocchio

        if isinstance(error.best, Refusals):
            error.best.save(robot, folder)
            error.best = replace(error.best, page=str(excite.report(folder)))
        raise
