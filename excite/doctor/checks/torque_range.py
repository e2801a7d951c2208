"""Torques at an end of their range: left out where they say less than there was, kept where the drive gave no more."""

from __future__ import annotations

from dataclasses import replace

from excite.doctor.check import Check, Outcome
from excite.doctor.torque_rails import kind_of_torque, torque_overshoot
from excite.finding import Finding, list_names
from excite.logs.log import Log, Trial
from excite.robot.robot import Robot

# Deviations of what the model leaves elsewhere by which the motion asks for more than the rail, up to which it agrees
# with it. Of UR10, Panda and iiwa with nothing hidden, a payload or a spring, torques of drives at their limits were
# -0.7 to 1.2, those clipped in 2 % of the rows 2.7 to 57 and in more of them more.
_AGREES = 1.75
# Share of a torque's samples within its range from which it says something of its joint: with 6 % of them a UR10's
# payload had its mass to 1 %, and with fewer the filter leaves next to no rows.
_LEAST = 0.05


class TorqueRange(Check):
    """Torques, or currents, at the largest or smallest value that they have."""

    kinds = ("clipped", "drive_limit")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        rows = {joint: _marked(log, joint) for joint in log.header.torque_joints}
        rows = {joint: count for joint, count in rows.items() if count}
        if not rows:
            return Outcome(log)
        told = not log.header.free_base and robot.mechanism is None and not log.header.coupling
        beyond = {joint: torque_overshoot(robot, log, joint) if told else None for joint in rows}
        held = [joint for joint, times in beyond.items() if times is not None and times <= _AGREES]
        lost = [joint for joint in rows if joint not in held]
        marked, log = log, replace(log, trials=tuple(_without(trial, log, held) for trial in log.trials))
        samples = sum(len(trial.time) for trial in log.trials)
        silent = [joint for joint in lost if samples - rows[joint] < _LEAST * samples]
        kind, findings = kind_of_torque(log), []
        if held:
            said = list_names([f"{kind}.{joint} in {rows[joint]} rows" for joint in held])
            findings.append(
                Finding(
                    "drive_limit",
                    f"{said}: at the drive's limit, as the motion agrees with no more torque",
                    {"rows": float(sum(rows[joint] for joint in held))},
                    tuple(f"{kind}.{joint}" for joint in held),
                    remedy="nothing: these rows are as good as others",
                    trials=_trials(marked, held),
                )
            )
        for joints, taken in ((lost, False), (silent, True)):
            joints = [joint for joint in joints if taken or joint not in silent]
            if not joints:
                continue
            said = list_names([f"{kind}.{joint} in {rows[joint]} of {samples} rows" for joint in joints])
            how = "they are taken as no_torque" if taken else "these rows of their joints are left out"
            findings.append(
                Finding(
                    "clipped",
                    f"{said}: clipped at the sensor's range, as the torque was larger than that; {how}",
                    {"rows": float(sum(rows[joint] for joint in joints))},
                    tuple(f"{kind}.{joint}" for joint in joints),
                    severity="limits",
                    remedy="move slower or carry less, or raise the range; what lies beyond is lost",
                    trials=_trials(marked, joints),
                )
            )
        if silent:
            header = log.header.model_copy(update={"no_torque": (*log.header.no_torque, *silent)})
            log = replace(log, header=header)
        return Outcome(log, tuple(findings))


def _column(log: Log, joint: str) -> int:
    return log.header.joints.index(joint)


def _marked(log: Log, joint: str) -> int:
    """Rows in which a joint's torque is at an end of its range."""
    j = _column(log, joint)
    return sum(int(trial.beyond[:, j].sum()) for trial in log.trials if trial.beyond is not None)


def _trials(log: Log, joints: list[str]) -> tuple[str, ...]:
    columns = [_column(log, joint) for joint in joints]
    return tuple(t.name for t in log.trials if t.beyond is not None and t.beyond[:, columns].any())


def _without(trial: Trial, log: Log, joints: list[str]) -> Trial:
    """The trial with the marks of some joints taken off."""
    if trial.beyond is None or not joints:
        return trial
    flags = trial.beyond.copy()
    flags[:, [_column(log, joint) for joint in joints]] = False
    return replace(trial, beyond=flags if flags.any() else None)
