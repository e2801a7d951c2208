"""A delay of the torques of a fast, stiff finger that sticks where it turns round."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.logs.files import save_log
from excite.logs.log import Trial
from tests.made_log import FRICTION, made_log

RATE_HZ, INNER, SECONDS, DELAY = 500, 8, 8, 0.006
MASS, CENTRE, INERTIA, ROTOR = 0.05, 0.03, 2.2e-5, 5e-4
VISCOUS, COULOMB, WIDTH, NOISE = 1e-3, 0.03, 0.02, 0.002
URDF = f"""<robot name="finger">
  <link name="palm"/>
  <link name="tip"><inertial><origin xyz="{CENTRE} 0 0"/><mass value="{MASS}"/>
    <inertia ixx="4e-6" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="knuckle" type="revolute"><parent link="palm"/><child link="tip"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="5" velocity="60"/></joint>
</robot>
"""


def driven(name: str, role: str, seed: int) -> Trial:
    """A finger on a stiff servo, stepped finely, its torque logged late."""
    rng = np.random.default_rng(seed)
    dt, n = 1.0 / (RATE_HZ * INNER), SECONDS * RATE_HZ * INNER
    t = dt * np.arange(n)
    waves = zip((0.4, 1.0, 2.1, 3.7), rng.uniform(0.0, 2.0 * np.pi, 4), strict=True)
    aim = sum(0.6 / (k + 1) * np.sin(2.0 * np.pi * f * t + p) for k, (f, p) in enumerate(waves))
    aim = 0.3 + aim * np.sin(0.5 * np.pi * np.clip(np.minimum(t, SECONDS - t), 0.0, 1.0)) ** 2
    fast = np.gradient(aim, dt)
    q, v, inertia = float(aim[0]), 0.0, INERTIA + ROTOR + MASS * CENTRE**2
    logged, torque = np.empty(n), np.empty(n)
    for k in range(n):
        logged[k] = q
        # About y a link along x falls with growing angle.
        weight = -MASS * 9.81 * CENTRE * np.cos(q)
        torque[k] = 3.0 * (aim[k] - q) + 0.03 * (fast[k] - v) + weight
        v += dt * (torque[k] - weight - VISCOUS * v - COULOMB * np.tanh(v / WIDTH)) / inertia
        q += dt * v
    late = np.interp(t - DELAY, t, torque)
    time, tau = t[::INNER], late[::INNER, None] + NOISE * rng.normal(size=(n // INNER, 1))
    return Trial(
        name=name, role=role, time=time, q=logged[::INNER, None] + 5e-6 * rng.normal(size=tau.shape), tau=tau
    )


def test_a_delay_is_told_between_reversals(tmp_path: Path) -> None:
    """Of all rows it is a fifth shorter: a filter moves where a velocity that sticks and leaps changes its sign."""
    roles = ("identification", "identification", "identification", "validation")
    trials = tuple(driven(name, role, k) for k, (name, role) in enumerate(zip("abcd", roles, strict=True)))
    log = made_log(trials, ["knuckle"], RATE_HZ, URDF, modelled=["rigid_body_fixed", *FRICTION, "armature"])
    found = diagnose(save_log(log, tmp_path / "finger"))
    assert found.effect == "time_delay"
    delay = found.effects[0].parameters["delay"]
    assert delay.value == pytest.approx(DELAY, rel=0.06)
    assert delay.std is not None
    assert abs(delay.value - DELAY) < 3.0 * delay.std < 0.2 * DELAY
