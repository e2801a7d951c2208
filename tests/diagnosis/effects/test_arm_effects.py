"""What every effect of arms promises: law, places, columns in the units that it states, and its form in MuJoCo."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import mujoco
import numpy as np
import pytest

from excite.arrays import Array
from excite.diagnosis.answer.effect_summary import effect_summaries
from excite.diagnosis.effects.bodies import BaseTilt, KnownLeverTilt, LinkLengthError, Payload, SteepTilt
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.forces import LowerSlackSpring, RippleHarmonics, SlackSpring, TorqueRipple
from excite.diagnosis.effects.form import Absence, Context, JointStep, Note, Sizes
from excite.diagnosis.effects.friction import (
    Stribeck,
    StribeckBristles,
    StribeckExponent,
    StribeckExponential,
)
from excite.diagnosis.effects.gears.backlash import Backlash, DampedBacklash, RoundBacklash, SoftBacklash
from excite.diagnosis.effects.gears.gear_effect import HardeningElasticity, JointElasticity
from excite.diagnosis.effects.readings import EncoderOffset, TimeDelay
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline, Derived
from excite.diagnosis.equations.dry_friction.friction_sign import SignChange
from excite.diagnosis.servo.diagnose import LoggedOffset
from excite.diagnosis.simulator.augmented_plant import FoundEffect, augmented_model, read_notes
from excite.logs.vocabulary import EFFECTS as WORDS
from tests.diagnosis.effects.arm_record import Case, baseline, forms, place

FORMS = forms()
# Share of a joint's torques that an effect's columns are given, where nothing else is said below.
_SHARE = 0.25
# Parameters where a share of the torques would be no such thing, or would not show it in this record. Secants are taken
# at the size itself; gears have to give way by degrees; a body has to be one that can be; a tilt turns gravity.
_BODY = (0.6, 0.06, 0.01, 0.02, 0.01, 0.0, 0.02, 0.0, 0.0, 0.02)
SIZES: dict[type[Effect], tuple[Theta, tuple[float, ...]]] = {
    EncoderOffset: ((math.exp(0.1),), (0.1,)),
    TimeDelay: ((0.03,), (0.03,)),
    Payload: ((), _BODY),
    LinkLengthError: ((), (0.02, 0.015, 0.02)),
    BaseTilt: ((), (0.6, 0.3, 0.2, 0.1)),
    KnownLeverTilt: ((), (0.6, 0.3)),
    SteepTilt: ((), (0.6, 0.3, 0.2, 0.1, -0.1)),
    Stribeck: ((0.25,), (1.5,)),
    StribeckExponential: ((0.25,), (1.5,)),
    StribeckExponent: ((0.25, 1.2), (1.5,)),
    StribeckBristles: ((0.25, 2e-3), (3.0, 0.4, 0.0)),
    TorqueRipple: ((13.0,), (2.0, 1.0)),
    RippleHarmonics: ((13.0,), (2.0, 1.0, 0.7, -0.7, 0.1, 0.1)),
    JointElasticity: ((60.0, 0.2), ()),
    HardeningElasticity: ((30.0, 0.2, 0.05), ()),
    SlackSpring: ((0.8,), (8.0,)),
    LowerSlackSpring: ((0.8,), (8.0,)),
    Backlash: ((0.08, 20.0), ()),
    DampedBacklash: ((0.08, 20.0, 1.5), ()),
    SoftBacklash: ((0.08, 6.0, 0.02), ()),
    RoundBacklash: ((0.08, 20.0, 0.8), ()),
}
# Share of what a model without the effect is off that one with it may be off, beside what both are: columns of gears
# and geometry are of first order, and a simulator's steps are not the samples.
_LEFT, _SEEN = 0.15, 3.0


def case(effect: Effect) -> Case:
    """The effect where the record shows it well, with sizes that it shows."""
    location = place(effect)
    if type(effect) in SIZES:
        theta, beta = SIZES[type(effect)]
        return Case(effect, location, theta, np.array(beta))
    context = Context(baseline(drives=effect.term is None))
    grid = EFFECTS[effect.name].search_grid(context, location)
    theta = grid[len(grid) // 2]
    theta = (
        theta
        if len(theta) == len(effect.searched) and effect.extended_forms
        else effect.search_starts(theta)[0]
    )
    return Case(effect, location, theta, _shares(effect, effect.shape(context, location, theta), context))


def _shares(effect: Effect, shape: Shape, context: Context) -> Array:
    """Linear parameters at which each column adds its share of the torques, within bounds."""
    beta = np.zeros(len(effect.linear))
    total = np.sqrt((context.baseline.total**2).mean(axis=0))
    for k, parameter in enumerate(effect.linear):
        most = max(float(np.sqrt((c[:, k] ** 2).mean())) / total[j] for j, c in shape.columns.items())
        beta[k] = np.clip(_SHARE / len(beta) / most, parameter.low, parameter.high)
    return beta


@pytest.mark.parametrize("name", FORMS)
def test_columns_are_torques_of_joints_per_unit_of_its_parameters(name: str) -> None:
    made = case(FORMS[name])
    context, effect = made.context, made.effect
    shape = effect.shape(context, made.location, made.theta)
    n = len(context.v)
    assert shape.columns or shape.offset
    assert set(shape.columns) | set(shape.offset) <= set(range(len(context.joints)))
    for columns in shape.columns.values():
        assert columns.shape == (n, len(effect.linear)) and np.isfinite(columns).all()
    for offset in shape.offset.values():
        assert offset.shape == (n,) and np.isfinite(offset).all()
    assert len(effect.prior_widths) == len(effect.linear)
    for t, parameter in zip(made.theta, effect.searched, strict=True):
        assert parameter.low <= t <= parameter.high
    estimates = effect.to_estimates(context, made.location, made.theta, made.fit)
    assert estimates and all(item.unit and np.isfinite(item.value) for item in estimates.values())


@pytest.mark.parametrize("name", FORMS)
def test_what_follows_the_motion_alone_is_the_same_whatever_else_was_found(name: str) -> None:
    """Columns that are kept with a motion are not made again when friction, bodies or gains are found."""
    made = case(FORMS[name])
    base = made.context.baseline
    more = 0.2 * base.rigid
    other = replace(
        base,
        signs=tuple(SignChange(0.02, 1e-3) for _ in base.signs),
        rigid=base.rigid + more,
        added=base.added + more,
        total=1.3 * base.total,
    )
    before = made.effect.shape(made.context, made.location, made.theta)
    # Nothing that the first context has kept is found again.
    object.__setattr__(other, "derived", Derived(base.samples.trials, base.phi))
    after = made.effect.shape(Context(other), made.location, made.theta)
    alike = all(
        np.allclose(values, now[j], rtol=1e-6, atol=1e-9)
        for values_of, now in ((before.columns, after.columns), (before.offset, after.offset))
        for j, values in values_of.items()
    )
    assert alike or not made.effect.by_motion


def fitted_beside(base: Baseline, found: FoundEffect) -> Baseline:
    """The baseline as a fit beside an effect leaves it: a joint's drive is in units of the channel that reads it."""
    form, j = found.mujoco_form(base.samples.joints), found.location
    if form.reads == 1.0:
        return base
    own = [
        form.reads * values if joint == j else values
        for joint, values in zip(base.samples.joints, base.fit.own_coefs, strict=True)
    ]
    return replace(base, fit=replace(base.fit, held=tuple(own)))


