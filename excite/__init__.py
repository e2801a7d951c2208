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

from excite.api import PUBLIC, SPACES, groups

__version__ = "0.1.0"

# Names of groups are reached without their group too, as they were before there were groups.
_GROUPED = {name: space for space, names in SPACES.items() for name in names}

__all__ = ["__version__", *PUBLIC, *SPACES]


class _Package(ModuleType):
    """Keeps the verbs ``report``, ``campaign`` and ``doctor`` callable although rooms have the same names.

    Importing a module of a room would otherwise bind the room's package over the verb.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in PUBLIC and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
globals().update(groups())


def __getattr__(name: str) -> Any:
    if name in _GROUPED:
        return getattr(globals()[_GROUPED[name]], name)
    if name not in PUBLIC:
        raise AttributeError(f"module 'excite' has no attribute {name!r}")
    value = getattr(importlib.import_module(PUBLIC[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
