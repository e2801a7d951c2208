"""HSM150, two motors on one shaft: steps of torque at speed, in either direction.

Recordings published as HSM150-data (malik-robert).
"""

from __future__ import annotations

from pathlib import Path

from excite.identification.sessions import Sessions, identify_sessions, split_sessions
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from tests.reproduction.imported import import_recordings

FOLDER = "hsm150_two_motor"
JOINT = "shaft"
# What the catalogue says of one motor [kg·m²].
CATALOGUE_INERTIA = 1.2e-4
# Smallest and largest that plain least squares by hand makes of single steps [kg·m²].
BY_HAND = (1.23e-4, 3.3e-4)
STEPS = ("pos_0.06", "pos_0.065", "neg_0.04", "neg_0.045")
URDF = f"""<robot name="hsm150">
  <link name="frame"/>
  <link name="rotor">
    <inertial><mass value="0.5"/>
      <inertia ixx="1e-4" iyy="1e-4" izz="{CATALOGUE_INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="{JOINT}" type="continuous">
    <parent link="frame"/><child link="rotor"/><axis xyz="0 0 1"/>
    <limit effort="1" velocity="400"/>
  </joint>
</robot>
"""


def hsm150_log(data_dir: Path, folder: Path) -> Log:
    """Every step was run twice: the first runs train, the second judge; a session is one direction."""
    runs = [(1, "identification"), (2, "validation")]
    mapping = {
        "log": {
            "robot": "hsm150.urdf",
            "base": "fixed",
            "rate_hz": 1000,
            "joints": [JOINT],
            "torque": "motor_side",
            "modelled": ["rigid_body", "viscous_friction", "coulomb_friction"],
        },
        "columns": {"time": "t_s", "q.{joint}": "pos_rad", "tau.{joint}": "tau_meas_Nm"},
        "trials": [
            {"file": f"idf_{step}_{run}.csv", "role": role, "session": step[:3]}
            for run, role in runs
            for step in STEPS
        ],
    }
    log = import_recordings(mapping, data_dir / FOLDER, robot_text=URDF)
    return load_log(save_log(log, folder / "hsm150"))


def by_direction(log: Log) -> Sessions:
    """Inertia and friction of each direction, and of both together with what differs between them."""
    return identify_sessions(nominal_robot(log), split_sessions([log]))
