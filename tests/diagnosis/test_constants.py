"""A body is not named for constants of the joints that it takes up."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from excite.diagnosis.equations.joint_torque import Equations, Solver
from excite.diagnosis.search.attribution import Scored
from excite.diagnosis.search.constants import beyond_constants
from excite.diagnosis.search.hypotheses import Columns, Hypothesis

N = 800


def scored(baseline: SimpleNamespace, columns: np.ndarray, name: str, *, moves: bool) -> Scored:
    effect = SimpleNamespace(
        name=name,
        moves=moves,
        timing=False,
        linear=(name,) * columns.shape[2],
        widths=np.full(columns.shape[2], np.inf),
        searched=(),
    )
    fit = baseline.solver.fit(columns)
    hypothesis = Hypothesis(effect, "a", (), Columns(columns, None), fit, baseline)
    power = np.ones((3, 2))
    return Scored(hypothesis, 500.0, 100.0, np.ones(3), 0.1, 0.5, 0, 0.0, power, 200.0 * power, 0, 9.0, 0.0)


def ranked(constants: float, weight: float, modelled: tuple[str, ...] = (), *, parameters: int = 3) -> str:
    """What is named of a body that all joints feel and of a gain of the first joint, by what there is."""
    rng = np.random.default_rng(0)
    motion = rng.normal(size=(3, N))
    # A body's weight is about the same in all postures: a constant, and a little of the motion.
    body = np.stack([(1.0 + 0.3 * motion[j])[:, None] * np.eye(3)[j] for j in range(3)])
    body = body if parameters == 3 else body.sum(axis=2, keepdims=True)
    gain = np.zeros((3, N, 1))
    gain[0, :, 0] = rng.normal(size=N)
    y = 0.3 * gain[:, :, 0] + rng.normal(size=(3, N)) * 0.2
    y[1:] += constants
    y += weight * body.sum(axis=2)
    own = tuple(rng.normal(size=(N, 1)) for _ in range(3))
    equations = Equations(
        np.zeros((3, N, 0)), own, y, np.ones(N, bool), np.zeros(N, dtype=int), np.full(3, 1e-6)
    )
    bands = SimpleNamespace(rows_hz=50.0, rate_hz=100.0)
    baseline = SimpleNamespace(
        solver=Solver(equations),
        samples=SimpleNamespace(identification=np.ones(N, bool), bands=bands),
        root_weight=np.ones((3, N)),
        modelled=modelled,
    )
    items = [
        scored(baseline, body, "payload", moves=True),
        scored(baseline, gain, "torque_gain", moves=False),
    ]
    items.sort(key=lambda s: s.hypothesis.loss)
    assert items[0].name == "payload"
    return beyond_constants(baseline, items).name


def test_what_constants_explain_is_no_body() -> None:
    assert ranked(constants=0.3, weight=0.0) == "torque_gain"


def test_a_body_that_moves_is_named_all_the_same() -> None:
    assert ranked(constants=0.0, weight=1.0) == "payload"


def test_one_parameter_makes_up_no_constant_of_each_joint() -> None:
    assert ranked(constants=0.5, weight=0.0, parameters=1) == "payload"


@pytest.mark.parametrize("name", ["torque_bias", "coulomb_asymmetry"])
def test_constants_that_are_modelled_are_no_nuisance_twice(name: str) -> None:
    assert ranked(constants=0.3, weight=0.0, modelled=(name,)) == "payload"
