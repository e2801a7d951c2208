"""A log together with its robot, and several logs of one robot joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median

from excite.errors import InputError, LogError
from excite.logs.files import load_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot, robot_for_log
from excite.robot.load import RobotLike, as_robot
from excite.robot.robot import Robot


def robot_and_log(robot: RobotLike | None, log: str | Path | Log) -> tuple[Robot, Log]:
    """The nominal robot and the log.

    Args:
        robot: the robot, its bundled name, a ``robot.yaml`` or a model; None for the one that the log names.
        log: a log folder, or a log in memory.

    Raises:
        LogError: the log is malformed, or does not fit the robot.
        RobotError: the model is malformed.
        UnknownNameError: no such robot.
        InputError: the robot is none, and no name of one.
    """
    folder = log.folder if isinstance(log, Log) else log
    if isinstance(robot, str | Path) and folder is not None:
        robot = robot_for_log(robot, folder)
    found = None if robot is None else as_robot(robot)
    loaded = log if isinstance(log, Log) else load_log(log, found)
    return found or nominal_robot(loaded), loaded


# What has to agree for trials to belong to one log.
_SAME = ("base", "gravity", "joints", "torque", "base_link", "wrench", "sensors")


def join_logs(logs: Sequence[Log]) -> Log:
    """One log with the trials of several, in order; what is of no trial comes from the first, but for the rate.

    A trial whose name occurred before is renamed ``NAME_2`` and so on, and what repeats it follows.

    Args:
        logs: of one robot, with the same joints and sensors.

    Returns:
        One log that holds the trials of all.

    Raises:
        InputError: no log.
        LogError: the logs are of different robots or channels; names the field.
    """
    if not logs:
        raise InputError("no log", remedy="hand over at least one")
    first = logs[0]
    for other in logs[1:]:
        for field in _SAME:
            if getattr(other.header, field) != getattr(first.header, field):
                raise LogError(
                    f"differs from {first.folder or 'the first log'}",
                    source=other.folder,
                    field=field,
                    remedy="identify logs of different set-ups one by one",
                )
    headers, trials, taken = [], [], set()
    rates: list[float] = []
    for log in logs:
        renamed = {}
        rates += [log.header.rate_hz] * len(log.trials)
        for trial in log.trials:
            name, number = trial.name, 2
            while name in taken:
                name, number = f"{trial.name}_{number}", number + 1
            taken.add(name)
            renamed[trial.name] = name
        for header, trial in zip(log.header.trials, log.trials, strict=True):
            suffix = header.file.rpartition(".")[2]
            repeats = renamed.get(trial.repeats, trial.repeats) if trial.repeats else None
            trials.append(replace(trial, name=renamed[trial.name], repeats=repeats))
            file = f"{renamed[trial.name]}.{suffix}"
            repeated = f"{repeats}.{suffix}" if repeats else None
            headers.append(header.model_copy(update={"file": file, "repeats": repeated}))
    # As the rate of the stamps is told, in the middle of all trials: logs of several rates are no wrong clock.
    own = {"trials": tuple(headers), "rate_hz": median(rates) if rates else first.header.rate_hz}
    return replace(first, header=first.header.model_copy(update=own), trials=tuple(trials))
