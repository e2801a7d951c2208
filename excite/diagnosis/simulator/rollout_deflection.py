"""Where soft and loose gears rest under the torque that they carry."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from excite.diagnosis.simulator.augmented_contacts import SoftPlay


def resting_deflection(values: Mapping[str, float], torque: float) -> float:
    """Deflection of a gear [rad] from the sizes in its note; it opposes a torque [N·m]."""
    if "softness" in values:
        play = SoftPlay(0.5 * values["width"], values["softness"], values["stiffness"], 0.0)
        return -play.deflection(torque)
    if "width" in values:
        return float(-0.5 * np.sign(torque) * values["width"])
    return _stretch(-torque / values["stiffness"], values.get("hardening_at", np.inf))


def _stretch(linear: float, hardening_at: float) -> float:
    """Deflection ``x (1 + (x/x₀)²) = linear`` of a spring that hardens, by Newton's method."""
    x = linear
    for _ in range(30):
        r = x / hardening_at
        x -= (x * (1.0 + r * r) - linear) / (1.0 + 3.0 * r * r)
    return x
