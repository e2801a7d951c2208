"""The log doctor: faults of a record that are no physics, found before anything is fitted, repaired where sound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from excite.doctor.case import KINDS, Case
from excite.doctor.channel_errors import OF_TORQUES, OF_WRENCHES
from excite.doctor.channel_mapping import Reading
from excite.doctor.checks.channels import (
    find_misreadings,
    find_scales_set_aside,
    find_unexplained_torques,
    find_zeroed_torques,
    put_weight_back,
)
from excite.doctor.checks.clock import (
    find_counted_rows,
    find_held_rows,
    find_jitter,
    find_rate,
    find_velocity_errors,
)
from excite.doctor.checks.motion import (
    find_beyond_limits,
    find_command_errors,
    find_degrees,
    find_jumps,
    find_standing,
    find_too_few_rows,
    find_unison,
    find_whole_turns,
)
from excite.doctor.checks.values import (
    find_coarse_steps,
    find_constants,
    find_missing_friction,
    find_motor_side,
    find_range_ends,
    find_stopped_torques,
    find_torque_ends,
    find_unsigned_torques,
    find_weak_torques,
    set_clipped_aside,
)
from excite.doctor.doubt import Doubt
from excite.doctor.mistakes.torques import take_weight
from excite.doctor.thresholds import THRESHOLD
from excite.errors import IllLogError
from excite.finding import Examination, merge_findings, worst_first
from excite.logs.files import save_log
from excite.logs.load_with_robot import robot_and_log
from excite.logs.log import Log
from excite.progress import step
from excite.results import HIDDEN
from excite.robot.load import RobotLike
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread

# In the order in which they are asked: rows, clock, units, channels, then what these say. Each finds what it is for in
# what those before have left of the log, and repairs it where that is sound.
RULES: tuple[Callable[[Case], None], ...] = (
    find_counted_rows,
    find_held_rows,
    find_rate,
    find_jitter,
    find_whole_turns,
    find_coarse_steps,
    find_range_ends,
    set_clipped_aside,
    find_degrees,
    find_constants,
    find_stopped_torques,
    find_standing,
    find_jumps,
    find_velocity_errors,
    find_zeroed_torques,
    find_unsigned_torques,
    find_misreadings,
    find_weak_torques,
    find_motor_side,
    find_missing_friction,
    find_scales_set_aside,
    find_torque_ends,
    find_unexplained_torques,
    find_beyond_limits,
    find_command_errors,
    find_unison,
    find_too_few_rows,
)
FOUND = frozenset({*KINDS, *(mistake.name for mistake in (*OF_TORQUES, *OF_WRENCHES))})
"""All kinds of findings in a log."""


@dataclass(frozen=True, eq=False, repr=False)
class Chart(Examination):
    """What the doctor found and made of a log.

    Attributes:
        log: the log, repaired where that is sound.
        doubts: what the log tells only about, repaired or not.
    """

    log: Log = field(kw_only=True, metadata=HIDDEN)
    doubts: frozenset[Doubt] = field(default=frozenset(), metadata=HIDDEN)

    @property
    def usable(self) -> bool:
        """Whether anything can be told from the log."""
        return all(finding.severity != "fatal" or finding.repaired for finding in self.findings)

    def check_usable(self) -> None:
        """Raise IllLogError with the findings, worst first, where no rule could save the log."""
        if self.usable:
            return
        worst = [finding for finding in self.findings if finding.severity != "note" and not finding.repaired]
        said = "; ".join(f"{finding.text}: {finding.remedy}" for finding in worst)
        source = None if self.log.folder is None else self.log.folder / "log.yaml"
        raise IllLogError(said, source=source, findings=worst)

    def summary(self) -> str:
        """One finding a paragraph, worst first, and which log holds what was repaired."""
        found = super().summary()
        if self.healthy:
            return found
        last = "identify and diagnose make the same repairs"
        return f"{found}\n{last if self.repaired is None else f'repaired log written to {self.repaired}'}"


@one_blas_thread
@step("look the log through")
def examine(
    robot: Robot, log: Log, settings: ProblemSettings | None = None, *, latest_s: float = THRESHOLD.late_s
) -> Chart:
    """Look a log through with every rule, one after the other.

    Args:
        robot: the nominal model.
        log: the log.
        settings: torque constants that the log does not state; none if None.
        latest_s: torques that are less late than this are left so [s]: whoever asks finds their delay along.

    Returns:
        The repaired log and the findings.
    """
    case = Case(robot, log, latest_s=latest_s)
    if settings is not None:
        constants = {**log.header.torque_constants, **settings.drive_gains}
        case.change_header(torque_constants=constants)
    for find in RULES:
        find(case)
    found = worst_first(merge_findings(tuple(case.findings)))
    return Chart(robot.name, found, log=case.log, doubts=frozenset(case.doubts))


def doctor(
    log: str | Path | Log, robot: RobotLike | None = None, *, repair: str | Path | None = None
) -> Chart:
    """Look a log through for what is no physics: rows, clock, units, signs, order, zeros, channels.

    ``identify`` and ``diagnose`` do the same before they begin, and say the same.

    Args:
        log: a log folder, or a log in memory.
        robot: the nominal model, or what :func:`~excite.robot.load.load_robot` takes; by default the one that the
            log names.
        repair: folder that the log is written to with everything repaired that could be, the nominal weight added where
            a driver has taken it off the torques; none is without it.

    Returns:
        The repaired log and the findings, worst first.

    Raises:
        LogError: the log is malformed, or ``repair`` holds something that is no log.
        RobotError: the nominal model is malformed.
    """
    nominal, loaded = robot_and_log(robot, log)
    chart = examine(nominal, loaded)
    if repair is not None:
        taken_off = any(found.kind == "compensated" and found.repaired for found in chart.findings)
        if taken_off and not any(chart.log.header.gravity):
            case = Case(nominal, chart.log, list(chart.findings))
            put_weight_back(case, take_weight(Reading.as_stated(loaded), np.array(loaded.header.gravity)))
            chart = replace(chart, log=case.log, findings=tuple(case.findings))
        save_log(chart.log, repair)
        chart = replace(chart, repaired=str(repair))
    return chart
