"""The log doctor: faults of a record that are no physics, found before anything is fitted, repaired where sound."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.doctor.channel_mapping import Reading
from excite.doctor.check import Check, Outcome
from excite.doctor.checks.channels import Channels
from excite.doctor.checks.clock import CountedRows, HeldRows, Stamps, StatedRate, Velocities
from excite.doctor.checks.motion import Amount, Commands, Degrees, Jumps, Limits, Standing, Unison, WholeTurns
from excite.doctor.checks.torques import TorqueRange, TorqueSide, WeakTorques, at_rails, kind_of_torque
from excite.doctor.doubt import Doubt
from excite.doctor.inertial_prior import LEAST_GAIN, STRONG_ODDS, Judgement
from excite.doctor.torque_samples import torque_samples
from excite.errors import IllLogError
from excite.finding import Examination, Finding, list_names, merge_findings, worst_first
from excite.logs.log import Log, Trial
from excite.progress import step
from excite.results import HIDDEN
from excite.robot.prismatic import is_prismatic
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread


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
        """Raise IllLogError with the findings, worst first, where no check could save the log."""
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
        last = "what is said to be repaired is so for identify and diagnose, too"
        return f"{found}\n{last if self.repaired is None else f'repaired log written to {self.repaired}'}"


@one_blas_thread
@step("look the log through")
def examine(robot: Robot, log: Log, settings: ProblemSettings | None = None) -> Chart:
    """Look a log through with every check, one after the other, each on what those before have repaired.

    Args:
        robot: the nominal model.
        log: the log.
        settings: coupling and torque constants that the log does not state; none if None.

    Returns:
        The repaired log and the findings.
    """
    findings: list[Finding] = []
    doubts: set[Doubt] = set()
    if settings is not None:
        log = _as_set(log, settings)
    for check in CHECKS:
        outcome = check.examine(robot, log)
        log = outcome.log
        findings += outcome.findings
        doubts |= outcome.doubts
    found = worst_first(merge_findings(tuple(findings)))
    return Chart(robot.name, found, log=log, doubts=frozenset(doubts))


def _as_set(log: Log, settings: ProblemSettings) -> Log:
    """The log with what the settings say of its drives."""
    constants = {**log.header.torque_constants, **settings.drive_gains}
    coupling = settings.coupling or log.header.coupling
    update = {"torque_constants": constants, "coupling": coupling}
    return replace(log, header=log.header.model_copy(update=update))


# Trials to learn from and to judge by that are not of the same machine.

# Below this share of a torque's power nothing needs a second machine.
_MUCH = 0.05


class OtherMachine(Check):
    """Likely bodies and drives that explain the trials to learn from explain those to judge by as well."""

    kinds = ("other_machine",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        if log.header.free_base or log.header.torque in {None, "none"}:
            return Outcome(log)
        judges = tuple(trial.name for trial in log.role("validation"))
        learnt = log.role("identification")
        found = _apart(robot, log, learnt, log.role("validation"))
        if found is None:
            return Outcome(log)
        worse, much = found
        if not _are_worse(worse, much).any():
            return Outcome(log)
        # What no model has sets the trials of one machine apart as well, by their postures; where these are too
        # short to see how far, nothing is known of another machine.
        usual = [_apart(robot, log, first, second) for first, second in _halves(learnt)]
        if all(one is None for one in usual):
            return Outcome(log)
        for one in usual:
            worse = worse if one is None else np.minimum(worse, found[0] - np.maximum(one[0], 0.0))
        bad = _are_worse(worse, much)
        if not bad.any():
            return Outcome(log)
        names = tuple(np.array(log.header.torque_joints)[bad])
        text = (
            f"what the trials to learn from say of {list_names(names)} does not hold in the trials to "
            "judge by: another "
            "machine, another load, channels put together otherwise, or something that acts in their postures alone, "
            "such as a stop"
        )
        finding = Finding(
            "other_machine",
            text,
            {"worse_nat": float(worse.sum())},
            names,
            severity="spoils",
            sure=0.8,
            remedy="compare robots, loads and settings of the recordings",
            trials=judges,
        )
        return Outcome(log, (finding,))


def _are_worse(worse: Array, much: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Torques that one machine explains less well, and all together too; odds alone part records of one KUKA LWR."""
    return (worse > LEAST_GAIN) & much & (worse.sum() > LEAST_GAIN)


