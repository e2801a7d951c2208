"""excite: design, check, run and evaluate the experiments that identify a robot's dynamics.

The verbs below are loaded on first use, so that ``import excite`` costs nothing:

>>> import excite
>>> robot = excite.load_robot("g1")
>>> robot.n_joints
29
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any

__version__ = "0.1.0"

_PUBLIC = {
    "ExciteError": "excite.errors",
    "NoSolutionError": "excite.errors",
    "UnsafeMotionError": "excite.errors",
    "Robot": "excite.robot.robot",
    "load_robot": "excite.robot.bringing",
    "bundled_robots": "excite.robot.catalogue",
    "robot_summaries": "excite.robot.summary",
    "scaffold_description": "excite.robot.scaffold.description",
    "write_scaffold": "excite.robot.scaffold.files",
    "Motion": "excite.motion.motion",
    "load_motion": "excite.motion.files",
    "load_motions": "excite.motion.collection",
    "save_motion": "excite.motion.files",
    "plan": "excite.campaign.plan",
    "SeriesSettings": "excite.campaign.candidates.series",
    "check": "excite.campaign.check",
    "rank": "excite.campaign.rank",
    "export_motion": "excite.export.export",
    "export_motions": "excite.export.export",
    "simulate": "excite.campaign.experiment",
    "Log": "excite.logs.log",
    "load_log": "excite.logs.files",
    "save_log": "excite.logs.files",
    "import_recordings": "excite.logs.recordings",
    "robot_for_log": "excite.logs.robot",
    "join_logs": "excite.logs.joined",
    "write_simulator_model": "excite.export.simulators.write",
    "identify": "excite.identification.identify",
    "Identification": "excite.identification.result",
    "save_findings": "excite.campaign.findings",
    "identify_sessions": "excite.identification.sessions.compare",
    "split_sessions": "excite.identification.sessions.split",
    "write_ranges": "excite.identification.sessions.compare",
    "identify_drive_gains": "excite.identification.load.drive_gains",
    "identify_load": "excite.identification.load.drive_gains",
    "weigh_load": "excite.identification.load.weighing",
    "momentum_residual": "excite.identification.momentum_observer",
    "write_models": "excite.export.models.write",
    "write_urdf": "excite.export.models.urdf",
    "write_mjcf": "excite.export.models.mjcf",
    "load_bounds": "excite.identification.physical.bounds_file",
    "write_bounds_template": "excite.identification.physical.bounds_template",
    "EstimatorSettings": "excite.identification.estimators.settings",
    "estimator_settings": "excite.identification.estimators.method_settings",
    "method_summaries": "excite.identification.estimators.summary",
    "estimate_torque_delay": "excite.identification.alignment",
    "explain_signals": "excite.identification.explanation",
    "save_signal_figure": "excite.report.plots.signals",
    "ProblemSettings": "excite.rows.settings",
    "Subject": "excite.human.subject",
    "MeasureSettings": "excite.human.measure",
    "measure_person": "excite.human.measure",
    "write_person": "excite.human.measure",
    "identify_person": "excite.human.identified",
    "added_mass": "excite.human.identified",
    "identify_wearing": "excite.human.weight.worn_weight",
    "doctor": "excite.doctor.doctor",
    "convert": "excite.conversion.convert",
    "write_header": "excite.conversion.init_log",
    "capture": "excite.campaign.capture",
    "file_schema": "excite.campaign.schemas",
    "Chart": "excite.doctor.examine",
    "Finding": "excite.finding",
    "diagnose": "excite.diagnosis.diagnose",
    "Diagnosis": "excite.diagnosis.answer.result",
    "effect_summaries": "excite.diagnosis.answer.effect_summary",
    "campaign": "excite.campaign.loop",
    "CampaignSettings": "excite.campaign.settings",
    "report": "excite.report.page",
    "demo": "excite.campaign.demo",
}

__all__ = ["__version__", *_PUBLIC]


class _Package(ModuleType):
    """Keeps the verbs ``report``, ``campaign`` and ``doctor`` callable although rooms have the same names.

    Importing a module of a room would otherwise bind the room's package over the verb.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _PUBLIC and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'excite' has no attribute {name!r}")
    value = getattr(importlib.import_module(_PUBLIC[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
