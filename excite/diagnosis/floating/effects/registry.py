"""The effects that a floating-base diagnosis tries."""

from __future__ import annotations

from excite.diagnosis.floating.effects.base_orientation_bias import BaseOrientationBias
from excite.diagnosis.floating.effects.effect import FloatingEffect
from excite.diagnosis.floating.effects.encoder_offset import EncoderOffset
from excite.diagnosis.floating.effects.external_force import ExternalForce
from excite.diagnosis.floating.effects.joint_elasticity import JointElasticity
from excite.diagnosis.floating.effects.link_inertia import LinkInertia
from excite.diagnosis.floating.effects.link_length_error import LinkLengthError
from excite.diagnosis.floating.effects.pressed_contact import PressedContact, Surface
from excite.diagnosis.floating.effects.sensor_bias import SensorBias
from excite.diagnosis.floating.effects.sensor_crosstalk import SensorCrosstalk
from excite.diagnosis.floating.effects.sensor_frame_offset import SensorFrameOffset
from excite.diagnosis.floating.effects.sensor_gain import SensorGain
from excite.diagnosis.floating.effects.soft_tissue import SoftTissue
from excite.diagnosis.floating.effects.swinging_joint import SwingingJoint
from excite.diagnosis.floating.effects.time_delay import TimeDelay
from excite.diagnosis.floating.effects.unlogged_contact import UnloggedContact
from excite.diagnosis.floating.effects.wobbling_mass import WobblingMass

FLOATING_EFFECTS: dict[str, FloatingEffect] = {
    effect.word: effect
    for effect in (
        LinkInertia(),
        LinkLengthError(),
        EncoderOffset(),
        JointElasticity(),
        BaseOrientationBias(),
        SensorGain(),
        SensorBias(),
        SensorCrosstalk(),
        SensorFrameOffset(),
        ExternalForce(),
        TimeDelay(),
        SoftTissue(),
        WobblingMass(),
    )
}

# By form, others of the same physics, which are tried where nothing explains a gap and from where that one ends.
FURTHER_FORMS: dict[str, tuple[FloatingEffect, ...]] = {JointElasticity.name: (SwingingJoint(),)}

# By form, what no word is for and what looks the same where it is: with as good a fit, nothing is named.
NAMELESS: dict[str, FloatingEffect] = {WobblingMass.form: WobblingMass(level=True)}

# By form, all that may be noted beside a model; contacts are found by searches of their own.
EVERY_FORM: dict[str, FloatingEffect] = {
    effect.word: effect
    for effect in (
        *FLOATING_EFFECTS.values(),
        *(form for forms in FURTHER_FORMS.values() for form in forms),
        UnloggedContact(),
        PressedContact(Surface((0.0, 0.0, 1.0), 0.0, 1.0, rounded=False)),
    )
}