def _halves(trials: tuple[Trial, ...]) -> tuple[tuple[tuple[Trial, ...], tuple[Trial, ...]], ...]:
    """Trials parted by their order, and by turns; of a trial alone its quarters."""
    if len(trials) == 1:
        (whole,) = trials
        parts = np.array_split(np.arange(whole.n_samples), 4)
        trials = tuple(replace(whole.rows(rows), name=f"{whole.name}_{k}") for k, rows in enumerate(parts))
    middle = len(trials) // 2
    return ((trials[:middle], trials[middle:]), (trials[::2], trials[1::2]))


def _apart(
    robot: Robot, log: Log, first: tuple[Trial, ...], second: tuple[Trial, ...]
) -> tuple[Array, NDArray[np.bool_]] | None:
    """By how much one set of bodies and drives for all leaves more than one a part [nat], and where it leaves much.

    Of the torques it leaves much of, only those count whose odds for two sets are strong for so many torques.
    """
    left = [_left(robot, log, trials) for trials in (first, second, (*first, *second))]
    if any(values is None for values in left):
        return None
    one, other, together = (found for found in left if found is not None)
    worse = together.left - 0.5 * (one.left + other.left)
    strong = together.counts * worse > STRONG_ODDS + np.log(len(worse))
    return worse, (together.left > 0.5 * np.log(_MUCH)) & strong


def _left(robot: Robot, log: Log, trials: tuple[Trial, ...]) -> Judgement | None:
    """What likely bodies leave of some trials; None where there is nothing to look at."""
    chosen = replace(log, trials=tuple(replace(trial, role="identification") for trial in trials))
    samples = torque_samples(robot, chosen) if trials else None
    return None if samples is None else samples.judged(Reading.as_stated(log))


# What sensors do to values: ranges that are reached, coarse steps, channels that never change.

# Ends of one range agree by this share of what a joint moves in all trials: sensors that are clipped read one number,
# turns of different motions differ by tenths.
_SAME_END = 0.002


