"""What an identification says of its own limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.campaign.loop import mass_comparison
from excite.identification.changed_segments import ChangedSegment
from excite.identification.estimators.method_settings import estimator_settings
from excite.identification.estimators.registry import find_estimator
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.identify import identify
from excite.identification.judgement import TotalMassReport
from excite.identification.problem import build_problem
from excite.identification.result import (
    Identification,
    _constraints_reached,
    find_doubts,
    find_warnings,
    mass_change,
)
from excite.identification.statistics import base_statistics
from excite.rows.settings import ProblemSettings
from tests.identification.practice_log import arm_log, changed

SETTINGS = ProblemSettings(cutoff_hz=5.0)


def doubts(robot, log, method: str) -> dict:
    problem = build_problem(robot, log, SETTINGS)
    estimate = find_estimator(method).estimate(problem, estimator_settings(method))
    spread = EstimatorSettings().spreads(robot)
    return {item.kind: item for item in find_doubts(estimate, base_statistics(estimate.regression), spread)}


def test_a_joint_that_hardly_moves_leaves_directions_unexcited(ur10):
    log = arm_log(ur10, 0, trials=3)
    slack = np.ones(ur10.n_joints)
    slack[4:] = 0.002
    lazy = changed(log, lambda t: replace(t, q=t.q.mean(axis=0) + slack * (t.q - t.q.mean(axis=0))))
    rich, poor = doubts(ur10, log, "wls"), doubts(ur10, lazy, "wls")
    found = poor["unexcited"]
    assert any("wrist" in name for name in found.places)
    before = rich["unexcited"].figures["directions"] if "unexcited" in rich else 0
    assert found.figures["directions"] > before


def test_friction_that_drives_puts_constraints_in_conflict_with_least_squares(ur10):
    """Torques that grow against the velocity; a method that asks for friction cannot follow them."""
    log = arm_log(ur10, 0, trials=3)
    push = np.zeros(ur10.n_joints)
    push[1] = 20.0
    driven = changed(log, lambda t: replace(t, tau=t.tau - push * np.gradient(t.q, t.time, axis=0)))
    found = doubts(ur10, driven, "qp")
    assert found["conflict"].figures["standard_deviations"] > 5.0
    assert any("viscous" in name for name in found["conflict"].places)
    assert ("friction does not follow" in found["conflict"].text) == all(
        name.startswith(("viscous", "coulomb", "offset", "armature")) for name in found["conflict"].places[:4]
    )
    assert any("viscous" in name for name in found["at_bound"].places)
    assert "conflict" not in doubts(ur10, log, "qp")


def test_least_squares_does_not_contradict_itself(ur10):
    assert "conflict" not in doubts(ur10, arm_log(ur10, 0, trials=3), "wls")


def test_forces_that_disagree_with_the_known_mass_are_named(ur10):
    result = identify(ur10, arm_log(ur10, 0, trials=2), "wls", problem_settings=SETTINGS)

    def said(measured: float, weighed: float | None, std: float = 0.05, *, torques: bool = False) -> str:
        mass = TotalMassReport(35.0, 35.0, measured, std, weighed, torques)
        found = find_warnings(replace(result, total_mass=mass))
        return next((item.text for item in found if item.kind == "force_scale"), "")

    assert "exerts" in said(-34.0, None)
    assert "gain" in said(35.0 / 2.0, None)
    assert "the scale" in said(35.0, 36.0)
    assert said(38.0, None) == said(35.1, 35.0) == ""
    # A quadruped of 40 kg that swayed on its feet was told to weigh -48 ± 11 kg, and to look at wrenches that it lacks.
    assert said(-41.8, None, 9.4) == said(-41.8, None, 9.4, torques=True) == ""
    assert "wrench" not in said(-34.0, None, torques=True)
    assert "sign" in said(-34.0, None, torques=True)
    assert result.to_json()["findings"][0].keys() == {
        *("kind", "text", "figures", "places", "severity", "sure", "repaired", "remedy", "trials")
    }


def test_findings_about_the_log_come_with_the_result(ur10):
    degrees = changed(arm_log(ur10, 0, trials=3), lambda t: replace(t, q=np.degrees(t.q), q_cmd=None))
    kinds = [item.kind for item in identify(ur10, degrees, "wls", problem_settings=SETTINGS).findings]
    assert kinds[0] == "degrees"


def test_a_sound_log_is_not_talked_down(ur10):
    found = identify(ur10, arm_log(ur10, 0, trials=4), "wls", problem_settings=SETTINGS).findings
    odd = {"degrees", "order", "torque_sign", "torque_scale", "torque_side", "conflict", "no_better"}
    assert not odd & {item.kind for item in found}


def test_a_changed_segment_that_would_weigh_less_than_nothing_is_called_no_body(ur10):
    result = identify(ur10, arm_log(ur10, 0, trials=2), "wls", problem_settings=SETTINGS)
    link, mass = result.links[-1], float(result.nominal[-10])

    def judged(change: float, std: float) -> Identification:
        segment = ChangedSegment("tool", link, change, std, 50.0, ())
        judged = replace(result, changes=replace(result.changes, segments=(segment,)))
        return replace(judged, findings=find_warnings(judged))

    def said(change: float, std: float) -> list[str]:
        return [item.text for item in judged(change, std).findings if item.kind == "weightless"]

    assert said(-0.5 * mass, 0.01) == said(-1.2 * mass, 0.2 * mass) == said(3.0 * mass, 0.01) == []
    (text,) = said(-2.0 * mass, 0.01)
    assert link in text
    assert "torque scale" in text
    # Where it stands as changed, and where masses are drawn, it is not called one either.
    doubted, believed = judged(-2.0 * mass, 0.01), judged(-0.5 * mass, 0.01)
    (line,) = (line for line in doubted.summary().splitlines() if line.startswith("  tool:"))
    assert line.endswith("no such change")
    assert "no such change" not in believed.summary()
    assert "sizes hold if nothing else differs" in believed.summary()
    assert mass_comparison(ur10, believed, None).changed[-1]
    assert not mass_comparison(ur10, doubted, None).changed.any()


@pytest.mark.parametrize(
    ("change", "weighed", "impossible"), [(45.0, 0.4, True), (0.5, 0.4, False), (45.0, None, False)]
)
def test_a_gain_that_the_scale_contradicts_is_called_no_body(ur10, change, weighed, impossible):
    """The scale says how much the whole has gained; another link that is named can have lost what it weighs at most."""
    result = identify(ur10, arm_log(ur10, 0, trials=2), "wls", problem_settings=SETTINGS)
    segments = (ChangedSegment("tool", result.links[-1], change, 0.1, 50.0, ()),)
    mass = result.total_mass
    mass = replace(
        mass, weighed=None if weighed is None else mass.nominal + weighed, measured=None, measured_std=None
    )
    judged = replace(result, changes=replace(result.changes, segments=segments), total_mass=mass)
    found = find_warnings(judged)
    judged = replace(judged, findings=found)
    assert ("overweight" in {item.kind for item in found}) is impossible
    assert ("no such change" in judged.summary()) is impossible


def test_one_constraint_holds_and_two_hold():
    one, two = (next(_constraints_reached(("total_mass:robot",) * n)).text for n in (1, 2))
    assert one.startswith("1 constraint holds with") and two.startswith("2 constraints hold with")


def test_a_centre_of_mass_is_said_along_the_axes_that_show_it() -> None:
    def said(*std: float) -> str:
        item = ChangedSegment("tool", "tool", 0.254, 4e-4, 50.0, (), (0.01, -3.0, 0.092), std)
        return mass_change(item).partition(" at ")[2] or mass_change(item)

    assert said(3e-4, 72.0, 2e-4) == "(0.010, –, 0.092) ± 0.0003 m from its joint (– is not determined)"
    assert said(3e-4, 4e-4, 2e-4) == "(0.010, -3.000, 0.092) ± 0.0004 m from its joint"
    assert said(3.0, 4.0, 2.0).endswith("where is not determined")
