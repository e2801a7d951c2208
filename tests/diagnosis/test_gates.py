"""What an effect must reach to be named, beside those that are named already."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from excite.diagnosis.search.attribution import Scored
from excite.diagnosis.search.gates import Gates

JOINTS = ("a", "b", "c")


def scored(
    name: str,
    joint: str,
    *,
    moves: bool = False,
    timing: bool = False,
    smooths: bool = False,
    **numbers: float,
) -> Scored:
    """A hypothesis with plain merits, those in ``numbers`` instead where given."""
    effect = SimpleNamespace(
        name=name, moves=moves, timing=timing, smooths=smooths, own_joint=not (moves or timing)
    )
    place = JOINTS.index(joint)
    closed = np.full(3, 0.05)
    closed[place] = numbers.pop("closed", 0.8)
    merits = {
        "evidence": 500.0,
        "validation": 120.0,
        "strength": 0.1,
        "of_rest": 0.3,
        "price": 10.0,
        "stands": 9.0,
        "elsewhere": 0.0,
        "left": 0,
    }
    return Scored(
        hypothesis=SimpleNamespace(
            effect=effect,
            location=joint,
            physical=True,
            settled=numbers.pop("settled", True),
            significant=True,
        ),
        place=place,
        closed=closed,
        power=np.ones((3, 2)),
        count=np.full((3, 2), 200.0),
        **(merits | numbers),
    )


def named(item: Scored, *accepted: Scored) -> bool:
    return Gates().passed_by(item, accepted, JOINTS)


def test_a_small_effect_beside_a_strong_one_on_another_joint_is_named():
    """A spring on one joint leaves nothing at another that could pass for Stribeck friction."""
    spring = scored("joint_spring", "a", strength=0.3)
    assert named(scored("stribeck", "b", strength=0.014), spring)


@pytest.mark.parametrize("rest", [{"moves": True}, {"timing": True}])
def test_what_a_strong_effect_of_all_joints_may_leave_is_not_named(rest: dict):
    strong = scored("link_length_error", "a", strength=0.3, **rest)
    assert not named(scored("stribeck", "b", strength=0.014, stands=2.5), strong)


def test_a_faint_effect_needs_more_evidence():
    """What hardly raises the power above the floor is named for its evidence, on trials left out as well."""
    faint = scored("torque_bias", "b", stands=1.15, evidence=115.0, validation=25.0)
    assert named(faint)
    assert not named(replace(faint, evidence=20.0))
    assert not named(replace(faint, validation=5.0))


def test_a_faint_further_effect_is_not_named_after_one_of_all_joints():
    faint = scored("friction_drift", "c", stands=1.3, evidence=120.0, validation=30.0)
    assert named(faint, scored("torque_bias", "a", strength=0.1))
    assert not named(faint, scored("time_delay", "a", timing=True, strength=0.1))


def test_a_richer_form_is_whole_where_other_joints_feel_the_link():
    """Enough parameters fit half of anything on one joint; what a link does to the others they do not make up."""
    form = scored("joint_elasticity", "b", moves=True, closed=0.6, evidence=3000.0)
    assert not Gates().explained_by(form)
    assert Gates().explained_by(replace(form, elsewhere=1500.0))
    spring = scored("joint_spring", "b", closed=0.6, stands=50.0, elsewhere=1500.0)
    assert not Gates().explained_by(spring)


def test_an_effect_beyond_doubt_needs_no_comparison_with_the_rest():
    """What an approximate first effect leaves on many joints does not hide a clear second one."""
    backlash = scored("backlash", "a", moves=True, strength=0.3)
    bias = scored("torque_bias", "b", strength=0.01, of_rest=0.05, left=4, closed=0.85, evidence=1600.0)
    assert named(replace(bias, validation=280.0), backlash)
    assert not named(replace(bias, validation=280.0, stands=2.0), backlash)
    assert not named(replace(bias, validation=50.0), backlash)


def test_what_one_joint_has_another_may_have_as_well():
    """Load-dependent friction of an elbow beside that of a shoulder, on a machine whose other joints have rests."""
    shoulder = scored("load_dependent_friction", "a", strength=0.02)
    elbow = scored(
        "load_dependent_friction", "b", strength=0.01, of_rest=0.1, left=3, closed=0.65, stands=3.0
    )
    assert named(elbow, shoulder)
    assert not named(elbow, scored("stribeck", "a", strength=0.02))
    assert not named(replace(elbow, closed=np.full(3, 0.3)), shoulder)


def test_what_smooths_is_not_named_for_a_gap_that_hardly_stands():
    """Noise of the encoders is in the model's torque: a small delay or a soft gear takes it out, evidence or not."""
    assert named(scored("payload", "a", moves=True, stands=1.7, closed=0.5))
    assert not named(scored("joint_elasticity", "a", moves=True, smooths=True, stands=1.7, closed=0.5))
    assert named(scored("joint_elasticity", "a", moves=True, smooths=True, stands=3.0, closed=0.5))
    # Where it takes out all of a small gap it is, but not where that is a matter of how well the noise is known.
    assert named(scored("joint_elasticity", "a", moves=True, smooths=True, stands=1.7, closed=0.9))
    assert not named(scored("joint_elasticity", "a", moves=True, smooths=True, stands=1.1, closed=2.0))


def test_a_little_of_what_does_not_repeat_is_no_effect():
    """A repeat that differs as much as the gap makes a floor that any column seems to reach."""
    assert not named(scored("torque_bias", "a", stands=1.0, closed=2.4, of_noise=0.1))
    assert named(scored("friction_drift", "a", stands=1.0, closed=2.4, of_noise=0.8))


def test_a_further_effect_closes_its_own_place():
    spring = scored("joint_spring", "a", strength=0.3)
    assert not named(
        scored("stribeck", "b", closed=0.28, evidence=140.0, validation=55.0, stands=2.4), spring
    )


def test_what_is_below_the_floor_is_no_gap():
    assert named(scored("stribeck", "a", stands=1.2))
    assert not named(scored("stribeck", "a", stands=0.5, closed=5.4))


def test_a_further_body_is_not_named_for_a_trace():
    """Ten parameters take up a little of what friction's law leaves at every joint."""
    rotor = scored("armature", "a", strength=0.3)
    assert named(scored("payload", "b", moves=True, stands=3.0), rotor)
    assert not named(scored("payload", "b", moves=True, stands=1.6), rotor)


def test_a_search_that_ends_at_its_end_names_nothing():
    assert named(scored("stribeck", "a"))
    assert not named(scored("stribeck", "a", settled=False))


def test_a_trifle_at_one_joint_of_many_with_a_little_of_something_is_not_named():
    assert named(scored("torque_ripple", "a", of_rest=0.05, left=2))
    assert not named(scored("torque_ripple", "a", of_rest=0.05, left=3))
    assert named(scored("torque_ripple", "a", of_rest=0.2, left=3))
