"""Friction that a model states and torques do not hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.doctor.examine import examine
from excite.finding import Finding
from excite.robot.load import load_robot
from excite.rows.drive_terms import smooth_sign
from tests.identification.practice_log import arm_log, changed


def _missing(name: str, share: float) -> list[Finding]:
    """What is said of a log that holds this share of the friction that the arm's model states at every joint."""
    robot = load_robot(name)
    dry = np.geomspace(6.0, 0.3, robot.n_joints)
    losses = "".join(
        f'<joint name="{joint}"><dynamics damping="{0.5 * size:.4f}" friction="{size:.4f}"/></joint>'
        for joint, size in zip(robot.joint_names, dry, strict=True)
    )
    log = arm_log(robot, 6, torque="link_side", trials=2)

    def rub(trial):
        v = np.gradient(trial.q, trial.time, axis=0)
        return replace(trial, tau=trial.tau + share * dry * (0.5 * v + smooth_sign(v, 0.01)))

    modelled = ("rigid_body", "viscous_friction", "coulomb_friction")
    log = changed(log, rub, torque="motor_side", modelled=modelled)
    stated = replace(robot, urdf=f"<robot>{losses}</robot>")
    return [one for one in examine(stated, log).findings if one.kind == "no_friction"]


@pytest.mark.parametrize("name", ["ur10", "panda"])
def test_a_twentieth_of_the_friction_that_the_model_states_is_noted(name: str) -> None:
    (found,) = _missing(name, 0.05)
    assert found.severity == "note" and len(found.places) > 3
    assert not _missing(name, 1.0)
