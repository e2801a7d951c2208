"""Is it this robot's motion, and the one that was judged?"""

from __future__ import annotations

from typing import ClassVar

from excite.safety.checks.base import Check, CheckResult
from excite.safety.checks.sweep import Sweep
from excite.safety.verdict import Violation


class IdentityCheck(Check):
    """What a motion's file says of its robot and of its samples has to be so.

    A motion of another robot, or of this one with another description, geometry or limits, may fit by its joints' names
    and hit something all the same. Samples that are not those of the stated hash were changed by somebody who judged
    nothing. A motion that states neither, as one that was made elsewhere, is judged by its samples alone.
    """

    name: ClassVar[str] = "identity"

    def judge(self, sweep: Sweep) -> CheckResult:
        robot, motion = sweep.robot, sweep.motion
        found = []
        if motion.robot != robot.name:
            found.append(Violation("other_robot", None, motion.robot, None, None))
        elif motion.metadata.robot_hash and motion.metadata.robot_hash != robot.hash:
            found.append(Violation("other_version_of_robot", None, motion.robot, None, None))
        if motion.metadata.stated_hash:
            found.append(Violation("changed_since_written", None, "samples", None, None))
        return CheckResult(violations=tuple(found))
