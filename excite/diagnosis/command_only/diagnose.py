"""The diagnosis of a log without torque: what its servo must have asked for, and closed-loop simulation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from excite.atomic import write_text
from excite.diagnosis.arm import diagnose_arm, diagnose_torques
from excite.diagnosis.attribution import Attribution
from excite.diagnosis.baseline import Baseline
from excite.diagnosis.command_only.confirmation import confirmed, position_gap, with_twin
from excite.diagnosis.command_only.cycle import cycle_time, later
from excite.diagnosis.command_only.gains import known_servo
from excite.diagnosis.command_only.servo import Servo, Signals, read_signals
from excite.diagnosis.command_only.tracking import Tracking, tracking
from excite.diagnosis.doctor import Chart, examine
from excite.diagnosis.result import Diagnosis, Rollout
from excite.diagnosis.rollout_compare import MODEL, compared
from excite.diagnosis.rollout_drives import Drive, PositionServo
from excite.diagnosis.rollout_windows import Plan
from excite.diagnosis.samples import arm_samples
from excite.errors import InputError
from excite.identification.kinematics import trial_rate
from excite.logs.log import Log, Trial
from excite.logs.signals.resample import is_uniform, resample_smooth, uniform_grid
from excite.robot.robot import Array, Robot

_HORIZON_S = 2.0
# Effects of the torque channel alone: a log without that channel has none of them.
_CHANNEL = ("time_delay",)


@dataclass(eq=False)
class _Closed:
    """Closed-loop roll-outs, and what the result needs of them afterwards.

    Attributes:
        servo: the servo.
        signals: by trial.
        out: folder for the augmented model.
        rollout: the comparison once it is made.
        deviation: ``(n_joints,)`` standard deviation of the positions in identification trials [rad].
        floor: ``(n_joints,)`` what repeated trials, or the encoders' noise, leave [rad].
        order: joints in the log's order.
        cycle_s: how much later than asked for the torque acts [s].
        tracking: steady errors of the servo.
    """

    servo: Servo
    signals: dict[str, Signals]
    out: Path | None
    rollout: Rollout | None = None
    deviation: Array | None = None
    floor: Array | None = None

    def __call__(self, attribution: Attribution, baseline: Baseline) -> Rollout:
        """Make the roll-outs."""
        samples = baseline.samples
        order = [self.order.index(joint) for joint in samples.joints]
        self.tracking = tracking(attribution.final, self.servo, self.signals, order)
        q = samples.stacked("q")[:, list(samples.index)]
        inside = np.concatenate([np.full(len(t.time), t.identification) for t in samples.trials])
        self.deviation = np.maximum(q[inside].std(axis=0), 1e-9)
        self.floor = _position_floor(baseline)
        drives: dict[str, Drive] = {t.name: self._drive(samples.joints, t.name) for t in samples.trials}
        shortest = min(float(t.time[-1]) for t in samples.trials)
        plan = Plan(min(_HORIZON_S, 0.4 * shortest), drives, "q_cmd")
        try:
            rollout, xml = compared(attribution, baseline, plan)
        except InputError as error:
            self.rollout = Rollout({}, {}, _HORIZON_S, None, "q_cmd", (f"no roll-outs: {error}",))
            return self.rollout
        if self.out is not None:
            self.out.mkdir(parents=True, exist_ok=True)
            write_text(self.out / MODEL, xml)
            rollout = replace(rollout, model=MODEL)
        self.rollout = rollout
        return rollout

    def _drive(self, joints: tuple[str, ...], name: str) -> PositionServo:
        s, servo = self.signals[name], self.servo
        order = [self.order.index(joint) for joint in joints]
        return PositionServo(
            time=s.time - s.time[0],
            q_cmd=s.commanded.value[:, order],
            v_cmd=servo.damping_share * s.commanded.first[:, order],
            # Of the position's and the velocity's error the cycle is a small share; the feedforward is late by it.
            feedforward=later(s.time, s.feedforward(servo.feedforward)[:, order], self.cycle_s),
            kp=servo.kp[order],
            kd=servo.kd[order],
        )

    order: tuple[str, ...] = ()
    cycle_s: float = 0.0
    tracking: Tracking | None = None


def diagnose_commands(robot: Robot, log: Log, rng: np.random.Generator, out: Path | None = None) -> Diagnosis:
    """Diagnose a log of a fixed-base arm that has commands and no torques.

    The torque that the servo must have asked for follows from its gains and from what it saw; effects are fitted
    to that torque, then judged on closed-loop roll-outs of the validation trials, in which the gap is stated.
    Where every trial has ``tau_cmd``, what the servo asked for is known: those are the torques.

    Args:
        robot: the nominal model.
        log: the log, with an identification trial.
        rng: of the bootstrap.
        out: folder for the augmented simulator.

    Returns:
        The diagnosis.

    Raises:
        LogError: no commands, gains neither stated nor to be had.
    """
    if all(trial.tau_cmd is not None for trial in log.trials):
        return _asked(robot, log, rng, out)
    chart = examine(robot, log)
    trials = tuple(_evened(log, t) for t in chart.trials)
    signals = {t.name: read_signals(robot, log, t) for t in trials}
    fitted = {t.name: signals[t.name] for t in trials if t.role == "identification"}
    servo = known_servo(robot, log, fitted)
    modelled = (*log.header.modelled, *_CHANNEL)
    asked = tuple(replace(t, tau=signals[t.name].torque(servo)) for t in trials)
    cycle = cycle_time(arm_samples(robot, log, asked), modelled)
    asked = tuple(replace(t, tau=later(t.time, signals[t.name].torque(servo), cycle)) for t in trials)
    closed = _Closed(servo, signals, out, order=log.header.joints, cycle_s=cycle)
    chart = Chart(asked, chart.faults, chart.warnings)
    result = diagnose_torques(robot, log, chart, modelled, rng, closed, out)
    return _judged(result, closed)


def _asked(robot: Robot, log: Log, rng: np.random.Generator, out: Path | None) -> Diagnosis:
    """The diagnosis from commanded torques."""
    header = log.header.model_copy(update={"torque": "motor_side"})
    trials = tuple(replace(trial, tau=trial.tau_cmd, tau_cmd=None) for trial in log.trials)
    result = diagnose_arm(robot, replace(log, header=header, trials=trials), rng, out)
    said = (
        "torques are tau_cmd, what was asked of the drives: a torque_gain or torque_bias is the drive's own"
    )
    return replace(result, warnings=(*result.warnings, said))


def _evened(log: Log, trial: Trial) -> Trial:
    """The trial on an even clock."""
    rate = trial_rate(log.header, trial)
    if trial.q_cmd is None or is_uniform(trial.time, rate):
        return trial
    grid = uniform_grid(trial.time, rate)
    q, q_cmd = (resample_smooth(trial.time, x, grid) for x in (trial.q, trial.q_cmd))
    return Trial(
        trial.name,
        trial.role,
        grid,
        q,
        q_cmd=q_cmd,
        session=trial.session,
        start_s=trial.start_s,
        repeats=trial.repeats,
        cleaning=trial.cleaning,
    )


def _position_floor(baseline: Baseline) -> Array:
    """RMS of half the difference of repeated trials' positions; of neighbouring samples where there are none."""
    samples = baseline.samples
    by_name = {t.name: t for t in samples.trials}
    squares, count, index = np.zeros(len(samples.joints)), 0, list(samples.index)
    for t in samples.trials:
        first = by_name.get(t.repeats or "")
        if first is not None:
            n = min(len(t.time), len(first.time))
            squares += 0.5 * ((t.q[:n, index] - first.q[:n, index]) ** 2).sum(axis=0)
            count += n
    if count:
        return np.sqrt(squares / count)
    third = np.concatenate([np.diff(t.q[:, index], 3, axis=0) for t in samples.trials])
    return np.sqrt((third**2).mean(axis=0) / 20.0)


