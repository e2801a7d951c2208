"""Friction that warms up: over the session, or in every trial anew."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.logs.files import save_log
from excite.logs.log import Trial
from tests.diagnosis.test_one_joint import URDF
from tests.made_log import made_log

RATE_HZ, SECONDS, PAUSE = 200, 12.0, 20.0
MASS, VISCOUS, COULOMB, NOISE = 80.0, 200.0, 50.0, 0.5
ROLES = ("identification", "identification", "identification", "validation")


def warmed(number: int, share: float, time_constant: float, *, anew: bool, rng: np.random.Generator) -> Trial:
    """A trial of a carriage whose friction has lost ``share`` of itself once it is warm."""
    t = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    waves = [(0.12, 0.35, 0.4 + number), (0.04, 0.9, 2.0 * number), (0.01, 2.1, 1.0 + 3.0 * number)]
    q = sum(a * np.sin(2.0 * np.pi * f * t + p) for a, f, p in waves)
    v = sum(a * 2.0 * np.pi * f * np.cos(2.0 * np.pi * f * t + p) for a, f, p in waves)
    acceleration = sum(-a * (2.0 * np.pi * f) ** 2 * np.sin(2.0 * np.pi * f * t + p) for a, f, p in waves)
    start = number * (SECONDS + PAUSE)
    warm = 1.0 - share * -np.expm1(-(t if anew else t + start) / time_constant)
    force = MASS * acceleration + warm * (VISCOUS * v + COULOMB * np.tanh(v / 0.005))
    force += NOISE * rng.standard_normal(len(t))
    return Trial(f"trial_{number}", ROLES[number], t, q[:, None], tau=force[:, None], start_s=start)


def logged(folder: Path, share: float, time_constant: float, *, anew: bool) -> Path:
    rng = np.random.default_rng(2)
    trials = tuple(warmed(k, share, time_constant, anew=anew, rng=rng) for k in range(len(ROLES)))
    return save_log(
        made_log(
            trials,
            ["slide"],
            RATE_HZ,
            URDF,
            trials=[
                {"file": f"{trial.name}.parquet", "role": trial.role, "start_s": trial.start_s}
                for trial in trials
            ],
        ),
        folder / "axis",
    )


@pytest.mark.parametrize(("anew", "time_constant"), [(True, 4.0), (False, 40.0)])
def test_what_warms_is_named_with_its_pace(tmp_path: Path, anew: bool, time_constant: float) -> None:
    result = diagnose(logged(tmp_path, 0.35, time_constant, anew=anew))
    assert (result.verdict, result.effect, result.location) == ("effect", "friction_drift", "slide")
    values = result.effects[0].parameters
    assert values["time_constant"].value == pytest.approx(time_constant, rel=0.3)
    assert ("in_each_trial" in values) is anew
    end = SECONDS if anew else 3.0 * (SECONDS + PAUSE) + SECONDS
    assert values["relative_change"].value == pytest.approx(0.35 * np.expm1(-end / time_constant), rel=0.05)
    assert result.gap.share_closed > 0.97


def test_friction_that_stays_is_none(tmp_path: Path) -> None:
    assert diagnose(logged(tmp_path, 0.0, 4.0, anew=True)).verdict == "none"
