"""Unitree's motors: which joint stands in which place of ``motor_state`` and ``motor_cmd``.

As in the vendor's SDK (unitree_sdk2: ``example/go2``, ``example/h1``, ``example/g1``) and, for G1s of 23 joints,
its page "Joint Motor Sequence": those have the places of the 29 and leave some empty. Quadrupeds count legs FR, FL,
RR, RL, those on wheels the wheels after them; H1 has an order of its own; of unitree_hg's humanoids every model
counts left leg, right leg, waist, left arm, right arm, and leaves out what it does not have.
"""

from __future__ import annotations

_LEGS = ("FR", "FL", "RR", "RL")
_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
QUADRUPED = tuple(f"{leg}_{joint}" for leg in _LEGS for joint in ("hip", "thigh", "calf"))
WHEELED = (*QUADRUPED, *(f"{leg}_foot" for leg in _LEGS))
G1 = (
    *(f"{side}_{joint}" for side in ("left", "right") for joint in _LEG),
    *("waist_yaw", "waist_roll", "waist_pitch"),
    *(f"{side}_{joint}" for side in ("left", "right") for joint in _ARM),
)
H1 = (
    *("right_hip_roll", "right_hip_pitch", "right_knee", "left_hip_roll", "left_hip_pitch", "left_knee"),
    *("torso", "left_hip_yaw", "right_hip_yaw", "", "left_ankle", "right_ankle"),
    *(f"{side}_{joint}" for side in ("right", "left") for joint in _ARM[:4]),
)
"""Joints by place, without ``_joint`` at their ends; an empty name where no motor is."""
