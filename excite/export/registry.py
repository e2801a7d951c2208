"""The controller formats by name. A new one is one file beside this one and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from excite.registry import Registry, installed

if TYPE_CHECKING:
    from excite.export.exporter import Exporter

EXPORTERS: Registry[Exporter] = Registry(
    "format",
    installed("exporters")
    | {
        "csv": "excite.export.plain_tables:CsvExporter",
        "npz": "excite.export.plain_tables:NpzExporter",
        "ros2": "excite.export.ros2:Ros2Exporter",
        "ros2-yaml": "excite.export.ros2:Ros2YamlExporter",
        "mcap": "excite.export.ros2:McapExporter",
        "ur-script": "excite.export.arms:UrScriptExporter",
        "mujoco-keyframes": "excite.export.mujoco:KeyframesExporter",
        "lerobot": "excite.export.plain_tables:LeRobotExporter",
        "franka": "excite.export.arms:FrankaExporter",
        "unitree": "excite.export.humanoids:UnitreeExporter",
        "openhrp": "excite.export.humanoids:OpenHrpExporter",
        "opensim": "excite.export.humanoids:OpenSimExporter",
    },
)
