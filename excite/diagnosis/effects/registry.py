"""All effects of fixed-base arms, by name."""

from __future__ import annotations

from excite.diagnosis.effects.actuator_lag import ActuatorLag
from excite.diagnosis.effects.armature import Armature
from excite.diagnosis.effects.backlash import Backlash
from excite.diagnosis.effects.base_tilt import BaseTilt
from excite.diagnosis.effects.coulomb_friction import CoulombFriction
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.encoder_offset import EncoderOffset
from excite.diagnosis.effects.friction_drift import FrictionDrift
from excite.diagnosis.effects.joint_elasticity import JointElasticity
from excite.diagnosis.effects.joint_spring import JointSpring
from excite.diagnosis.effects.link_length_error import LinkLengthError
from excite.diagnosis.effects.load_dependent_friction import LoadDependentFriction
from excite.diagnosis.effects.payload import Payload
from excite.diagnosis.effects.stribeck import Stribeck
from excite.diagnosis.effects.time_delay import TimeDelay
from excite.diagnosis.effects.torque_bias import TorqueBias
from excite.diagnosis.effects.torque_gain import TorqueGain
from excite.diagnosis.effects.torque_ripple import TorqueRipple
from excite.diagnosis.effects.viscous_friction import ViscousFriction

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