def _judged(result: Diagnosis, closed: _Closed) -> Diagnosis:
    """The verdict after the roll-outs, with the gap in positions and what no torque leaves open."""
    gap, warnings = result.gap, list(result.warnings)
    rollout, servo = closed.rollout, closed.servo
    warnings.append(
        "the log has no torque: an error of a torque sensor cannot be seen, and where friction ends and the "
        "drive's own losses begin cannot be told"
    )
    if closed.cycle_s > 0.0:
        warnings.append(
            f"torques act {1e3 * closed.cycle_s:.1f} ms after commands and positions ask for them, taken for the "
            "servo's cycle: a lag of the drive that is as short cannot be seen"
        )
    if closed.tracking is not None:
        warnings += closed.tracking.sentences()
    if servo.estimated:
        warnings.append(
            "not stated and estimated with the nominal masses for a scale: " + ", ".join(servo.estimated)
        )
    if rollout is None or not rollout.before or closed.deviation is None or closed.floor is None:
        return replace(result, warnings=tuple(warnings))
    gap = position_gap(rollout, closed.deviation, closed.floor)
    result = replace(result, gap=gap)
    if result.verdict in {"effect", "ambiguous"} and not confirmed(gap):
        named = " and ".join(f"{e.effect} at {e.location}" for e in result.effects)
        warnings.append(f"the servo's torques speak for {named}, closed-loop roll-outs do not confirm it")
        result = replace(
            result,
            verdict="unknown",
            effect=None,
            effects=(),
            tied_locations=(),
            n_tied=0,
            next_experiment=None,
        )
    elif result.verdict == "effect":
        result = with_twin(result, bool(servo.estimated))
    return replace(result, warnings=tuple(warnings))
