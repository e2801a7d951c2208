"""All effects of fixed-base arms, by name."""

from __future__ import annotations

from excite.diagnosis.effects.bodies.base_tilt import BaseTilt
from excite.diagnosis.effects.bodies.link_length_error import LinkLengthError
from excite.diagnosis.effects.bodies.payload import Payload
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.forces.joint_spring import JointSpring
from excite.diagnosis.effects.forces.torque_ripple import TorqueRipple
from excite.diagnosis.effects.friction.coulomb_friction import CoulombFriction
from excite.diagnosis.effects.friction.friction_drift import FrictionDrift
from excite.diagnosis.effects.friction.load_dependent_friction import LoadDependentFriction
from excite.diagnosis.effects.friction.stribeck import Stribeck
from excite.diagnosis.effects.friction.viscous_friction import ViscousFriction
from excite.diagnosis.effects.gears.armature import Armature
from excite.diagnosis.effects.gears.backlash import Backlash
from excite.diagnosis.effects.gears.joint_elasticity import JointElasticity
from excite.diagnosis.effects.readings.actuator_lag import ActuatorLag
from excite.diagnosis.effects.readings.encoder_offset import EncoderOffset
from excite.diagnosis.effects.readings.time_delay import TimeDelay
from excite.diagnosis.effects.readings.torque_bias import TorqueBias
from excite.diagnosis.effects.readings.torque_gain import TorqueGain

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
        TimeDelay(),
        ActuatorLag(),
        Payload(),
        LinkLengthError(),
        BaseTilt(),
    )
}
