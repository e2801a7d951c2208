"""Joints that no motor drives are where the motors put them."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.errors import MotionError
from excite.safety.checks.base import Check, CheckResult
from excite.safety.checks.sweep import Sweep
from excite.safety.verdict import Violation

# How far a closure may be open between samples [m or rad]: a hundredth of the clearance that collision checks keep,
# and some hundred times what quintic interpolation leaves at 25 Hz.
TOLERANCE = 1e-4


class MechanismCheck(Check):
    """Loops are closed and coupled joints move together, so that what follows from them can be believed.

    Motions whose mechanism is open tell of a robot that does not exist; near a singular position its joints do not
    follow from the motors, and nothing about their torques can be computed.
    """

    name: ClassVar[str] = "mechanism"

    def judge(self, sweep: Sweep) -> CheckResult:
        mechanism = sweep.robot.mechanism
        if mechanism is None:
            return CheckResult()
        gaps, time = mechanism.gaps(sweep.fine.q), sweep.fine.time
        worst = int(np.argmax(gaps > TOLERANCE))
        if gaps[worst] > TOLERANCE:
            where = mechanism.widest(sweep.fine.q[worst])
            found = Violation("mechanism_open", float(time[worst]), where, float(gaps[worst]), TOLERANCE)
            return CheckResult(violations=(found,), readable=False)
        try:
            mechanism.motion_maps(sweep.fine.q)
        except MotionError as error:
            found = Violation("mechanism_singular", None, error.field or "loops", None, None)
            return CheckResult(violations=(found,), readable=False)
        return CheckResult()
