"""A delay of the torques beside something else, where encoders are noisy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.logs.files import save_log
from excite.logs.log import Trial
from tests.diagnosis.test_base_tilt import CRANE, crane_log

RATE_HZ = 250
DELAY, ROTOR, NOISE = 0.012, 0.15, 2e-5


def late(name: str, role: str, seed: int) -> Trial:
    """A crane whose torques come late, with a rotor that its model has not."""
    model = pin.buildModelFromXML(CRANE)
    data, rng = model.createData(), np.random.default_rng(seed)
    t = np.arange(12 * RATE_HZ) / RATE_HZ
    q, v, a = (np.zeros((len(t), 2)) for _ in range(3))
    for j in range(2):
        for k, hertz in enumerate((0.2, 0.5, 0.9, 1.7)):
            w, size = 2.0 * np.pi * hertz * (1.0 + 0.15 * j), (0.8, 0.4)[j] / (k + 1)
            phase = w * t + rng.uniform(0.0, 2.0 * np.pi)
            q[:, j] += size * np.sin(phase)
            v[:, j] += size * w * np.cos(phase)
            a[:, j] -= size * w**2 * np.sin(phase)
    tau = np.array([pin.rnea(model, data, *rows) for rows in zip(q, v, a, strict=True)])
    tau += 0.3 * v + 0.5 * np.tanh(v / 0.01)
    tau[:, 0] += ROTOR * a[:, 0]
    tau = np.column_stack([np.interp(t - DELAY, t, column) for column in tau.T])
    tau += 0.01 * rng.normal(size=q.shape)
    return Trial(name=name, role=role, time=t, q=q + NOISE * rng.normal(size=q.shape), tau=tau)


def test_a_delay_is_found_beside_a_rotor_with_the_sizes_of_both(tmp_path: Path) -> None:
    """A secant of free size leaned on a longer, smoother delay until no delay was left that could be."""
    trials = (late("a", "identification", 1), late("b", "identification", 2), late("c", "validation", 3))
    log = crane_log(trials, bodies="rigid_body_fixed", rate_hz=RATE_HZ)
    found = {item.effect: item for item in diagnose(save_log(log, tmp_path / "crane")).effects}
    assert set(found) == {"time_delay", "armature"}
    delay, rotor = found["time_delay"].parameters["delay"], found["armature"].parameters["inertia"]
    assert delay.value == pytest.approx(DELAY, abs=3e-4)
    assert delay.std is not None and 0.0 < delay.std < 1e-3
    assert rotor.value == pytest.approx(ROTOR, rel=0.03)
