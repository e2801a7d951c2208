"""Banded rotary friction device: a damper with dry friction and play, moved back and forth by actuators.

Coble, Huggins, Cao, Ricles, Downey: data set of a friction damper with backlash, 2022.
"""

from __future__ import annotations

from pathlib import Path

from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from tests.reproduction.imported import import_recordings

FOLDER = "brfd_friction_backlash"
JOINT = "stroke"
METRE_PER_INCH, NEWTON_PER_KIP = 0.0254, 4448.2216
# What the device does is in its force; moving parts are not part of it.
URDF = f"""<robot name="brfd">
  <link name="frame"/>
  <link name="drum"><inertial><mass value="1e-3"/>
    <inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{JOINT}" type="prismatic">
    <parent link="frame"/><child link="drum"/><axis xyz="1 0 0"/>
    <limit lower="-0.05" upper="0.05" effort="20000" velocity="0.3"/>
  </joint>
</robot>
"""
TWO_AMPLITUDES = (
    ("0.5Hz30lbtension0.5amplitude_ds2.csv", "identification", (0.0, 1.0)),
    ("0.5Hz30lbtension1.5amplitude_ds2.csv", "identification", (0.0, 0.5)),
    ("0.5Hz30lbtension1.5amplitude_ds2.csv", "validation", (0.5, 1.0)),
)
"""One tension of the band, half an inch and one and a half."""


def at_tension(pounds: int) -> tuple[tuple[str, str, tuple[float, float]], ...]:
    """A recording at 1 Hz of one tension of the band (20 or 80 lb); it stands still for the last fifth."""
    file = f"1Hz{pounds}lbtension_ds1.csv"
    return ((file, "identification", (0.0, 0.45)), (file, "validation", (0.45, 0.75)))


def brfd_log(
    data_dir: Path,
    folder: Path,
    parts: tuple[tuple[str, str, tuple[float, float]], ...],
    modelled: tuple[str, ...] = ("rigid_body_fixed",),
) -> Log:
    """Displacement and force of parts of the recordings; nothing of the device is modelled."""
    mapping = {
        "log": {
            "robot": "brfd.urdf",
            "base": "fixed",
            "rate_hz": 1024,
            "joints": [JOINT],
            "torque": "motor_side",
            "modelled": modelled,
        },
        "columns": {"time": "t_s", "q.{joint}": "disp_in", "tau.{joint}": "friction_force_kip"},
        "scale": {"q.{joint}": METRE_PER_INCH, "tau.{joint}": NEWTON_PER_KIP},
        "trials": [
            {"file": file, "role": role, "name": f"part_{k}", "part": part}
            for k, (file, role, part) in enumerate(parts)
        ],
    }
    log = import_recordings(mapping, data_dir / FOLDER, robot_text=URDF)
    return load_log(save_log(log, folder / "brfd"))
