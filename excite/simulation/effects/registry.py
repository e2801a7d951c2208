"""Injected effects by name, and the form in which the command line names them."""

from __future__ import annotations

from collections.abc import Iterable

from excite.errors import InputError, UnknownNameError
from excite.simulation.effects.bodies.base_tilt import BaseTilt
from excite.simulation.effects.bodies.link_inertia import LinkInertia
from excite.simulation.effects.bodies.link_length_error import LinkLengthError
from excite.simulation.effects.bodies.payload import Payload
from excite.simulation.effects.bodies.soft_tissue import SoftTissue
from excite.simulation.effects.effect import InjectedEffect
from excite.simulation.effects.forces.external_force import ExternalForce
from excite.simulation.effects.forces.joint_spring import JointSpring
from excite.simulation.effects.forces.torque_ripple import TorqueRipple
from excite.simulation.effects.forces.unlogged_contact import UnloggedContact
from excite.simulation.effects.friction.coulomb_asymmetry import CoulombAsymmetry
from excite.simulation.effects.friction.coulomb_friction import CoulombFriction
from excite.simulation.effects.friction.friction_drift import FrictionDrift
from excite.simulation.effects.friction.load_dependent_friction import LoadDependentFriction
from excite.simulation.effects.friction.stribeck import Stribeck
from excite.simulation.effects.friction.viscous_friction import ViscousFriction
from excite.simulation.effects.gears.armature import Armature
from excite.simulation.effects.gears.backlash import Backlash
from excite.simulation.effects.gears.joint_elasticity import JointElasticity
from excite.simulation.effects.readings.actuator_lag import ActuatorLag
from excite.simulation.effects.readings.base_orientation_bias import BaseOrientationBias
from excite.simulation.effects.readings.encoder_offset import EncoderOffset
from excite.simulation.effects.readings.sensor_bias import SensorBias
from excite.simulation.effects.readings.sensor_crosstalk import SensorCrosstalk
from excite.simulation.effects.readings.sensor_frame_offset import SensorFrameOffset
from excite.simulation.effects.readings.sensor_gain import SensorGain
from excite.simulation.effects.readings.time_delay import TimeDelay
from excite.simulation.effects.readings.torque_bias import TorqueBias
from excite.simulation.effects.readings.torque_gain import TorqueGain
from excite.simulation.virtual_robot import VirtualRobot

INJECTED_EFFECTS: dict[str, InjectedEffect] = {
    effect.name: effect
    for effect in (
        ActuatorLag(),
        Armature(),
        Backlash(),
        BaseTilt(),
        CoulombAsymmetry(),
        CoulombFriction(),
        EncoderOffset(),
        ExternalForce(),
        FrictionDrift(),
        JointElasticity(),
        JointSpring(),
        LinkInertia(),
        LinkLengthError(),
        LoadDependentFriction(),
        Payload(),
        Stribeck(),
        TimeDelay(),
        TorqueBias(),
        TorqueGain(),
        TorqueRipple(),
        BaseOrientationBias(),
        SensorBias(),
        SensorCrosstalk(),
        SensorFrameOffset(),
        SensorGain(),
        SoftTissue(),
        UnloggedContact(),
        ViscousFriction(),
    )
}


def inject(virtual: VirtualRobot, texts: Iterable[str]) -> VirtualRobot:
    """A virtual robot with effects named as ``EFFECT[:LOCATION[:VALUE]]``, one after the other.

    Args:
        virtual: the robot; left as it is.
        texts: for example ``payload``, ``payload:torso_link`` or ``viscous_friction:joint_2:1.5``.

    Returns:
        The robot with all of them.

    Raises:
        UnknownNameError: no such effect, or the effect cannot sit at that location.
        InputError: a text has no such form, or its value is no number or out of bounds.
    """
    for text in texts:
        name, *rest = text.split(":")
        if name not in INJECTED_EFFECTS:
            raise UnknownNameError("effect", name, sorted(INJECTED_EFFECTS))
        if len(rest) > 2:
            raise InputError(f"{text!r} has too many parts", remedy="write EFFECT[:LOCATION[:VALUE]]")
        location = rest[0] or None if rest else None
        value = _number(rest[1], text) if len(rest) == 2 else None
        virtual = INJECTED_EFFECTS[name].inject(virtual, location, value)
    return virtual


def _number(part: str, text: str) -> float:
    try:
        return float(part)
    except ValueError as error:
        raise InputError(
            f"{part!r} in {text!r} is no number", remedy="write EFFECT[:LOCATION[:VALUE]]"
        ) from error
