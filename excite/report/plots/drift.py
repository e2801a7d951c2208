"""What drifts over the episodes of a data set: zeros, gains, delays and friction of each joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from excite.report.plots.curves import Line, Panel, draw_panels
from excite.report.theme import save_png

_PANELS = {"zero": "zero", "gain": "gain", "lag_s": "delay [s]", "friction": "dry friction"}
_LOOK = {"marker": ".", "ms": 3.0, "lw": 0.7}


def save_drift(episodes: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Write as PNG a panel a measure, a line a joint, over the episodes (``episodes`` of ``excite.doctor/1``)."""
    ordered = sorted(
        (one["measures"] | {"": one["episode"]} for one in episodes), key=lambda one: str(one[""])
    )
    joints = dict.fromkeys(joint for one in ordered for joint in one.get("zero", {}))
    panels = []
    for name, label in _PANELS.items():
        values = {j: np.array([one.get(name, {}).get(j) for one in ordered], dtype=float) for j in joints}
        lines = tuple(Line(joint, one, look=_LOOK) for joint, one in values.items())
        panels.append(Panel(label, "", lines, axis="episode"))
    return save_png(draw_panels(None, panels, row_in=2.2), path)
