"""The checks that make up a verdict, by name, in the order in which they run."""

from __future__ import annotations

from excite.safety.checks.balance import CentreOfMassCheck, ContactWrenchCheck, ZeroMomentPointCheck
from excite.safety.checks.base import Check
from excite.safety.checks.collision import SelfCollisionCheck
from excite.safety.checks.foot import FootCheck
from excite.safety.checks.identity import IdentityCheck
from excite.safety.checks.limits import (
    JointAccelerationCheck,
    JointJerkCheck,
    JointPositionCheck,
    JointVelocityCheck,
)
from excite.safety.checks.mechanism import MechanismCheck
from excite.safety.checks.rest import RestCheck
from excite.safety.checks.sampling import SamplingCheck
from excite.safety.checks.torque import JointTorqueCheck

CHECKS: dict[str, type[Check]] = {
    check.name: check
    for check in (
        SamplingCheck,
        MechanismCheck,
        IdentityCheck,
        RestCheck,
        JointPositionCheck,
        JointVelocityCheck,
        JointAccelerationCheck,
        JointJerkCheck,
        FootCheck,
        ZeroMomentPointCheck,
        CentreOfMassCheck,
        ContactWrenchCheck,
        JointTorqueCheck,
        SelfCollisionCheck,
    )
}
