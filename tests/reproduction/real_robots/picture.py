"""Pictures of the page: torque measured on a trial that was not fitted, and predicted before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.atomic import atomic_path
from excite.diagnosis.arm.diagnose import judge_record
from excite.diagnosis.arm.record import TorqueRecord
from excite.diagnosis.equations.units import force_unit
from excite.doctor.examine import examine
from excite.logs.log import Log
from excite.report.theme import IDENTIFIED, INK, NOMINAL, draw_figure, to_png
from excite.robot.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LONGEST_S = 10.0
_HEIGHT_IN = 1.5


@dataclass(frozen=True, eq=False)
class Curves:
    """Torques of one joint on a validation trial.

    Attributes:
        joint: its name.
        unit: N·m, or N where it slides.
        time: ``(n,)`` [s].
        measured: ``(n,)`` filtered as in the diagnosis; so are the others.
        before: ``(n,)`` with the baseline.
        after: ``(n,)`` with all accepted effects.
    """

    joint: str
    unit: str
    time: Array
    measured: Array
    before: Array
    after: Array


def with_torques(log: Log) -> Log:
    """A log of currents as one of torques, by the torque constants that it states."""
    if log.header.torque != "current":
        return log
    constants = np.array([log.header.torque_constants[joint] for joint in log.header.joints])
    header = log.header.model_copy(update={"torque": "motor_side"})
    trials = [
        replace(t, tau=t.current * constants, current=None) for t in log.trials if t.current is not None
    ]
    return replace(log, header=header, trials=tuple(trials))


def curves(robot: Robot, log: Log, joints: Sequence[str]) -> list[Curves]:
    """What the steps of a diagnosis predict on its first validation trial."""
    log = with_torques(log)
    judged = judge_record(TorqueRecord(robot, examine(robot, log).log, log.header.modelled))
    samples, baseline, found = judged.samples, judged.baseline, judged.attribution
    trial = next(k for k, t in enumerate(samples.trials) if not t.identification)
    rows = samples.trial_of_row == trial
    time = samples.trials[trial].time[samples.trials[trial].rows]
    tau = samples.to_rows([t.tau for t in samples.trials])[rows]
    before, after = (
        samples.without_slip_weights(baseline.plain_residual(fit.residual))[:, rows]
        for fit in (found.baseline.fit, found.final.fit)
    )
    shown = time - time[0] <= _LONGEST_S
    made = []
    for joint in joints:
        j = samples.joints.index(joint)
        values = (tau[:, j], tau[:, j] - before[j], tau[:, j] - after[j])
        made.append(
            Curves(joint, force_unit(robot, joint), time[shown] - time[0], *(v[shown] for v in values))
        )
    return made


def plot(shown: Sequence[Curves]) -> Figure:
    """One panel a joint."""

    def paint(figure: Figure) -> None:
        panels = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, item in zip(panels, shown, strict=True):
            axes.plot(item.time, item.measured, color=INK.light, linewidth=1.4, label="measured")
            axes.plot(
                item.time, item.before, color=NOMINAL.light, linewidth=0.9, linestyle="--", label="before"
            )
            axes.plot(item.time, item.after, color=IDENTIFIED.light, linewidth=0.9, label="after")
            axes.set_title(f"{item.joint} [{item.unit}]")
        panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.0)
        panels[-1].set_xlabel("time on the trial left out [s]")

    return draw_figure(paint, _HEIGHT_IN * len(shown) + 0.4, width_in=7.2)


def write_picture(path: Path, robot: Robot, log: Log, joints: Sequence[str]) -> None:
    """Draw what a diagnosis of a log predicts of some joints."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(to_png(plot(curves(robot, log, joints)), dpi=80))
