"""All checks of a log, in the order in which they are made: rows, clock, units, channels, then what they say."""

from __future__ import annotations

from excite.doctor.check import Check
from excite.doctor.checks.channels import Channels
from excite.doctor.checks.commands import Commands
from excite.doctor.checks.held_rows import HeldRows
from excite.doctor.checks.limits import Degrees, Limits
from excite.doctor.checks.machine import OtherMachine
from excite.doctor.checks.motion import Amount, Jumps, Standing, Unison, WholeTurns
from excite.doctor.checks.rate import StatedRate
from excite.doctor.checks.rows import CountedRows
from excite.doctor.checks.sensors import Constant, Range, Steps
from excite.doctor.checks.stamps import Stamps
from excite.doctor.checks.torque_range import TorqueRange
from excite.doctor.checks.torques import TorqueSide, WeakTorques
from excite.doctor.checks.velocities import Velocities

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
