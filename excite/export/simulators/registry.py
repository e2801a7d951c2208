"""The formats of simulators by name. A new one is one file beside this one and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from excite.registry import Registry

if TYPE_CHECKING:
    from excite.export.simulators.model_format import ModelFormat


MODEL_FORMATS: Registry[ModelFormat] = Registry(
    "model format",
    {
        "urdf": "excite.export.simulators.urdf:UrdfFormat",
        "mjcf": "excite.export.simulators.mjcf:MjcfFormat",
        "isaaclab": "excite.export.simulators.labs:IsaacLabFormat",
        "mjlab": "excite.export.simulators.labs:MjlabFormat",
        "usda": "excite.export.simulators.usd:UsdaFormat",
        "sdf": "excite.export.simulators.sdf:SdfFormat",
    },
)
