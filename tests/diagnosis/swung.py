"""Records of an arm whose joints swing by sines, written and diagnosed as anybody's would be."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from excite.logs.files import save_log
from excite.logs.log import Trial
from tests.made_log import FRICTION, made_log

ROLES = {"a": "identification", "b": "identification", "c": "validation"}


def swinging(
    t: np.ndarray,
    sizes: np.ndarray,
    frequencies: Sequence[float],
    moving: Sequence[int],
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions about zero, velocities and accelerations, ``(n, n_joints)`` each; those of other joints are zero."""
    q, v, a = (np.zeros((len(t), len(sizes))) for _ in range(3))
    for j in moving:
        for k, hertz in enumerate(frequencies):
            w, size = 2.0 * np.pi * hertz * (1.0 + 0.13 * j), sizes[j] / (k + 1)
            phase = w * t + rng.uniform(0.0, 2.0 * np.pi)
            q[:, j] += size * np.sin(phase)
            v[:, j] += size * w * np.cos(phase)
            a[:, j] -= size * w**2 * np.sin(phase)
    return q, v, a


def diagnosed_trials(
    folder: Path, urdf: str, joints: Sequence[str], rate_hz: int, trials: tuple[Trial, ...]
) -> Diagnosis:
    """The diagnosis of trials of an arm on a fixed base, its friction fitted and its bodies the model's."""
    return diagnose(
        save_log(
            made_log(trials, joints, rate_hz, urdf, modelled=["rigid_body_fixed", *FRICTION]), folder / "log"
        )
    )
