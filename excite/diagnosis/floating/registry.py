"""The effects that a floating-base diagnosis tries."""

from __future__ import annotations

from excite.diagnosis.floating.bodies import (
    JointElasticity,
    LinkInertia,
    LinkLengthError,
    SoftTissue,
    SwingingJoint,
    WobblingMass,
)
from excite.diagnosis.floating.effect import FloatingEffect
from excite.diagnosis.floating.forces import ExternalForce, PressedContact, Surface, UnloggedContact
from excite.diagnosis.floating.readings import (
    BaseOrientationBias,
    DriveArmature,
    DriveBias,
    DriveCoulomb,
    DriveGain,
    DriveViscous,
    EncoderOffset,
    SensorBias,
    SensorCrosstalk,
    SensorFrameOffset,
    SensorGain,
    TimeDelay,
)

FLOATING_EFFECTS: dict[str, FloatingEffect] = {
    effect.form_name: effect
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
        DriveViscous(),
        DriveCoulomb(),
        DriveArmature(),
        DriveBias(),
        DriveGain(),
    )
}

# By form, others of the same physics, which are tried where nothing explains a gap and from where that one ends.
FURTHER_FORMS: dict[str, tuple[FloatingEffect, ...]] = {JointElasticity.name: (SwingingJoint(),)}

# By form, what no word is for and what looks the same where it is: with as good a fit, nothing is named.
NAMELESS: dict[str, FloatingEffect] = {WobblingMass.form: WobblingMass(level=True)}

# By form, all that may be noted beside a model; contacts are found by searches of their own.
EVERY_FORM: dict[str, FloatingEffect] = {
    effect.form_name: effect
    for effect in (
        *FLOATING_EFFECTS.values(),
        *(form for forms in FURTHER_FORMS.values() for form in forms),
        UnloggedContact(),
        PressedContact(Surface((0.0, 0.0, 1.0), 0.0, 1.0, rounded=False)),
    )
}
