"""What no controller takes is refused in one line that names the format or the setting, and nothing is written."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from excite.errors import InputError
from excite.export.export import export_motion
from tests.export.conftest import ready

GAINS = {"kp": 60, "kd": 2}
REVERSED = "wrist_3_joint,-,wrist_2_joint,wrist_1_joint,elbow_joint,shoulder_lift_joint,shoulder_pan_joint"


@dataclass(frozen=True)
class Refused:
    """A format, a robot, what is asked of them, and what is said."""

    format: str
    robot: str
    said: str
    settings: dict[str, object] = field(default_factory=dict)
    rate_hz: float | None = None


NO_CHAIN = "is no chain of {} joints that turn on a fixed base"
ORDER = "names not each joint of robot 'ur10' once: "
ROWS = [
    *(
        Refused("ur-script", name, f"ur-script: robot '{name}' " + NO_CHAIN.format(6))
        for name in ("panda", "jaco2", "go2", "hrp2like")
    ),
    Refused("franka", "ur10", "franka: robot 'ur10' " + NO_CHAIN.format(7)),
    Refused("franka", "iiwa14", "model: joint 'joint1' does not say which arm of Franka"),
    Refused("lerobot", "panda", r"lerobot: rate_hz: is 62\.5 Hz, and LeRobot counts whole", rate_hz=62.5),
    Refused(
        "franka", "panda", "franka: rate_hz: is 500 Hz, and the controller runs at 1000 Hz", rate_hz=500.0
    ),
    Refused("ur-script", "ur10", "rate_hz: is 250 Hz, and the controller runs at 500 or 125 Hz", {}, 250.0),
    *(
        Refused("ur-script", "ur10", f"ur-script: {name}: is ", {name: value})
        for name, value in (("lookahead", 0.3), ("gain", 99), ("gain", "much"), ("confirm", "perhaps"))
    ),
    *(
        Refused("mcap", "ur10", "mcap: topic: is ", {"topic": topic})
        for topic in ("", "joint_command", "/a b", "/1", "/a/")
    ),
    *(
        Refused("ros2-yaml", "panda", "ros2-yaml: controller: is ", {"controller": name})
        for name in ("", "arm controller", "a//b", "a;reboot", "bärm")
    ),
    Refused(
        "ros2-yaml",
        "panda",
        "ros2-yaml: topic: is no setting; choose one of controller",
        {"topic": "/x"},
    ),
    Refused("unitree", "ur10", "motors: nobody knows the order of the motors of 'ur10'", GAINS),
    *(
        Refused("unitree", "ur10", f"motors: {ORDER}'{wrong}'", {"motors": order, **GAINS})
        for order, wrong in (
            (REVERSED.replace("elbow_joint", "-"), "elbow_joint"),
            (REVERSED + ",elbow_joint", "elbow_joint"),
            (REVERSED + ",knee", "knee"),
        )
    ),
    Refused(
        "openhrp",
        "ur10",
        f"joints: {ORDER}'elbow_joint'",
        {"joints": REVERSED.replace("-,", "").replace("elbow_joint,", "")},
    ),
    *(
        # A G1's knee has 8000 N·m/rad in the model, and 100 in the vendor's example.
        Refused("unitree", "g1", said, given)
        for given, said in (
            ({}, "kp: is not given; give --set kp=NUMBER as the machine is to run"),
            ({"kp": 60}, "kd: is not given"),
            ({"kp": "60,60", "kd": 2}, "kp: has 2 values for 29 motors"),
            ({"kp": "60,,60", "kd": 2}, "kp: is ''; choose"),
            ({"kp": 6000, "kd": 2}, "kp: is 6000"),
            (
                {"kp": "model", "kd": 2},
                "kp: is 8000 N·m/rad at .* virtual robot's, and may be at most 5000",
            ),
        )
    ),
]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.format} {row.robot} {row.settings}")
def test_what_no_controller_takes_is_refused_in_one_line(row: Refused, tmp_path: Path) -> None:
    robot, motion = ready(row.robot)
    with pytest.raises(InputError, match=row.said) as caught:
        export_motion(motion, robot, row.format, tmp_path / "a", row.rate_hz, settings=row.settings)
    assert "\n" not in str(caught.value) and not list(tmp_path.iterdir())
