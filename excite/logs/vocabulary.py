"""Words that ``log.yaml`` may use for what a baseline models."""

from __future__ import annotations

RIGID_BODY = ("rigid_body", "rigid_body_fixed")

EFFECTS = (
    # in a joint
    "viscous_friction",
    "coulomb_friction",
    "coulomb_asymmetry",
    "stribeck",
    "load_dependent_friction",
    "friction_drift",
    "armature",
    "backlash",
    "joint_elasticity",
    "joint_spring",
    "torque_gain",
    "torque_bias",
    "torque_ripple",
    "encoder_offset",
    "position_gain",
    # at a joint and its neighbours
    "torque_crosstalk",
    "coupled_drive",
    # in the torque channel as a whole
    "time_delay",
    "actuator_lag",
    # in a body
    "payload",
    "link_inertia",
    "link_length_error",
    "base_tilt",
    # in a wrench sensor
    "sensor_gain",
    "sensor_bias",
    "sensor_crosstalk",
    "sensor_frame_offset",
    # in the whole body
    "base_orientation_bias",
    "external_force",
    "unlogged_contact",
    "soft_tissue",
)
