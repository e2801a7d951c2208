"""Which recordings are drawn, and what is to be seen."""

from __future__ import annotations

from pathlib import Path

from excite.logs.robot import nominal_robot
from tests.reproduction.brfd import JOINT, TWO_AMPLITUDES, brfd_log
from tests.reproduction.dvrk import dvrk_log
from tests.reproduction.real_robots.picture import write_picture
from tests.reproduction.ur10e_load import bare_arm, loaded_log, weighed_gains

LOAD = (
    "real_ur10e_load.png",
    "UR10e with a load: shoulder lift, elbow and second wrist, before and after the payload",
)
WEIGHT = ("real_dvrk_weight.png", "dVRK with 105 g: what the weight changes, before and after the payload")
DAMPER = (
    "real_damper.png",
    "Friction damper: force, before and after dry friction that builds up over a way",
)


def draw_pictures(data: Path, folder: Path, images: Path) -> None:
    """Write all pictures."""
    gains = weighed_gains(data, folder / "weighed")
    log = loaded_log(data, folder / "load", gains)
    joints = ("shoulder_lift_joint", "elbow_joint", "wrist_2_joint")
    write_picture(images / LOAD[0], bare_arm(data, folder / "bare", gains), log, joints)
    log = dvrk_log(data, folder / "weight", "insertion")
    write_picture(images / WEIGHT[0], nominal_robot(log), log, ("yaw", "pitch"))
    log = brfd_log(data, folder / "damper", TWO_AMPLITUDES)
    write_picture(images / DAMPER[0], nominal_robot(log), log, (JOINT,))
