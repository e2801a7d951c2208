"""What a campaign has done so far, on disk, so that it can be interrupted and resumed.

Each iteration has a folder, ``iteration_1`` …, with ``plan.json``, ``motions/`` and ``log/``. Every one of
them appears only when it is complete, so that what is there can be relied on.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from excite.campaign.expected import TARGET_RSD, check_target
from excite.campaign.plan import BUDGETS_S, MAX_CANDIDATES
from excite.documents.document import model_of, read_document
from excite.documents.plan import PlanDocument
from excite.errors import InputError, LogError
from excite.formats.number import check_count, check_number, check_seed
from excite.identification.estimators.registry import DEFAULT_METHOD, find_estimator
from excite.logs.files import load_log
from excite.logs.log import Log
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.results import LEFT_OUT, Name, Positive, Stated, write_json
from excite.robot.robot import Robot

_ANEW = "put back what was there, or start the campaign anew"


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
    document: PlanDocument


@dataclass(frozen=True)
class Journal:
    """The folder of a campaign.

    Attributes:
        folder: the campaign's ``--out``.
    """

    folder: Path

    def settings(self) -> CampaignSettings:
        """What the campaign in the folder was asked for; raises InputError where there is none."""
        begun, path = self._begun()["settings"], self.folder / "journal.json"
        try:
            return CampaignSettings(**begun)
        except InputError as error:
            field = f"settings.{error.field}" if error.field else "settings"
            raise InputError(error.what, source=path, field=field, remedy=error.remedy) from error

    def _begun(self) -> dict[str, Any]:
        path = self.folder / "journal.json"
        if not os.path.lexists(path):
            raise InputError("no campaign to resume", source=path, remedy="start one without --resume")
        stated = read_document(path, model_of(BegunCampaign), remedy=_ANEW).stated()
        # Which command wrote it is nothing that a campaign has to go on with.
        return {name: value for name, value in stated.items() if name != "made"}

    def open(self, robot: Robot, settings: CampaignSettings, *, resume: bool) -> None:
        """Begin a campaign in the folder, or go on with the one that is there.

        Raises:
            InputError: a campaign is there and ``resume`` is False; or the one there is of another robot or
                other settings; or there is none to resume.
        """
        path = self.folder / "journal.json"
        begun = BegunCampaign(robot.hash, settings).to_json()
        if not resume:
            if os.path.lexists(path):
                raise InputError(
                    "a campaign is there already", source=path, remedy="give --resume, or another --out"
                )
            write_json(begun, path)
            return
        found = self._begun()
        if _only_longer(found, begun):
            # What was done so far does not depend on how often it may go on.
            write_json(begun, path)
            return
        for key, value in begun.items():
            if found.get(key) != value:
                raise InputError(
                    f"the campaign there was started with {_describe_difference(found.get(key), value)}",
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
        """Motions of an iteration that was planned before, None if it was not.

        Raises:
            InputError: its folder is not what a campaign has left there.
            MotionError: a motion in it cannot be read or is not of this robot.
        """
        folder = _iteration_folder(self.iteration(number))
        path = folder / "plan.json"
        if not os.path.lexists(path):
            later = self.iteration(number + 1)
            if os.path.lexists(later):
                raise InputError(f"is missing, while {later.name} is there", source=path, remedy=_ANEW)
            return None
        plan = read_document(path, PlanDocument, remedy=_ANEW)
        chosen = [item.motion for item in plan.selected]
        _check_motions(chosen, plan.validation, number, path)
        return PlannedMotions(
            chosen=_load_motions_of(folder, chosen, robot),
            validation=_load_motions_of(folder, plan.validation, robot),
            document=plan,
        )

    def logged(self, number: int, robot: Robot, motions: Sequence[Motion] | None = None) -> Log | None:
        """Log of an iteration, None if there is none yet.

        Args:
            number: of the iteration, counted from 1.
            robot: the robot.
            motions: what its trials are of; None where recordings have names of their own.

        Raises:
            LogError: it cannot be read, does not fit the robot, or holds a trial of another motion.
        """
        folder = _iteration_folder(self.log_folder(number))
        if not os.path.lexists(folder / "log.yaml"):
            return None
        log = load_log(folder, robot)
        names = {motion.name for motion in motions or ()}
        for trial in log.trials:
            if motions is not None and trial.name not in names:
                raise LogError(
                    f"{trial.name} is none of the motions of {folder.parent.name}",
                    source=folder / "log.yaml",
                    field="trials",
                    remedy=_ANEW,
                )
        return log


def _iteration_folder(path: Path) -> Path:
    if os.path.lexists(path) and not path.is_dir():
        raise InputError("is a file, not a folder", source=path, remedy=_ANEW)
    return path


def _check_motions(chosen: Sequence[str], validation: Sequence[str], number: int, path: Path) -> None:
    """Every motion stands once and was planned in this iteration, which its name says."""
    if not chosen:
        raise InputError("names no motion", source=path, field="selected", remedy=_ANEW)
    names = Counter(Path(motion).stem for motion in (*chosen, *validation))
    for place, motions in (("selected", chosen), ("validation", validation)):
        for motion in motions:
            name = Path(motion).stem
            if names[name] > 1:
                raise InputError(f"{motion!r} stands twice", source=path, field=place, remedy=_ANEW)
            if not name.startswith(motion_prefix(number)):
                what = f"{motion!r} was not planned in iteration {number}"
                raise InputError(what, source=path, field=place, remedy=_ANEW)


def motion_prefix(number: int) -> str:
    """What the names of an iteration's motions begin with."""
    return f"i{number}_"


