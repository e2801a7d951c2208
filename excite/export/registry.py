"""The formats of controllers and of simulators by name. A new one is one file and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from excite.registry import Registry

if TYPE_CHECKING:
    from excite.export.exporter import Exporter
    from excite.export.models.model_format import ModelFormat

EXPORTERS: Registry[Exporter] = Registry(
    "format",
    {
        "csv": "excite.export.plain_tables:CsvExporter",
        "npz": "excite.export.plain_tables:NpzExporter",
        "ros2": "excite.export.ros2:Ros2Exporter",
        "ros2-yaml": "excite.export.ros2:Ros2YamlExporter",
        "mcap": "excite.export.ros2:McapExporter",
        "ur-script": "excite.export.makers:UrScriptExporter",
        "mujoco-keyframes": "excite.export.keyframes:KeyframesExporter",
        "lerobot": "excite.export.plain_tables:LeRobotExporter",
        "franka": "excite.export.makers:FrankaExporter",
        "unitree": "excite.export.makers:UnitreeExporter",
        "openhrp": "excite.export.makers:OpenHrpExporter",
    },
    axis="exporters",
)

MODEL_FORMATS: Registry[ModelFormat] = Registry(
    "model format",
    {
        "urdf": "excite.export.models.urdf:UrdfFormat",
        "mjcf": "excite.export.models.mjcf:MjcfFormat",
        "isaaclab": "excite.export.models.labs:IsaacLabFormat",
        "mjlab": "excite.export.models.labs:MjlabFormat",
        "usda": "excite.export.models.usd:UsdaFormat",
    },
)
