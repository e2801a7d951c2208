"""A channel with a wrong factor: friction that is fitted beside it is the robot's, not what the channel reads of it."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from excite.logs.files import load_log, save_log
from tests.diagnosis.two_joints import COULOMB, VISCOUS, moved, two_joint_log

GAIN = 1.4


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Diagnosis, str]:
    """The diagnosis of an arm whose second joint reads too much, and the model that it writes."""
    rng, folder = np.random.default_rng(0), tmp_path_factory.mktemp("gain")
    roles = ("identification", "identification", "validation")
    trials = [moved(f"t{k}", role, 16.0, rng, np.eye(2)) for k, role in enumerate(roles)]
    read = tuple(replace(t, tau=t.tau * np.array([1.0, GAIN])) for t in trials)
    # Of bodies that are fitted too, nobody could tell which of two joints reads wrongly.
    modelled = ["rigid_body_fixed", "viscous_friction", "coulomb_friction"]
    log = load_log(save_log(two_joint_log(read, modelled=modelled), folder / "log"))
    result = diagnose(log, out=folder)
    return result, (folder / "augmented.xml").read_text()


def test_friction_beside_a_gain_is_the_robots_and_not_the_readings(found) -> None:
    result, xml = found
    assert [(e.effect, e.location) for e in result.effects] == [("torque_gain", "second")]
    assert result.effects[0].parameters["gain"].value == pytest.approx(GAIN, rel=0.03)
    changes = result.changes[-1]
    assert changes.coulomb["second"] == pytest.approx(COULOMB[1], rel=0.05)
    assert changes.viscous["second"] == pytest.approx(VISCOUS[1], rel=0.1)
    model = mujoco.MjModel.from_xml_string(xml)
    joint = model.joint("second")
    assert model.dof_frictionloss[joint.dofadr[0]] == pytest.approx(COULOMB[1], rel=0.05)
    assert model.dof_damping[joint.dofadr[0]] == pytest.approx(VISCOUS[1], rel=0.1)
