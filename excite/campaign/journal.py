"""What a campaign has done so far, on disk, so that it can be interrupted and resumed.

Each iteration has a folder, ``iteration_1`` …, with ``plan.json``, ``motions/`` and ``log/``. Every one of
them appears only when it is complete, so that what is there can be relied on.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from excite.campaign.settings import CampaignSettings
from excite.errors import InputError
from excite.json_document import write_json
from excite.logs.files import load_log
from excite.logs.log import Log
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.robot import Robot

SCHEMA = "excite.journal/1"


@dataclass(frozen=True, eq=False)
class PlannedMotions:
    """The motions of one iteration.

    Attributes:
        chosen: to be identified from.
        validation: to be judged by.
        document: the iteration's ``plan.json``.
    """

    chosen: tuple[Motion, ...]
    validation: tuple[Motion, ...]
    document: dict[str, Any]


@dataclass(frozen=True)
class Journal:
    """The folder of a campaign.

    Attributes:
        folder: the campaign's ``--out``.
    """

    folder: Path

    def open(self, robot: Robot, settings: CampaignSettings, *, resume: bool) -> None:
        """Begin a campaign in the folder, or go on with the one that is there.

        Raises:
            InputError: a campaign is there and ``resume`` is False; or the one there is of another robot or
                other settings; or there is none to resume.
        """
        path = self.folder / "journal.json"
        begun = {"schema": SCHEMA, "robot_hash": robot.hash, "settings": settings.to_json()}
        if not resume:
            if path.exists():
                raise InputError(
                    "a campaign is there already", source=path, remedy="give --resume, or another --out"
                )
            write_json(begun, path)
            return
        if not path.is_file():
            raise InputError("no campaign to resume", source=path, remedy="start one without --resume")
        found = _read_json(path)
        for key, value in begun.items():
            if found.get(key) != value:
                raise InputError(
                    f"the campaign there was started with {_difference(found.get(key), value)}",
                    source=path,
                    field=key,
                    remedy="resume it with the same robot and options",
                )

    def iteration(self, number: int) -> Path:
        """Folder of an iteration, counted from 1."""
        return self.folder / f"iteration_{number}"

    def log_folder(self, number: int) -> Path:
        """Folder of an iteration's log."""
        return self.iteration(number) / "log"

    def planned(self, number: int, robot: Robot) -> PlannedMotions | None:
        """Motions of an iteration that was planned before, None if it was not; raises MotionError, InputError."""
        folder = self.iteration(number)
        if not (folder / "plan.json").is_file():
            return None
        document = _read_json(folder / "plan.json")
        return PlannedMotions(
            chosen=_load(folder, [item["motion"] for item in document["selected"]], robot),
            validation=_load(folder, document.get("validation", []), robot),
            document=document,
        )

    def logged(self, number: int, robot: Robot) -> Log | None:
        """Log of an iteration, None if there is none yet; raises LogError."""
        folder = self.log_folder(number)
        return load_log(folder, robot) if (folder / "log.yaml").is_file() else None


def _load(folder: Path, names: Sequence[str], robot: Robot) -> tuple[Motion, ...]:
    return tuple(load_motion(folder / name, robot) for name in names)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            f"cannot be read ({error})", source=path, remedy="start the campaign anew"
        ) from error


def _difference(found: Any, asked: Any) -> str:
    if isinstance(found, dict) and isinstance(asked, dict):
        for name, value in asked.items():
            if found.get(name) != value:
                return f"{name} {found.get(name)!r}, not {value!r}"
    return f"{str(found)[:12]!r}, not {str(asked)[:12]!r}"
