"""Stribeck friction is more friction at low speed; what bends the law at high speed is none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.effects.friction import Stribeck
from excite.diagnosis.equations.dry_friction.friction_sign import SignChange
from excite.logs.files import save_log
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import Log, Trial
from tests.diagnosis.test_one_joint import URDF, axis_header

RATE_HZ, NOISE = 200, 0.3


TRIALS = (("a", "identification", 0.7), ("b", "validation", 1.9), ("c", "identification", 0.7))


def logged(folder: Path, further: Callable[[np.ndarray], np.ndarray]) -> Path:
    """Trials of a carriage with mass, viscous and Coulomb friction and more by velocity, up to 1.6 m/s.

    The last one repeats the first.
    """
    rng, t, trials = np.random.default_rng(6), np.arange(20 * RATE_HZ) / RATE_HZ, []
    for name, role, phase in TRIALS:
        waves = [(0.4, 0.31, phase), (0.12, 0.83, 2.0 * phase), (0.015, 2.3, 3.0 * phase)]
        v = sum(a * 2.0 * np.pi * f * np.cos(2.0 * np.pi * f * t + p) for a, f, p in waves)
        q = sum(a * np.sin(2.0 * np.pi * f * t + p) for a, f, p in waves)
        acceleration = sum(-a * (2.0 * np.pi * f) ** 2 * np.sin(2.0 * np.pi * f * t + p) for a, f, p in waves)
        force = 90.0 * acceleration + 60.0 * v + 25.0 * np.tanh(v / 0.02) + further(v)
        force += NOISE * rng.standard_normal(len(t))
        trials.append(Trial(name, role, t, q[:, None], tau=force[:, None]))
    header = axis_header(RATE_HZ, ("rigid_body", "viscous_friction", "coulomb_friction"), ("a", "b"))
    again = TrialHeader(file="c.parquet", role="identification", repeats="a.parquet")
    header = header.model_copy(update={"trials": (*header.trials, again)})
    return save_log(Log(header, tuple(trials), robot_text=URDF), folder / "axis")


def test_friction_that_falls_with_speed_is_named(tmp_path: Path) -> None:
    result = diagnose(logged(tmp_path, lambda v: 15.0 * np.exp(-((v / 0.09) ** 2)) * np.tanh(v / 0.02)))
    assert (result.verdict, result.effect) == ("effect", "stribeck")
    values = result.effects[0].parameters
    assert values["excess"].value == pytest.approx(15.0, rel=0.2)
    assert values["velocity"].value == pytest.approx(0.09, rel=0.15)


def test_drag_that_sets_in_at_high_speed_is_no_stribeck_friction(tmp_path: Path) -> None:
    result = diagnose(logged(tmp_path, lambda v: 90.0 * np.maximum(np.abs(v) - 0.5, 0.0) ** 2 * np.sign(v)))
    assert (result.verdict, result.location) == ("unknown", "slide")


def test_what_leaves_no_dry_friction_at_higher_speed_is_none_either() -> None:
    """Drag above some speed, told by viscous friction and less than no Coulomb friction, looks like it."""
    names = ("rigid_body", "coulomb_friction")
    base = SimpleNamespace(modelled=names, signs=(SignChange(0.01),))
    context = SimpleNamespace(baseline=base, row=lambda location: 0, v=np.zeros((9, 1)))

    def settled(coulomb: float) -> bool:
        fit = SimpleNamespace(own_coefs=np.array([[coulomb]]), extra=np.array([7.0]))
        return Stribeck().is_within_scope(context, "slide", (0.3,), fit)

    assert settled(5.0)
    # Below none by no more than the forms of the law differ.
    assert settled(-0.3)
    assert not settled(-8.0)


@pytest.mark.parametrize(("sign", "slowest"), [(SignChange(4e-3), 0.01), (SignChange(1e-4), 5e-3)])
def test_a_velocity_as_slow_as_may_be_is_how_a_joint_sticks(sign: SignChange, slowest: float) -> None:
    """2.5 widths of the change of sign, or the slowest that is searched: there the search would go on."""
    base = SimpleNamespace(modelled=("coulomb_friction",), signs=(sign,))
    context = SimpleNamespace(baseline=base, row=lambda location: 0, v=np.ones((9, 1)))
    fit = SimpleNamespace(own_coefs=np.array([[5.0]]), extra=np.array([7.0]))
    assert [Stribeck().is_within_scope(context, "slide", (s * slowest,), fit) for s in (1.0, 1.012, 1.1)] == [
        False,
        False,
        True,
    ]


@pytest.mark.parametrize(
    ("velocity", "exponent"), [(0.6, 2.0), pytest.param(0.45, 1.0, marks=pytest.mark.battery)]
)
def test_friction_that_falls_over_most_speeds_is_named(
    tmp_path: Path, velocity: float, exponent: float
) -> None:
    result = diagnose(
        logged(tmp_path, lambda v: 20.0 * np.exp(-((np.abs(v) / velocity) ** exponent)) * np.tanh(v / 0.02))
    )
    assert (result.verdict, result.effect) == ("effect", "stribeck")
    values = result.effects[0].parameters
    assert values["excess"].value == pytest.approx(20.0, rel=0.08)
    assert values["velocity"].value == pytest.approx(velocity, rel=0.08)


def test_of_a_slow_joint_no_stribeck_velocity_is_searched_beyond_its_speed() -> None:
    fit = SimpleNamespace(own_coefs=np.array([[5.0]]), extra=np.array([7.0]))
    for speed, told in ((0.1, False), (1.5, True)):
        context = SimpleNamespace(
            baseline=SimpleNamespace(modelled=("coulomb_friction",), signs=(SignChange(0.01),)),
            row=lambda location: 0,
            v=np.full((9, 1), speed),
        )
        assert Stribeck().is_within_scope(context, "slide", (0.6,), fit) == told
        assert (max(Stribeck().search_grid(context, "slide")) > (0.45,)) == told
