"""Names that ``import excite`` offers in groups: each group is a module, and what is in it is loaded on first use."""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any

SPACES: dict[str, dict[str, str]] = {
    "robots": {
        "scaffold_description": "excite.robot.init_robot.description",
        "write_scaffold": "excite.robot.init_robot.files",
        "robot_for_log": "excite.logs.robot",
        "examine_description": "excite.robot.inspection.chart",
    },
    "recordings": {
        "join_logs": "excite.logs.load_with_robot",
        "write_header": "excite.conversion.init_log",
        "Chart": "excite.doctor.examine",
        "Toss": "excite.diagnosis.tosses",
        "diagnose_tosses": "excite.diagnosis.tosses",
    },
    "methods": {
        "EstimatorSettings": "excite.identification.estimators.settings",
        "estimator_settings": "excite.identification.estimators.method_settings",
        "ProblemSettings": "excite.rows.settings",
        "SeriesSettings": "excite.campaign.optimised_series",
        "CampaignSettings": "excite.campaign.journal",
        "load_bounds": "excite.identification.physical.bounds_file",
        "write_bounds_template": "excite.identification.physical.bounds_file",
        "identify_sessions": "excite.identification.sessions",
        "split_sessions": "excite.identification.sessions",
        "write_ranges": "excite.identification.sessions",
        "save_findings": "excite.campaign.loop",
    },
    "models": {
        "write_urdf": "excite.export.models.simulator_model",
        "write_mjcf": "excite.export.models.simulator_model",
        "ParameterSet": "excite.safety.parameter_set",
        "parameter_set": "excite.safety.parameter_set",
        "stated_parameters": "excite.safety.parameter_set",
    },
    "loads": {
        "weigh_load": "excite.identification.load",
    },
    "people": {
        "Subject": "excite.human.segments",
        "MeasureSettings": "excite.human.measure",
        "measure_person": "excite.human.measure",
        "write_person": "excite.human.measure",
    },
    "catalogue": {
        "robot_summaries": "excite.robot.load",
        "method_summaries": "excite.identification.estimators.registry",
        "effect_summaries": "excite.diagnosis.answer.effect_summary",
        "file_schema": "excite.campaign.schemas",
        "register": "excite.registry",
    },
}
"""By group, the module that defines each of its names."""

_ABOUT = {
    "robots": "Robots of one's own: first descriptions, what is wrong with one, and a log's robot.",
    "recordings": "What is done with recordings beside loading and converting: their delays, parts.",
    "methods": "How parameters are identified: estimators and settings, bounds, sessions, residuals.",
    "models": "Models of robots with what was identified in them, file by file, and how uncertain they are.",
    "loads": "Loads: what an arm carries, from logs without and with it.",
    "people": "People: their model and log from markers and force plates.",
    "catalogue": "What there is to choose from: robots, methods, effects, schemas of files, members of one's own.",
}


class Group(ModuleType):
    """A module whose names are defined elsewhere.

    Args:
        name: of the group.
    """

    def __init__(self, name: str) -> None:
        super().__init__(f"excite.{name}", _ABOUT[name])
        self._names = SPACES[name]
        self.__all__ = list(self._names)

    def __getattr__(self, name: str) -> Any:
        where = self._names.get(name)
        if where is None:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return getattr(importlib.import_module(where), name)

    def __dir__(self) -> list[str]:
        return sorted(self._names)


def groups() -> dict[str, Group]:
    """All groups by name, so that they can be imported by that too."""
    made = {name: Group(name) for name in SPACES}
    sys.modules.update({group.__name__: group for group in made.values()})
    return made
