"""excite: design, check, run and evaluate the experiments that identify a robot's dynamics.

The verbs below are loaded on first use, so that ``import excite`` costs nothing:

>>> import excite
>>> robot = excite.load_robot("g1")
>>> robot.n_joints
29

The verbs, and what they take and give, are here; the rest is in groups: ``excite.robots``, ``recordings``, ``methods``,
``models``, ``loads``, ``people`` and ``catalogue``.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any

from excite.api import SPACES, groups

__version__ = "0.1.0"

_PUBLIC = {
    "ExciteError": "excite.errors",
    "NoSolutionError": "excite.errors",
    "UnsafeMotionError": "excite.errors",
    "Robot": "excite.robot.robot",
    "load_robot": "excite.robot.load",
    "bundled_robots": "excite.robot.catalogue",
    "Motion": "excite.motion.motion",
    "load_motion": "excite.motion.files",
    "load_motions": "excite.motion.collection",
    "save_motion": "excite.motion.files",
    "plan": "excite.campaign.plan",
    "check": "excite.campaign.assessment",
    "rank": "excite.campaign.assessment",
    "export_motion": "excite.export.export",
    "export_motions": "excite.export.export",
    "simulate": "excite.campaign.experiment",
    "Log": "excite.logs.log",
    "load_log": "excite.logs.files",
    "save_log": "excite.logs.files",
    "write_simulator_model": "excite.export.models.simulator_model",
    "identify": "excite.identification.identify",
    "Identification": "excite.identification.result",
    "write_models": "excite.export.models.simulator_model",
    "doctor": "excite.doctor.examine",
    "convert": "excite.conversion.convert",
    "capture": "excite.campaign.capture",
    "Finding": "excite.finding",
    "diagnose": "excite.diagnosis.diagnose",
    "Diagnosis": "excite.diagnosis.answer.answer",
    "campaign": "excite.campaign.loop",
    "report": "excite.report.page",
    "demo": "excite.campaign.loop",
}

# Names of groups are reached without their group too, as they were before there were groups.
_GROUPED = {name: space for space, names in SPACES.items() for name in names}

__all__ = ["__version__", *_PUBLIC, *SPACES]


class _Package(ModuleType):
    """Keeps the verbs ``report``, ``campaign`` and ``doctor`` callable although rooms have the same names.

    Importing a module of a room would otherwise bind the room's package over the verb.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _PUBLIC and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
globals().update(groups())


def __getattr__(name: str) -> Any:
    if name in _GROUPED:
        return getattr(globals()[_GROUPED[name]], name)
    if name not in _PUBLIC:
        raise AttributeError(f"module 'excite' has no attribute {name!r}")
    value = getattr(importlib.import_module(_PUBLIC[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
