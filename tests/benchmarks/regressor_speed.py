"""Speed of the regressors against a Python loop over pinocchio in the same run."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from excite.regressor.base_parameters import structural_base_parameters
from excite.regressor.kernels import base_link_regressor, inverse_dynamics, joint_torque_regressor
from excite.robot.loading import load_robot
from tests.benchmarks.table import Row

_N, _ROUNDS = 1000, 15


@dataclass(frozen=True)
class Duel:
    """Two functions that compute the same, and by what factor ours must be the faster."""

    what: str
    robot: str
    ours: Callable[..., Any]
    peer: Callable[..., Any]
    bar: float


_PEER = pin.computeJointTorqueRegressor
DUELS = (
    Duel("base rows (of the peer: all rows)", "g1", base_link_regressor, _PEER, 8.0),
    Duel("joint torque regressor", "g1", joint_torque_regressor, _PEER, 1.2),
    Duel("joint torque regressor", "panda", joint_torque_regressor, _PEER, 5.0),
    Duel("inverse dynamics", "g1", inverse_dynamics, pin.rnea, 1.0),
    Duel("inverse dynamics", "panda", inverse_dynamics, pin.rnea, 1.0),
)


def rows() -> list[Row]:
    """Speed ratios, in which the machine's own speed cancels, and the time that base parameters take."""
    table = [_fight(duel) for duel in DUELS]
    for name in ("g1", "panda"):
        robot = load_robot(name)
        seconds = _fastest(structural_base_parameters, robot)
        table.append(Row.at_most(f"structural base parameters, {name}", seconds, 1.0, "s"))
    return table


def _fight(duel: Duel) -> Row:
    model = load_robot(duel.robot).model
    random, data = np.random.default_rng(0), model.createData()
    neutral = pin.neutral(model)
    q = np.array([pin.integrate(model, neutral, random.normal(size=model.nv)) for _ in range(_N)])
    v, a = random.normal(size=(2, _N, model.nv))

    def peer() -> None:
        for sample in zip(q, v, a, strict=True):
            duel.peer(model, data, *sample)

    def ours() -> None:
        duel.ours(model, q, v, a)

    # Turn about and as often, so that a machine that is slow for a second is so for both.
    times = np.array([(_fastest(ours, repeats=1), _fastest(peer, repeats=1)) for _ in range(_ROUNDS)])
    best, others = times.min(axis=0)
    what = f"{duel.what}, {duel.robot}, {1e6 * best / _N:.1f} µs a sample: pinocchio in a Python loop / ours"
    return Row.at_least(what, others / best, duel.bar)


def _fastest(action: Callable[..., Any], *arguments: Any, repeats: int = 5) -> float:
    """Shortest of several runs [s], after one that compiles."""
    action(*arguments)
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        action(*arguments)
        times.append(time.perf_counter() - start)
    return min(times)