@pytest.mark.parametrize("name", FORMS)
def test_a_model_with_it_follows_the_record_that_its_columns_say(name: str) -> None:
    """Driven by the torques that the record needs with it, the model, written and loaded again, moves as recorded.

    In SI units, at every joint, whatever of it is in the XML, in the drives or left to the runner.
    """
    made = case(FORMS[name])
    base, found = made.context.baseline, made.found
    model = augmented_model(fitted_beside(base, found), [found])
    plain = augmented_model(base, ()).xml
    if found.reason_of_absence is not None:
        assert found.mujoco_form(base.samples.joints).absent in Absence
        assert found.reason_of_absence in model.warnings
        return
    assert model.warnings == ()
    missed = made.errors(plain, extra=np.zeros_like(base.total))
    without, with_it = made.errors(plain), made.errors(model.xml)
    assert np.linalg.norm(without) > _SEEN * np.linalg.norm(missed)
    assert np.linalg.norm(with_it) ** 2 < np.linalg.norm(missed) ** 2 + (_LEFT * np.linalg.norm(without)) ** 2


def acts(note: Note) -> dict[Absence, bool]:
    """By what a model cannot say, whether the note says such a thing."""
    there = JointStep(carried=lambda: np.ones(1), q=np.array([0.1]), v=np.array([0.1]))
    return {
        Absence.FRICTION: note.has_friction,
        Absence.SPRING: note.joint_torque(there) != 0.0,
        Absence.CHANNEL: note.late_by > 0.0 or note.filter_before > 0.0,
        Absence.READING: note.log_offset != 0.0,
        Absence.START: note.resting_deflection(1.0) is not None,
    }


