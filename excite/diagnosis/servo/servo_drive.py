"""The servo as what drives a closed-loop roll-out."""

from __future__ import annotations

from excite.diagnosis.servo.cycle import Cycle, acting
from excite.diagnosis.servo.servo import Servo, Signals
from excite.diagnosis.simulator.rollout_drives import PositionServo


def servo_drive(signals: Signals, servo: Servo, cycle: Cycle, order: list[int]) -> PositionServo:
    """The servo of one trial: at the record's own motion it gives the torques that the record was rebuilt with.

    It answers the simulated positions and velocities at once. What comes of acting later, and of damping a velocity
    that is not the log's, is small beside that and the record's: it stands in the feedforward, with the integral
    part, which over a roll-out has hardly heard of what is different there.

    Args:
        signals: of the trial.
        servo: the servo.
        cycle: when its torques act.
        order: the roll-out's joints in the log.

    Returns:
        The drive, on a clock that starts with the trial.
    """
    given = signals.feedforward(servo.feedforward) + signals.integral
    moved = acting(signals, servo, cycle) - signals.torque(servo)
    return PositionServo(
        time=signals.time - signals.time[0],
        q_cmd=signals.commanded.value[:, order],
        v_cmd=servo.damping_share * signals.commanded.first[:, order],
        feedforward=(given + moved)[:, order],
        kp=servo.kp[order],
        kd=servo.kd[order],
    )
