"""Franka arm, joint 2: torque less what its makers' model explains, at three speeds.

Data set of the neural friction model NNFM; its authors give what Coulomb, Stribeck and LuGre friction leave.
"""

from __future__ import annotations

from pathlib import Path

from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from tests.reproduction.imported import import_recordings

FOLDER = "franka_joint2_friction_nnfm"
JOINT = "joint2"
# Root mean squares that friction with a Coulomb and a viscous, and with a Stribeck term, leaves as published [N·m].
PUBLISHED = {"slow": (0.250, 0.246), "middle": (0.386, 0.381), "high": (0.403, 0.428)}
URDF = f"""<robot name="franka_joint2">
  <link name="shoulder"/>
  <link name="arm"><inertial><mass value="1e-6"/>
    <inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{JOINT}" type="revolute">
    <parent link="shoulder"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-1.8" upper="1.8" effort="87" velocity="2.2"/>
  </joint>
</robot>
"""


def franka_joint2_log(data_dir: Path, folder: Path) -> Log:
    """Slow and fast runs train, the one between judges; rigid bodies are in the recording's own model."""
    roles = {"slow": "identification", "high": "identification", "middle": "validation"}
    mapping = {
        "log": {
            "robot": "franka_joint2.urdf",
            "base": "fixed",
            "rate_hz": 210,
            "joints": [JOINT],
            "torque": "link_side",
            "modelled": ["rigid_body_fixed", "viscous_friction", "coulomb_friction"],
        },
        "columns": {
            "time": "time",
            "q.{joint}": "q2",
            "v.{joint}": "dq2",
            "tau.{joint}": "q2_tau_J_compensate",
        },
        "trials": [{"file": f"case3_{name}.csv", "role": role} for name, role in roles.items()],
    }
    log = import_recordings(mapping, data_dir / FOLDER, robot_text=URDF)
    return load_log(save_log(log, folder / "franka_joint2"))