@pytest.mark.parametrize("name", FORMS)
def test_what_is_left_to_the_runner_is_read_as_it_was_written_and_has_a_reason(name: str) -> None:
    made = case(FORMS[name])
    form = made.found.mujoco_form(made.context.joints)
    model = mujoco.MjModel.from_xml_string(augmented_model(made.context.baseline, [made.found]).xml)
    read = read_notes(model)
    assert [(item.word, item.place, item.note.to_text()) for item in read] == [
        (item.word, item.place, item.note.to_text()) for item in form.notes
    ]
    for noted, again in zip(form.notes, read, strict=True):
        assert type(noted.note) is type(again.note)
        assert acts(noted.note)[noted.note.beyond]


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_it_says_what_it_is_where_it_can_be_and_what_it_looks_like(effect: Effect) -> None:
    context = Context(baseline(drives=effect.term is None))
    links = {f.name for f in context.baseline.samples.robot.model.frames}
    places = effect.locations(context)
    assert places and set(places) <= {*context.joints, *links, "torque", "base"}
    (summary,) = (s for s in effect_summaries() if (s.name, s.base) == (effect.name, "fixed"))
    assert len(summary.law.split()) > 3 and summary.told_apart_by and summary.mujoco
    assert summary.looks_like
    known = {*WORDS, *EFFECTS}
    related = (effect.confusable_with, effect.twins_without_torque, effect.twins_of_a_gain)
    for name in (name for names in related for name in names):
        assert name in known and name != effect.name
    for form in (*effect.extended_forms, *effect.variant_forms):
        assert form.name == effect.name
    asked = ("rigid_body_fixed",) if effect.term is None else effect.term.words
    assert not effect.is_candidate((*asked, effect.name))


class Formless(Effect):
    """``τ = c q v``: nobody has given it a form."""

    name = "formless"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("coefficient", "N·m·s/rad²"),)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: (context.q[:, j] * context.v[:, j])[:, None]})


def test_an_effect_without_a_form_is_said_to_have_none() -> None:
    item = FoundEffect(Formless(), "elbow", {"coefficient": 1.0})
    base = baseline(drives=True)
    assert item.reason_of_absence is not None and item.reason_of_absence.startswith(
        "formless has no form in a simulator"
    )
    model = augmented_model(base, [item])
    assert model.warnings == (item.reason_of_absence,)
    assert model.xml == augmented_model(base, ()).xml


def test_only_what_an_effect_leaves_to_a_runner_is_noted() -> None:
    with pytest.raises(TypeError, match="formless"):
        Formless().make_note(Sizes("elbow", {}))


def test_an_offset_that_the_servo_does_not_have_is_left_to_the_runner() -> None:
    offset = {"offset": 0.1}
    form = LoggedOffset({"elbow": 100.0}, "none").in_mujoco(Sizes("elbow", {**offset, "in_log_only": 0.1}))
    assert [item.note.log_offset for item in form.notes] == [0.1]
    assert EncoderOffset().in_mujoco(Sizes("elbow", offset)).notes == ()
