"""The motion of a link behind a gear, against closed forms and an integrator that is not ours."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from excite.diagnosis.effects.gears.gear import DrivenLink, Gear
from excite.diagnosis.effects.gears.gear_effect import integrate_deflection


def deflected(*values) -> np.ndarray:
    """What lies behind a gear (load, slopes, inertia, curves), starts, beginning, step, then the gear itself."""
    return integrate_deflection(DrivenLink(*values[:6]), Gear(*values[9:]), *values[6:9])


def quiet(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Marks of one trial of n samples, and no change of its load."""
    starts = np.zeros(n, dtype=bool)
    starts[0] = True
    return starts, np.zeros(n)


def test_gravity_takes_part_in_the_deflection() -> None:
    """A load that grows as the link turns stiffens the gear: ``(k + ∂τ/∂q) δ = −τ``, and it swings the faster."""
    n, dt, load, stiffness, turn, inertia = 800, 0.005, 3.0, 90.0, 60.0, 0.4
    starts, none = quiet(n)
    gear = (np.full(n, inertia), none, none, starts)
    still = deflected(
        np.full(n, load), np.full(n, turn), none, *gear, np.zeros((1, 2)), dt, stiffness, 0.0, 0.0
    )
    np.testing.assert_allclose(still[0], -load / (stiffness + turn), rtol=1e-9)
    begin = np.array([[0.02, 0.1]])
    swung = deflected(none, np.full(n, turn), none, *gear, begin, dt, stiffness, 0.0, 0.0)[0]
    w = np.sqrt((stiffness + turn) / inertia)
    t = np.arange(200) * dt
    np.testing.assert_allclose(swung[:200], 0.02 * np.cos(w * t) + 0.1 / w * np.sin(w * t), atol=2e-4)


def test_a_gear_that_cannot_hold_its_link_stays_finite() -> None:
    n = 4000
    starts, none = quiet(n)
    gear = (np.full(n, 0.3), none, none, starts, np.zeros((1, 2)), 0.005, 10.0, 0.1, 0.0)
    fallen = deflected(np.full(n, 1.0), np.full(n, -50.0), none, *gear)
    assert np.isfinite(fallen).all()


def test_a_round_contact_gives_way_as_two_spheres_do() -> None:
    n, load, stiffness, gap, depth = 3000, 5.0, 400.0, 0.01, 0.004
    starts, none = quiet(n)
    rest = np.zeros((1, 2))
    gear = (stiffness, 8.0, gap, 0.0, 0.0, depth)
    x = deflected(np.full(n, load), none, none, np.full(n, 0.3), none, none, starts, rest, 0.005, *gear)[0]
    assert x[-1] == pytest.approx(-gap - (load * np.sqrt(depth) / stiffness) ** (2.0 / 3.0), rel=1e-4)


def test_contacts_push_and_do_not_pull() -> None:
    """A link thrown off a flank leaves it as fast as it is: the damper of the contact does not hold it back."""
    n, dt, stiffness, gap = 40, 0.005, 400.0, 0.05
    starts, none = quiet(n)
    # At rest it lies on the other flank.
    begin = np.array([[2.0 * gap + 1e-4, -1.0]])
    behind = (none, none, none, np.full(n, 0.3), none, none)
    x = deflected(*behind, starts, begin, dt, stiffness, 500.0, gap)[0]
    assert x[10] == pytest.approx(gap + 1e-4 - 10 * dt, rel=0.05, abs=5e-3)


def test_a_pendulum_behind_a_soft_gear_swings_as_its_own_equation_says() -> None:
    """``m l² δ̈ = −m g l sin(q + δ) − k δ`` about a motor that stands, to second order and to first."""
    n, dt, q, weight, inertia, stiffness = 400, 0.005, 0.6, 6.0, 0.3, 40.0
    starts, none = quiet(n)
    rest = brentq(lambda x: weight * np.sin(q + x) + stiffness * x, -1.0, 1.0)
    swing = solve_ivp(
        lambda _, y: [y[1], (-weight * np.sin(q + y[0]) - stiffness * y[0]) / inertia],
        (0.0, n * dt),
        [rest + 0.1, 0.0],
        t_eval=np.arange(n) * dt,
        rtol=1e-10,
        atol=1e-12,
    ).y[0]
    load, turn, bent = (np.full(n, weight * f(q)) for f in (np.sin, np.cos, lambda x: -np.sin(x)))
    off = []
    for curve in (none, bent):
        at_rest = deflected(
            load,
            turn,
            none,
            np.full(n, inertia),
            curve,
            none,
            starts,
            np.zeros((1, 2)),
            dt,
            stiffness,
            9.0,
            0.0,
        )[0, -1]
        begin = np.array([[rest + 0.1 + load[0] / (stiffness + turn[0]), 0.0]])
        x = deflected(
            load, turn, none, np.full(n, inertia), curve, none, starts, begin, dt, stiffness, 0.0, 0.0
        )[0]
        off.append((abs(at_rest - rest), np.abs(x - swing).max()))
    assert off[1][0] < 0.1 * off[0][0]
    assert off[1][1] < 0.2 * off[0][1]
