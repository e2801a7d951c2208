"""All effects of fixed-base arms, by name."""

from __future__ import annotations

from excite.diagnosis.effects.bodies import BaseTilt, LinkLengthError, Payload
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.forces import JointSpring, TorqueRipple
from excite.diagnosis.effects.friction import (
    CoulombFriction,
    FrictionDrift,
    LoadDependentFriction,
    Stribeck,
    ViscousFriction,
)
from excite.diagnosis.effects.gears.backlash import Backlash
from excite.diagnosis.effects.gears.gear_effect import Armature, JointElasticity
from excite.diagnosis.effects.neighbours import CoupledDrive, TorqueCrosstalk
from excite.diagnosis.effects.readings import (
    ActuatorLag,
    EncoderOffset,
    PositionGain,
    TimeDelay,
    TorqueBias,
    TorqueGain,
)
from excite.registry import add_installed

EFFECTS: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        ViscousFriction(),
        CoulombFriction(),
        TorqueBias(),
        Stribeck(),
        LoadDependentFriction(),
        FrictionDrift(),
        Armature(),
        Backlash(),
        JointElasticity(),
        JointSpring(),
        TorqueGain(),
        TorqueRipple(),
        EncoderOffset(),
        PositionGain(),
        TorqueCrosstalk(),
        CoupledDrive(),
        TimeDelay(),
        ActuatorLag(),
        Payload(),
        LinkLengthError(),
        BaseTilt(),
    )
}
add_installed("effects", EFFECTS)