class Range(Check):
    """Values that stay at the largest or smallest that the channel has."""

    kinds = ("clipped",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        rows: dict[str, int] = {}
        for trial in log.trials:
            for name, count in trial.cleaning.clipped.items():
                rows[name] = rows.get(name, 0) + count
        torque = kind_of_torque(log) + "."
        marked = at_rails(log)
        # Of torques the motion says more, once their columns and units are right (TorqueRange).
        rows = {
            name: count
            for name, count in rows.items()
            if not (name.startswith(torque) and marked is not log) and not _sticks(log, name)
        }
        if not rows:
            return Outcome(marked)
        said = list_names([f"{name} in {count} rows" for name, count in rows.items()])
        finding = Finding(
            "clipped",
            f"{said}: clipped at the sensor's range or the drive's limit",
            {"rows": float(sum(rows.values()))},
            tuple(rows),
            severity="limits",
            remedy="move slower or carry less, or raise the range; what lies beyond is lost",
            trials=tuple(trial.name for trial in log.trials if set(rows) & set(trial.cleaning.clipped)),
        )
        return Outcome(marked, (finding,))


def _sticks(log: Log, name: str) -> bool:
    """Whether a position stays where dry friction held its joint as it turned back, in each trial elsewhere.

    The end of a sensor's range, or a stop, is at one place in all trials. An arm with 1.3 N·m of dry friction at an
    elbow and encoders of 14 bits stood still at its turns, left them at speed, and was said to be clipped.
    """
    channel, _, joint = name.partition(".")
    if channel != "q" or joint not in log.header.joints or len(log.trials) < 2:
        return False
    place = log.header.joints.index(joint)
    values = [trial.q[:, place] for trial in log.trials]
    top, bottom = max(q.max() for q in values), min(q.min() for q in values)
    near = _SAME_END * (top - bottom)
    ends = []
    for trial, q in zip(log.trials, values, strict=True):
        if name in trial.cleaning.clipped:
            step = 0.5 * trial.cleaning.quantised.get(name, 0.0)
            above = np.sum(q >= q.max() - step) >= np.sum(q <= q.min() + step)
            ends.append((above, (top - q.max() if above else q.min() - bottom) <= near))
    return max(ends.count((True, True)), ends.count((False, True))) < 2


def _unit(robot: Robot, log: Log, channel: str) -> str:
    """Unit of a channel of a joint with a blank before it; nothing of others, whose units differ from part to part."""
    kind, _, joint = channel.partition(".")
    turns = joint in robot.joint_names and not is_prismatic(
        robot.model, robot.n_base_v + robot.joint_index(joint)
    )
    units = {"q": "rad", "q_cmd": "rad", "v": "rad/s", "tau": "N·m", "i": "A"}
    return f" {units[kind]}" if turns and kind in units else ""


class Steps(Check):
    """Values on a grid that is coarser than the noise."""

    kinds = ("quantised",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        sizes: dict[str, float] = {}
        for trial in log.trials:
            sizes |= trial.cleaning.quantised
        if not sizes:
            return Outcome(log)
        said = list_names([f"{name} {size:.3g}{_unit(robot, log, name)}" for name, size in sizes.items()])
        finding = Finding(
            "quantised",
            f"values come in steps: {said}; a coarse sensor, or few digits in the file",
            {f"step_{name}": size for name, size in sizes.items()},
            tuple(sizes),
            severity="note",
            remedy="write all digits, or filter more; velocities of slow motion are not to be had from coarse steps",
            trials=tuple(trial.name for trial in log.trials if trial.cleaning.quantised),
        )
        return Outcome(log, (finding,))


class Constant(Check):
    """Channels that never change over the whole log; a torque that does not is declared to mean nothing."""

    kinds = ("constant", "no_torques")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        header = log.header
        if unforced(log):
            lost = Finding(
                "no_torques",
                "no torque, no current and no command was recorded: nothing tells what moved the joints",
                {"channels": 0.0},
                severity="fatal",
                remedy="record torques or currents (tau.*, i.*), or at least the commanded positions (q_cmd.*)",
            )
            return Outcome(log, (lost,))
        dead, torques = [], []
        for attribute, prefix in (("tau", "tau"), ("current", "i"), ("q", "q")):
            values = [getattr(trial, attribute) for trial in log.trials]
            if any(value is None for value in values):
                continue
            still = np.all([np.ptp(value, axis=0) == 0.0 for value in values], axis=0)
            for name, flag in zip(header.joints, still, strict=True):
                if flag and not (name in header.no_torque and prefix != "q"):
                    dead.append(f"{prefix}.{name}")
                    torques += [name] if prefix != "q" else []
        for sensor in header.sensors:
            readings = [trial.wrenches[sensor.name] for trial in log.trials if sensor.name in trial.wrenches]
            if readings and all(np.ptp(reading) == 0.0 for reading in readings):
                dead.append(f"wrench.{sensor.name}")
        if not dead:
            return Outcome(log)
        return self._said(log, tuple(dead), tuple(torques))

    def _said(self, log: Log, dead: tuple[str, ...], torques: tuple[str, ...]) -> Outcome:
        text = (
            f"{list_names(dead)} never change: a dead channel, or a joint that was locked; its "
            "parameters say nothing"
        )
        figures = {"channels": float(len(dead))}
        silent = tuple(dict.fromkeys((*log.header.no_torque, *torques)))
        if torques and len(silent) == len(log.header.joints):
            lost = Finding(
                "no_torques",
                f"no torque changes at all ({list_names(dead)})",
                figures,
                dead,
                severity="fatal",
                remedy="record the torques or currents, or state torque: none",
            )
            return Outcome(log, (lost,))
        finding = Finding(
            "constant",
            text,
            figures,
            dead,
            severity="spoils" if torques or dead[0].startswith("wrench") else "limits",
            repaired=bool(torques) and len(torques) == len(dead),
            remedy="joints whose torque never changes are taken as no_torque"
            if torques
            else "check the channel",
        )
        header = log.header.model_copy(update={"no_torque": silent})
        return Outcome(replace(log, header=header) if torques else log, (finding,))


def unforced(log: Log) -> bool:
    """Whether a log of a robot that does not move about says nothing of what moved it: positions alone."""
    header = log.header
    placed = header.base in ("fixed", "held") and not header.sensors
    return placed and all(t.tau is None and t.current is None and t.q_cmd is None for t in log.trials)


# All checks of a log, in the order in which they are made: rows, clock, units, channels, then what they say.

CHECKS: tuple[Check, ...] = (
    CountedRows(),
    HeldRows(),
    StatedRate(),
    Stamps(),
    WholeTurns(),
    Steps(),
    Range(),
    Degrees(),
    Constant(),
    Standing(),
    Jumps(),
    Velocities(),
    Channels(),
    WeakTorques(),
    TorqueSide(),
    TorqueRange(),
    Limits(),
    Commands(),
    Unison(),
    Amount(),
    OtherMachine(),
)
