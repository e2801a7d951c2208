"""What a joint has of the one before it, and positions that are scaled: a wrist's motor, cross-talk, a gear's ratio."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from excite.logs.files import load_log, save_log
from excite.logs.log import Trial
from tests.diagnosis.two_joints import COULOMB, VISCOUS, moved, two_joint_log

RATIO, CROSSTALK, SCALE = -0.8, 0.12, 1.04
# Velocities of the motors from those of the joints: the second motor turns with the first joint.
COUPLING = np.array([[1.0, 0.0], [RATIO, 1.0]])


def diagnosed(change: Callable[[Trial], Trial], matrix: np.ndarray, folder: Path) -> Diagnosis:
    rng, roles = np.random.default_rng(4), ("identification", "identification", "validation")
    trials = tuple(change(moved(f"t{k}", role, 16.0, rng, matrix)) for k, role in enumerate(roles))
    modelled = ["rigid_body_fixed", "viscous_friction", "coulomb_friction"]
    return diagnose(load_log(save_log(two_joint_log(trials, modelled=modelled), folder / "log")), out=folder)


def test_a_motor_that_turns_with_the_joint_before_it_is_named(tmp_path: Path) -> None:
    found = diagnosed(lambda t: replace(t, tau=t.tau @ COUPLING), COUPLING, tmp_path)
    assert (found.verdict, found.effect, found.location) == ("effect", "coupled_drive", "second")
    sizes = found.effects[0].parameters
    assert sizes["ratio"].value == pytest.approx(RATIO, abs=0.05) and sizes["ratio"].std > 0.0
    assert sizes["coulomb"].value == pytest.approx(COULOMB[1], rel=0.1)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "augmented.xml"))
    assert model.ntendon == 1
    # The joint's own friction is that of the motor, which turns with both.
    assert model.tendon_frictionloss[0] == pytest.approx(COULOMB[1], rel=0.1)
    assert np.allclose(model.tendon_damping[0].reshape(-1)[0], VISCOUS[1], rtol=0.3)


@pytest.mark.parametrize("rotor", [-0.004, -0.002, 0.003])
def test_a_coupled_motor_is_named_with_a_rotor_and_where_links_turn_more_easily(
    rotor: float, tmp_path: Path
) -> None:
    """Links that are a little lighter to turn than modelled make a rotor less than none: no reason to hide friction."""

    def turned(trial: Trial) -> Trial:
        rate = np.gradient(np.gradient(trial.q @ COUPLING[1], trial.time), trial.time)
        return replace(trial, tau=trial.tau @ COUPLING + rotor * rate[:, None] * COUPLING[1])

    found = diagnosed(turned, COUPLING, tmp_path)
    assert (found.verdict, found.effect, found.location) == ("effect", "coupled_drive", "second")
    sizes = found.effects[0].parameters
    assert sizes["coulomb"].value == pytest.approx(COULOMB[1], rel=0.02)
    assert ("inertia" in sizes) is (rotor > 0.0)


@pytest.mark.parametrize(
    ("effect", "parameter", "size", "change"),
    [
        (
            "torque_crosstalk",
            "from_previous",
            CROSSTALK,
            lambda t: replace(t, tau=t.tau @ np.array([[1.0, CROSSTALK], [0.0, 1.0]])),
        ),
        ("position_gain", "gain_error", SCALE - 1.0, lambda t: replace(t, q=t.q * np.array([1.0, SCALE]))),
        # A ratio that is far off is no linear matter.
        ("position_gain", "gain_error", 0.25, lambda t: replace(t, q=t.q * np.array([1.0, 1.25]))),
    ],
)
def test_readings_are_named_with_their_size(
    effect: str, parameter: str, size: float, change: Callable[[Trial], Trial], tmp_path: Path
) -> None:
    found = diagnosed(change, np.eye(2), tmp_path)
    assert (found.verdict, found.effect, found.location) == ("effect", effect, "second")
    assert found.effects[0].parameters[parameter].value == pytest.approx(size, rel=0.1)
