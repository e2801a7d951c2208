"""What every effect of standing robots promises: law, places, columns, and what a MuJoCo model has of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from excite.arrays import Array
from excite.diagnosis.answer.effect_summary import effect_summaries
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.floating.effect import FloatingEffect, segment_of
from excite.diagnosis.floating.forces import PressedContact, Surface, UnloggedContact
from excite.diagnosis.floating.hypotheses import Fitted, Placed, explained_state, nominal_fit
from excite.diagnosis.floating.problem import Problem, build_problem
from excite.diagnosis.floating.readings import DriveTerm
from excite.diagnosis.floating.record import prepare_record
from excite.diagnosis.floating.registry import EVERY_FORM
from excite.diagnosis.floating.simulator import Simulator, describe_effect, standing_model
from excite.diagnosis.floating.state import State
from excite.errors import InputError
from excite.logs.files import load_log
from excite.logs.vocabulary import EFFECTS as WORDS

FORMS = [word for word, effect in EVERY_FORM.items() if not isinstance(effect, DriveTerm)]
# A TALOS over plates, its nominal inertials given and right.
_CASE = "case_013"
# A roll-out of a bit more than a second, and of how many metres a radian counts as much in it.
_WINDOW, _ARM_M = slice(300, 331), 0.3
# Share of what an effect does that the simulator may be off: bodies are the nearest ones that can be, and what a wrench
# does to the base depends on where the effect lets the base go.
_RELOADED, _LEFT = 0.02, 0.12
# Share of the expected size at which columns are compared with the effect, and by how much it may bend by then.
_SMALL, _BENT = 0.002, 0.05


@pytest.fixture(scope="module")
def problem(gap_dir: Path) -> Problem:
    return build_problem(prepare_record(load_log(gap_dir / "floating" / _CASE)))


@pytest.fixture(scope="module")
def plain(problem: Problem) -> Simulator:
    return Simulator(standing_model(problem, nominal_fit(problem)).xml, problem.record)


def known(effect: FloatingEffect, state: State) -> FloatingEffect:
    """The effect; a contact has to have learnt when it lasts, or where its surface is."""
    if isinstance(effect, UnloggedContact):
        share = np.zeros(state.record.n_samples)
        share[280:340] = 1.0
        return UnloggedContact(share)
    if isinstance(effect, PressedContact):
        (height,) = _heights(effect, state)
        return PressedContact(Surface((0.0, 0.0, 1.0), height, 0.1, rounded=True))
    return effect


def _heights(effect: FloatingEffect, state: State) -> tuple[float]:
    segment = segment_of(state, place(effect, state))
    return (float(state.poses.point(segment + 1, np.zeros(3))[_WINDOW, 2].mean()) + 0.05,)


def place(effect: FloatingEffect, state: State) -> str:
    places = effect.locations(state)
    return places[len(places) // 2]


def sized(effect: FloatingEffect, state: State, location: str, share: float) -> Array:
    """Parameters at a share of what is expected, from where the effect begins."""
    return effect.fit_starts(state, location)[0] + share * effect.parameter_scales(state, location)


def with_effect(problem: Problem, effect: FloatingEffect, location: str, theta: Array) -> Fitted:
    """A fit that says so, whatever the record does."""
    fitted = nominal_fit(problem)
    placed = (Placed(effect, location),)
    return Fitted(placed, (theta,), (np.zeros_like(theta),), fitted.delta, fitted.power, 0.0, 0.0)


@pytest.mark.parametrize("form", FORMS)
def test_it_says_what_it_is_where_it_can_be_and_what_it_looks_like(problem: Problem, form: str) -> None:
    effect = EVERY_FORM[form]
    (summary,) = (s for s in effect_summaries() if (s.form, s.base) == (form, "floating"))
    assert len(summary.law.split()) > 3 and summary.looks_like
    for name in effect.leaves:
        assert name in {*WORDS, *EFFECTS, *EVERY_FORM} and name != effect.name
    effect = known(effect, problem.nominal)
    places = effect.locations(problem.nominal)
    assert places and len(set(places)) == len(places)
    parameters = effect.parameters_at(problem.nominal, places[0])
    assert all(p.scale > 0.0 and p.step > 0.0 for p in parameters)
    assert len({p.name for p in parameters}) == len(parameters)
    assert (effect.mujoco_part != "") == (effect.changes in {"phi", "tree", "placements"})


@pytest.mark.parametrize("form", FORMS)
def test_it_vanishes_at_the_beginning_and_follows_its_columns(problem: Problem, form: str) -> None:
    state = problem.nominal
    effect = known(EVERY_FORM[form], state)
    location = place(effect, state)
    start = effect.fit_starts(state, location)[0]
    np.testing.assert_allclose(effect.apply_to(state, location, start).residual, state.residual, atol=1e-9)
    columns = effect.residual_columns(state, location, start)
    assert columns.shape == (len(state.q), 6, len(start))
    theta = sized(effect, state, location, _SMALL)
    moved = effect.apply_to(state, location, theta).residual - state.residual
    assert np.abs(moved).max() > 0.0
    assert np.abs(moved + columns @ (theta - start)).max() < _BENT * np.abs(moved).max() + 1e-9


@pytest.mark.parametrize("form", FORMS)
def test_a_model_has_the_part_that_it_says_and_no_other(problem: Problem, form: str) -> None:
    """What is noted beside a model must not be in it as well."""
    state = problem.nominal
    effect = known(EVERY_FORM[form], state)
    location = place(effect, state)
    theta = sized(effect, state, location, 0.3)
    changed = effect.apply_to(state, location, theta)
    moved = {
        "phi": not np.array_equal(changed.phi, state.phi),
        "tree": not np.array_equal(changed.tree.translations, state.tree.translations),
        "placements": any(changed.placements[n] != placement for n, placement in state.placements.items()),
        "q": not np.array_equal(changed.q, state.q),
        "readings": any(changed.readings[n] is not x for n, x in state.readings.items()),
        "extra": np.any(changed.extra != state.extra),
    }
    assert [field for field, has_moved in moved.items() if has_moved] == [effect.changes]
    said = json.loads(describe_effect(state, Placed(effect, location), theta))
    assert tuple(said["parameters"]) == tuple(p.name for p in effect.parameters_at(state, location))


@pytest.mark.parametrize("form", FORMS)
def test_a_model_with_it_moves_as_its_wrench_says(problem: Problem, plain: Simulator, form: str) -> None:
    """The model with it, written and loaded again, and the model without it, pulled by the wrench that it makes."""
    state = problem.nominal
    effect = known(EVERY_FORM[form], state)
    location = place(effect, state)
    fitted = with_effect(problem, effect, location, sized(effect, state, location, 0.3))
    simulator = Simulator(standing_model(problem, fitted).xml, problem.record)
    made = explained_state(problem, fitted).residual
    wrench = np.asarray(made - state.residual)
    assert np.abs(simulator.driving_state.residual - made).max() < _RELOADED * np.abs(wrench).max()
    # How far the effect takes the base, in metres.
    metres = np.array([1.0, 1.0, 1.0, _ARM_M, _ARM_M, _ARM_M])
    unmoved = plain.run_window(_WINDOW)
    moved = metres * (simulator.run_window(_WINDOW) - unmoved)
    pulled = metres * (plain.run_window(_WINDOW, noise=wrench) - unmoved)
    assert np.abs(pulled).max() > 1e-4
    assert np.linalg.norm(moved - pulled) < _LEFT * np.linalg.norm(pulled)


def test_a_note_of_no_form_that_is_known_is_no_silence(problem: Problem) -> None:
    xml = standing_model(problem, nominal_fit(problem)).xml
    noted = xml.replace(
        "</mujoco>", '<custom><text name="excite.0.ghost.torso" data="{}"/></custom></mujoco>'
    )
    with pytest.raises(InputError, match=r"excite\.0\.ghost\.torso"):
        Simulator(noted, problem.record)
