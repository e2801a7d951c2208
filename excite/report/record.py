"""The log that a result was made from, where it still lies where the result says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from excite.errors import ExciteError
from excite.logs.files import load_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot, robot_for_log
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Record:
    """A log and its robot.

    Attributes:
        robot: the nominal robot.
        log: the log.
    """

    robot: Robot
    log: Log

    def trial(self, name: str = "") -> Trial:
        """The trial of that name, else the first that judges, else the first."""
        named = [trial for trial in self.log.trials if trial.name == name]
        return (named or self.log.role("validation") or self.log.trials)[0]


def read_record(folder: Path, document: dict[str, Any]) -> Record | str | None:
    """The record that a document names: why it cannot be had, or None where it names none.

    Args:
        folder: of the document.
        document: its content, with ``log_file`` and ``robot_file``.
    """
    named = document.get("log_file")
    if not named:
        return None
    try:
        robot = document.get("robot_file")
        if robot:
            return Record(robot_for_log(folder / robot, folder / named), load_log(folder / named))
        log = load_log(folder / named)
        return Record(nominal_robot(log), log)
    except ExciteError as error:
        return str(error)
    except OSError as error:
        return f"{named[:60]}: cannot be read ({error.strerror})"
