"""The controller formats by name. A new one is one file beside this one and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from excite.registry import Registry

if TYPE_CHECKING:
    from excite.export.exporter import Exporter

EXPORTERS: Registry[Exporter] = Registry(
    "format",
    {
        "csv": "excite.export.csv:CsvExporter",
        "npz": "excite.export.npz:NpzExporter",
        "ros2": "excite.export.ros2:Ros2Exporter",
        "ros2-yaml": "excite.export.ros2_yaml:Ros2YamlExporter",
        "mcap": "excite.export.mcap:McapExporter",
        "ur-script": "excite.export.arms.ur_script:UrScriptExporter",
        "mujoco-keyframes": "excite.export.mujoco.keyframes:KeyframesExporter",
        "lerobot": "excite.export.lerobot:LeRobotExporter",
        "franka": "excite.export.arms.franka:FrankaExporter",
        "unitree": "excite.export.humanoids.unitree:UnitreeExporter",
        "openhrp": "excite.export.humanoids.openhrp:OpenHrpExporter",
        "opensim": "excite.export.humanoids.opensim:OpenSimExporter",
    },
)
