"""Gears that give way: the link behind them swings on its own, under gravity, and does so when a trial begins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.logs.files import save_log
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import Trial
from tests.diagnosis.two_joints import COULOMB, NOISE, RATE_HZ, URDF, VISCOUS, two_joint_log

_STEPS, _RUN_IN_S, _SECONDS = 10, 2.0, 10.0

FIRST = np.array([1.0, 0.0])
# Torque that a gear carries at a deflection and its speed [N·m].
Law = Callable[[float, float], float]


@dataclass(frozen=True, eq=False)
class Run:
    """What a robot did, ``(n,)`` and ``(n, 2)``, before any noise."""

    time: np.ndarray
    q: np.ndarray
    motor: np.ndarray

    def read(self, name: str, role: str, noise: int) -> Trial:
        """The trial as its sensors have it."""
        motor = self.motor + NOISE * np.random.default_rng(noise).normal(size=self.motor.shape)
        return Trial(name=name, role=role, time=self.time, q=self.q, tau=motor)


def run(seed: int, law: Law, middle: float, down: np.ndarray) -> Run:
    """A motion whose first joint has its motor before a gear and its link behind; it begins in motion."""
    model = pin.buildModelFromXML(URDF)
    model.gravity.linear = 9.81 * down
    data, rng = model.createData(), np.random.default_rng(seed)
    step = 1.0 / (_STEPS * RATE_HZ)
    fine = np.arange(round((_RUN_IN_S + _SECONDS) / step)) * step
    q = np.zeros((len(fine), 2))
    for j in range(2):
        for k, turn in enumerate((0.3, 0.7, 1.3)):
            w, size, p = 2.0 * np.pi * turn * (1.0 + 0.15 * j), 0.4 / (k + 1), rng.uniform(0.0, 6.28)
            q[:, j] += size * np.sin(w * fine + p)
    q += middle * FIRST
    v = np.gradient(q, fine, axis=0)
    a = np.gradient(v, fine, axis=0)
    rigid, x, s = np.zeros_like(q), 0.0, 0.0
    for i, (angle, speed, gain) in enumerate(zip(q, v, a, strict=True)):
        here, there = angle + x * FIRST, speed + s * FIRST
        load = pin.rnea(model, data, here, there, gain)
        inertia = pin.crba(model, data, here)[:, 0]
        swing = (-law(x, s) - load[0]) / inertia[0]
        rigid[i] = load + inertia * swing
        s += step * swing
        x += step * s
    kept = slice(round(_RUN_IN_S / step), None, _STEPS)
    motor = rigid[kept] + VISCOUS * v[kept] + COULOMB * np.sign(v[kept])
    return Run(fine[kept] - _RUN_IN_S, q[kept], motor)


def logged(folder: Path, law: Law, middle: float = 0.0, down: tuple[float, ...] = (0.0, 0.0, -1.0)) -> Path:
    """Two motions to identify from, the first again, and one to validate with; the first joint about ``middle``."""
    runs = [run(k, law, middle, np.array(down)) for k in (0, 1, 5)]
    trials = [one.read(f"t{k}", "identification", k) for k, one in enumerate(runs[:2])]
    trials += [runs[0].read("again", "identification", 8), runs[2].read("other", "validation", 9)]
    log = two_joint_log(tuple(trials), gravity=[9.81 * x for x in down])
    again = TrialHeader(file="again.parquet", role="identification", repeats="t0.parquet")
    entries = (*log.header.trials[:2], again, log.header.trials[3])
    log = replace(log, header=log.header.model_copy(update={"trials": entries}))
    return save_log(log, folder / "two")


def test_a_soft_gear_that_swings_when_a_trial_begins(tmp_path: Path) -> None:
    """80 N·m/rad before a link of some 0.25 kg·m²: 3 Hz, damped so little that it swings for seconds.

    Roll-outs begin as the gear swings, not at rest under its load, and stay near the record.
    """
    result = diagnose(logged(tmp_path, lambda x, s: 80.0 * x + 0.5 * s))
    assert (result.verdict, result.effect, result.location) == ("effect", "joint_elasticity", "first")
    assert result.effects[0].parameters["stiffness"].value == pytest.approx(80.0, rel=0.03)
    assert result.gap.share_closed > 0.97
    assert result.simulation is not None
    before, after = (
        np.sqrt(sum(e**2 for e in side.values()))
        for side in (result.simulation.before, result.simulation.after)
    )
    assert after < 0.3 * before


@pytest.mark.parametrize(
    ("stiffness", "damping"), [(30.0, 0.2), pytest.param(45.0, 0.3, marks=pytest.mark.battery)]
)
def test_a_gear_so_soft_that_its_link_turns_gravity_with_it(
    tmp_path: Path, stiffness: float, damping: float
) -> None:
    """It gives way by a fifth of a radian: not first order, and the link that fits without it is no help."""
    result = diagnose(logged(tmp_path, lambda x, s: stiffness * x + damping * s))
    assert (result.verdict, result.effect, result.location) == ("effect", "joint_elasticity", "first")
    assert result.effects[0].parameters["stiffness"].value == pytest.approx(stiffness, rel=0.05)
    assert result.gap.share_closed > 0.97


def test_a_gear_that_hardens_so_much_that_no_linear_one_fits(tmp_path: Path) -> None:
    """Four times as stiff under 3 N·m as at rest: a linear gear of any stiffness makes the misfit greater."""

    def law(x: float, s: float) -> float:
        return 40.0 * x * (1.0 + (x / 0.02) ** 2) + 0.6 * s

    result = diagnose(logged(tmp_path, law, 0.5 * np.pi))
    assert (result.verdict, result.effect, result.location) == ("effect", "joint_elasticity", "first")
    assert result.effects[0].parameters["stiffness"].value == pytest.approx(40.0, rel=0.1)
    assert result.effects[0].parameters["hardening_at"].value == pytest.approx(0.02, rel=0.1)


@pytest.mark.battery
def test_a_gear_nearly_slack_at_rest_is_no_play(tmp_path: Path) -> None:
    """It is told by its law: play with flanks as soft as it is wide comes near."""

    def law(x: float, s: float) -> float:
        return 6.0 * x * (1.0 + (x / 0.03) ** 2) + 0.3 * s

    result = diagnose(logged(tmp_path, law, 0.5 * np.pi))
    assert result.verdict in {"effect", "ambiguous"}
    assert (result.effect, result.location) == ("joint_elasticity", "first")
    assert result.effects[0].parameters["hardening_at"].value == pytest.approx(0.03, rel=0.2)


def test_play_between_round_contacts(tmp_path: Path) -> None:
    """Contacts of ``k b^1.5`` that give way by a good part of the play itself."""

    def law(x: float, s: float) -> float:
        beyond = x - np.clip(x, -0.01, 0.01)
        pull = 1500.0 * beyond * np.sqrt(abs(beyond)) + 8.0 * np.sqrt(abs(beyond)) * s
        return pull if pull * beyond > 0.0 else 0.0

    # It hangs down: its load changes sign.
    result = diagnose(logged(tmp_path, law, 0.5 * np.pi))
    assert (result.verdict, result.effect, result.location) == ("effect", "backlash", "first")
    # Where contact begins and how soft it is are told by one curve.
    assert result.effects[0].parameters["width"].value == pytest.approx(0.02, rel=0.25)
