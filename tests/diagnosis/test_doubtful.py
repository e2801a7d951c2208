"""What a repair left in doubt is named as no effect; what it does not concern still is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.diagnosis.diagnose import diagnose, in_doubt
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.floating.registry import FLOATING_EFFECTS
from excite.doctor.channel_errors import OF_TORQUES
from excite.doctor.doubt import Doubt
from excite.logs.log import Log, Trial
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log, changed

GIVEN = ("rigid_body_fixed", "viscous_friction", "coulomb_friction")


@pytest.fixture(scope="module")
def with_rotor() -> Log:
    """A UR10 as its model says but for a rotor at its elbow, which the log does not know."""
    robot = load_robot("ur10")
    log = arm_log(robot, 3, duration=10.0, true=robot.nominal_parameters)
    header = log.header.model_copy(update={"modelled": GIVEN})

    def added(trial: Trial) -> Trial:
        a = np.gradient(np.gradient(trial.q, trial.time, axis=0), trial.time, axis=0)
        return replace(trial, tau=trial.tau - 0.08 * a + 2.0 * a * np.eye(6)[2])

    return replace(changed(log, added), robot_text=robot.urdf, header=header)


def test_bodies_stay_as_given_where_nothing_of_theirs_is_in_doubt() -> None:
    assert in_doubt(GIVEN, frozenset()) == GIVEN
    assert "rigid_body_fixed" in in_doubt(GIVEN, {Doubt.DELAY})
    for doubt in set(Doubt) - {Doubt.DELAY}:
        words = in_doubt(GIVEN, {doubt})
        assert "rigid_body" in words and "rigid_body_fixed" not in words


@pytest.mark.parametrize("doubt", Doubt)
def test_what_is_in_doubt_takes_some_effects_out_and_leaves_others(doubt: Doubt) -> None:
    words = in_doubt(("rigid_body",), {doubt})
    for library in (EFFECTS, FLOATING_EFFECTS):
        out = {effect.name for effect in library.values() if effect.observed_by & {doubt}}
        assert out and out <= set(words) and set(library) - out
        assert not (set(library) - out) & set(words)


def test_every_doubt_comes_from_a_mistake() -> None:
    assert frozenset().union(*(mistake.leaves for mistake in OF_TORQUES)) == set(Doubt)


def test_torques_in_another_unit_hide_no_rotor_and_are_no_effect(with_rotor: Log) -> None:
    """Given bodies would leave three fifths of every torque, which some effect or other takes up."""
    robot = load_robot("ur10")
    healthy = diagnose(with_rotor, robot)
    assert {(item.effect, item.location) for item in healthy.effects} == {("armature", "elbow_joint")}
    found = diagnose(changed(with_rotor, lambda t: replace(t, tau=2.5 * t.tau)), robot)
    assert [item.kind for item in found.faults] == ["torque_scale"]
    assert {(item.effect, item.location) for item in found.effects} == {("armature", "elbow_joint")}
    assert any("how large forces are" in text for text in found.warnings)