def _load_motions_of(folder: Path, names: Sequence[str], robot: Robot) -> tuple[Motion, ...]:
    return tuple(load_motion(folder / name, robot) for name in names)


def _only_longer(found: dict[str, Any], begun: dict[str, Any]) -> bool:
    """Whether a campaign is to go on for more iterations than it was begun with, and all else is the same."""
    before, asked = found.get("settings"), begun["settings"]
    if not isinstance(before, dict) or {**found, "settings": None} != {**begun, "settings": None}:
        return False
    more = asked["max_iterations"] > before.get("max_iterations", asked["max_iterations"])
    return more and {**before, "max_iterations": 0} == {**asked, "max_iterations": 0}


def _describe_difference(found: Any, asked: Any) -> str:
    if isinstance(found, dict) and isinstance(asked, dict):
        for name, value in asked.items():
            if found.get(name) != value:
                return f"{name} {found.get(name)!r}, not {value!r}"
    return f"{str(found)[:12]!r}, not {str(asked)[:12]!r}"


# What a campaign is asked for.

# Each iteration is a day of recording.
_MOST_ITERATIONS = 1000


@dataclass(frozen=True)
class CampaignSettings(Stated):
    """Settings of a campaign; a resumed one has to have the same.

    Attributes:
        n_candidates: candidate motions in the first iteration; later ones, which aim at few joints, get a quarter.
        target_rsd: relative standard deviation that essential base parameters have to reach [percent].
        max_iterations: iterations at most.
        method: registry name of the estimator.
        seed: of all random numbers.
        on_robot: stop after each plan, so that the motions are recorded on a real robot.
        minutes: of motion for identification in each iteration [min]. What the first is expected to reach is aimed at,
            and the others are for what of that it then does not. None for as much as the best motions of every joint
            take, and for all essential parameters.
    """

    n_candidates: int = 140
    target_rsd: Positive = TARGET_RSD
    max_iterations: int = 3
    method: Name = DEFAULT_METHOD
    seed: int = 0
    on_robot: bool = False
    minutes: Positive | None = field(default=None, metadata=LEFT_OUT)

    def __post_init__(self) -> None:
        """Check the bounds and the method; raises InputError naming the setting, or UnknownNameError."""
        check_count(self.n_candidates, "n_candidates", 1, MAX_CANDIDATES)
        check_count(self.max_iterations, "max_iterations", 1, _MOST_ITERATIONS)
        check_seed(self.seed)
        find_estimator(self.method)
        check_target(self.target_rsd)
        if self.minutes is not None:
            check_number(60.0 * self.minutes, "minutes", *BUDGETS_S, "s")


@dataclass(frozen=True)
class BegunCampaign(Stated):
    """The robot and the settings that a campaign was begun with.

    Attributes:
        robot_hash: hash of the robot's files.
        settings: what the campaign was asked for.
    """

    SCHEMA = "excite.journal/1"

    robot_hash: Name
    settings: CampaignSettings
