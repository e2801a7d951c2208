"""A joint that stands through a record, a gripper or an axis that only trembles, says nothing of the others' gap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.arrays import Array
from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.equations.noise_floor import white_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.logs.files import load_log, save_log
from excite.logs.log import Trial
from excite.logs.robot import nominal_robot
from excite.logs.signals.butterworth import noise_bandwidth
from tests.diagnosis.two_joints import COULOMB, NOISE, RATE_HZ, URDF, VISCOUS, moved, two_joint_log

RIPPLE, PERIODS = 0.6, 11


def held(
    name: str, role: str, seconds: float, rng: np.random.Generator, *, ripple: float, load: float
) -> Trial:
    """The first joint moves; the second trembles, and its dry friction takes up whatever it is pressed with."""
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    q = np.zeros((len(time), 2))
    for k, turn in enumerate((0.3, 0.7, 1.3)):
        q[:, 0] += 0.5 / (k + 1) * np.sin(2.0 * np.pi * turn * time + rng.uniform(0.0, 6.28))
    q[:, 1] = 0.4 + _wandering(time, rng, 5e-4)
    v, a = np.gradient(q, time, axis=0), np.gradient(np.gradient(q, time, axis=0), time, axis=0)
    tau = np.array([pin.rnea(model, data, *rows) for rows in zip(q, v, a, strict=True)])
    tau[:, 0] += VISCOUS[0] * v[:, 0] + COULOMB[0] * np.sign(v[:, 0]) + ripple * np.cos(PERIODS * q[:, 0])
    tau[:, 1] += load + _wandering(time, rng, 0.7 * COULOMB[1])
    return Trial(name=name, role=role, time=time, q=q, tau=tau + NOISE * rng.normal(size=q.shape))


def _wandering(time: Array, rng: np.random.Generator, size: float) -> Array:
    """Slow noise, as a controller presses against what sticks."""
    knots = np.arange(0.0, time[-1] + 0.5, 0.5)
    return size * np.interp(time, knots, rng.normal(size=len(knots)))


def diagnosed(folder: Path, *, ripple: float, load: float = 0.0) -> Diagnosis:
    rng = np.random.default_rng(5)
    trials = (
        held("a", "identification", 25.0, rng, ripple=ripple, load=load),
        held("b", "validation", 12.0, rng, ripple=ripple, load=load),
    )
    return diagnose(save_log(two_joint_log(trials), folder))


def test_what_a_standing_joint_leaves_hides_no_effect_of_another(tmp_path: Path) -> None:
    result = diagnosed(tmp_path, ripple=RIPPLE)
    assert (result.verdict, result.effect, result.location) == ("effect", "torque_ripple", "first")
    parameters = result.effects[0].parameters
    assert np.hypot(parameters["cosine"].value, parameters["sine"].value) == pytest.approx(RIPPLE, rel=0.1)
    assert result.budget is not None
    assert result.budget.channels["second"].weight == 0.0
    # The gap of the whole is the moving joint's.
    assert result.gap.share_closed > 0.9


@pytest.mark.parametrize("load", [0.0, 0.5])
def test_what_holds_a_standing_joint_is_no_effect(tmp_path: Path, load: float) -> None:
    """A constant that friction takes up is no bias, and what wanders is no gap."""
    result = diagnosed(tmp_path, ripple=0.0, load=load)
    assert result.verdict == "none"
    assert not any(item.location == "second" for item in result.effects)


QUIET, LOUD = 0.004, 0.2


def paused(name: str, role: str, seconds: float, rng: np.random.Generator) -> Trial:
    """Motions of three seconds with twice as long a rest after each; in motion the torques are fifty times as noisy."""
    pieces = [moved(name, role, 3.0, rng, np.eye(2)) for _ in range(round(seconds / 9.0))]
    rest = 6 * RATE_HZ
    q, tau = [], []
    for piece in pieces:
        assert piece.tau is not None
        q += [piece.q, np.zeros((rest, 2))]
        tau += [piece.tau + LOUD * rng.normal(size=piece.q.shape), np.tile(piece.tau[0], (rest, 1))]
    noise = QUIET * rng.normal(size=(len(pieces) * 9 * RATE_HZ, 2))
    time = np.arange(len(noise)) / RATE_HZ
    return Trial(name=name, role=role, time=time, q=np.vstack(q), tau=np.vstack(tau) + noise)


def test_the_noise_of_a_joint_is_told_where_it_moves(tmp_path: Path) -> None:
    """A motor at rest is quiet: what its rests show of noise would make a gap of that of its motion."""
    rng = np.random.default_rng(8)
    made = two_joint_log((paused("a", "identification", 72.0, rng), paused("b", "validation", 36.0, rng)))
    log = load_log(save_log(made, tmp_path / "log"))
    samples = arm_samples(nominal_robot(log), log, log.trials)
    true = np.hypot(LOUD, NOISE) * np.sqrt(noise_bandwidth(RATE_HZ, samples.bands.rows_hz))
    np.testing.assert_allclose(white_floor(samples), true, rtol=0.4)
    assert diagnose(tmp_path / "log").verdict == "none"
