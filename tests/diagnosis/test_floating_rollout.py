"""Roll-outs of standing robots: the simulator's dynamics, what stands in its model, and what is left out of it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.floating import simulator as rollout_compare
from excite.diagnosis.floating.bodies import SwingingJoint
from excite.diagnosis.floating.forces import PressedContact, Surface, UnloggedContact
from excite.diagnosis.floating.hypotheses import Fitted, Placed, explained_state, nominal_fit, refine_fit
from excite.diagnosis.floating.problem import Problem, build_problem
from excite.diagnosis.floating.record import FloatingRecord, prepare_record
from excite.diagnosis.floating.registry import FLOATING_EFFECTS
from excite.diagnosis.floating.simulator import (
    Reloaded,
    Simulator,
    read_notes,
    simulate_effects,
    standing_model,
)
from excite.diagnosis.floating.state import State
from excite.logs.files import load_log
from excite.motion.content import BASE_POSE
from tests.diagnosis.few_trials import few_trials

# TALOS over plates and on foot sensors, nominal inertials given and right; of the second, a length is wrong.
_PLATES, _FEET = "case_013", "case_002"


@pytest.fixture(scope="module")
def record(gap_dir: Path) -> FloatingRecord:
    return prepare_record(load_log(gap_dir / "floating" / _PLATES))


@pytest.fixture(scope="module")
def problem(record: FloatingRecord) -> Problem:
    return build_problem(record)


def with_effect(problem: Problem, effect, location: str, theta) -> Fitted:
    """A fit that says so, whatever the record does."""
    fitted = nominal_fit(problem)
    placed, theta = (Placed(effect, location),), (np.asarray(theta, dtype=float),)
    return Fitted(placed, theta, (np.zeros_like(theta[0]),), fitted.delta, fitted.power, 0.0, 0.0)


@pytest.mark.parametrize("case", [_PLATES, _FEET])
def test_the_base_moves_as_its_equation_of_motion_says(gap_dir: Path, case: str) -> None:
    record = prepare_record(load_log(gap_dir / "floating" / case))
    problem, state, k = build_problem(record), State.from_log(record), 300
    simulator = Simulator(standing_model(problem, nominal_fit(problem)).xml, record)
    moved = simulator.run_window(slice(k, k + 2))
    # What the residual accelerates, over a step: half of it, squared, beside what the record does.
    inertia = np.zeros((6, 6))
    for i in range(6):
        a = state.a[k : k + 1].copy()
        a[0, i] += 1.0
        one = State.from_log(record).replace(q=state.q[k : k + 1], v=state.v[k : k + 1], a=state.a[k : k + 1])
        inertia[:, i] = one.replace(a=a).predicted_forces[0] - one.predicted_forces[0]
    more = np.linalg.solve(inertia, state.residual[k])
    step = 1.0 / record.rate_hz
    rotation = pin.Quaternion(*state.q[k, [6, 3, 4, 5]]).matrix()
    # The recorded base's own acceleration of the origin, in the world.
    v, a = state.v[k], state.a[k, :6] + more
    linear = rotation @ (a[:3] + np.cross(v[3:6], v[:3]))
    expected = state.q[k, :3] + step * rotation @ v[:3] + 0.5 * step**2 * linear - state.q[k + 1, :3]
    np.testing.assert_allclose(moved[1, :3], expected, atol=2e-6)
    turned = rotation @ pin.exp3(step * v[3:6] + 0.5 * step**2 * a[3:6])
    there = pin.Quaternion(*state.q[k + 1, [6, 3, 4, 5]]).matrix()
    np.testing.assert_allclose(moved[1, 3:], pin.log3(there.T @ turned), atol=2e-6)


def test_without_effects_it_goes_where_the_record_goes_but_for_noise(problem: Problem) -> None:
    nominal = nominal_fit(problem)
    found = simulate_effects(problem, nominal, nominal, np.random.default_rng(0), None)
    assert found.before == found.after and found.model is None and not found.warnings
    assert set(found.floor) == {f"base.{axis}" for axis in ("px", "py", "pz", "rx", "ry", "rz")}
    for channel, error in found.before.items():
        assert error < 2.5 * found.floor[channel] < 5e-3
    path = found.path
    assert path is not None and path.joints[:7] == BASE_POSE
    # The joints do what they did; the base strays from where it was as far as is said.
    assert (path.before[:, 7:] == path.recorded[:, 7:]).all() and (path.before == path.after).all()
    strayed = path.before[:, :3] - path.recorded[:, :3]
    for k, axis in enumerate("xyz"):
        size = np.sqrt(np.mean(strayed[:, k] ** 2))
        assert 0.1 * found.before[f"base.p{axis}"] < size < 3.0 * found.before[f"base.p{axis}"]
    turned = [pin.Quaternion(*q[[6, 3, 4, 5]]) for q in (path.recorded[40], path.before[40])]
    assert 0.0 < turned[0].angularDistance(turned[1]) < 0.05


@pytest.mark.parametrize(
    "effect",
    [
        FLOATING_EFFECTS["external_force"],
        FLOATING_EFFECTS["wobbling_mass"],
        SwingingJoint(),
        PressedContact(Surface((0.0, 0.6, 0.8), 0.9, 0.03, rounded=True)),
        "timed contact",
    ],
    ids=["external_force", "wobbling_mass", "swinging_joint", "pressed_contact", "timed_contact"],
)
def test_notes_are_read_as_they_were_written(problem: Problem, effect) -> None:
    if effect == "timed contact":
        share = np.zeros(problem.record.n_samples)
        for span in problem.record.spans[1:3]:
            share[span.start + 20 : span.start + 60] = share[span.stop - 30 : span.stop] = 1.0
        effect = UnloggedContact(share)
    location = effect.locations(problem.nominal)[-1]
    theta = 0.7 * effect.parameter_scales(problem.nominal, location)
    fitted = with_effect(problem, effect, location, theta)
    model = mujoco.MjModel.from_xml_string(standing_model(problem, fitted).xml)
    (placed,), (values,) = read_notes(model, problem.record)
    assert (placed.effect.form_name, placed.location) == (effect.form_name, location)
    np.testing.assert_allclose(values, theta, rtol=1e-10)
    once, again = (e.apply_to(problem.nominal, location, theta).residual for e in (effect, placed.effect))
    np.testing.assert_allclose(again, once, atol=1e-9)


def test_notes_hold_any_name_and_any_share(problem: Problem) -> None:
    """Trials may be called anything, and a contact may be half there."""
    share = np.random.default_rng(3).uniform(size=problem.record.n_samples).round(4)
    named = replace(
        problem.record, trials=tuple(f"stand up, {k}=a.b" for k in range(len(problem.record.trials)))
    )
    contact = UnloggedContact(share)
    said = json.loads(json.dumps(contact.stored_data(named)))
    np.testing.assert_array_equal(contact.with_stored_data(said, named).share, share)


def test_bodies_lengths_and_sensors_are_the_models_own(problem: Problem) -> None:
    link, joint, plate = "arm_left_5_link", "leg_right_5_joint", "right_plate"
    error = np.zeros(10)
    error[[0, 4, 6, 9]] = 0.5, 0.01, 0.01, 0.01
    nominal = standing_model(problem, nominal_fit(problem))
    heavier = standing_model(problem, with_effect(problem, FLOATING_EFFECTS["link_inertia"], link, error))
    longer = standing_model(
        problem, with_effect(problem, FLOATING_EFFECTS["link_length_error"], joint, [0.0, 0.01, 0.02])
    )
    moved = standing_model(
        problem, with_effect(problem, FLOATING_EFFECTS["sensor_frame_offset"], plate, [0.01, 0, 0, 0, 0, 0.1])
    )
    before, mass, length, sensor = (
        mujoco.MjModel.from_xml_string(m.xml) for m in (nominal, heavier, longer, moved)
    )
    assert mass.body(link).mass[0] - before.body(link).mass[0] == pytest.approx(0.5, abs=1e-4)
    child = problem.record.robot.segments[problem.record.tree.names.index(joint) - 1].link
    np.testing.assert_allclose(
        np.linalg.norm(length.body(child).pos - before.body(child).pos), np.hypot(0.01, 0.02), atol=1e-5
    )
    assert np.linalg.norm(sensor.site(plate).pos - before.site(plate).pos) == pytest.approx(0.01, abs=1e-5)
    assert all(model.ntext == 0 for model in (before, mass, length, sensor))


def test_a_wrong_gain_is_worth_less_once_it_is_known(record: FloatingRecord) -> None:
    readings = dict(record.readings)
    readings["left_plate"] = readings["left_plate"] * np.array([1.0, 1.0, 1.05, 1.0, 1.0, 1.0])
    problem = build_problem(replace(record, readings=readings))
    before = nominal_fit(problem.identification_only)
    gain = Placed(FLOATING_EFFECTS["sensor_gain"], "left_plate.fz")
    after = refine_fit(problem.identification_only, (gain,), (np.array([0.05]),), before)
    found = simulate_effects(problem, before, after, np.random.default_rng(0), None)
    assert found.after["base.pz"] < 0.1 * found.before["base.pz"]
    assert all(found.after[c] < 2.5 * found.floor[c] for c in found.after)
    assert not found.warnings
    # The other way round it is no nearer, and is left out.
    wrong = replace(after, theta=(-after.theta[0],))
    without = simulate_effects(problem, before, wrong, np.random.default_rng(0), None)
    assert without.after == without.before
    assert "the model is without sensor_gain at left_plate.fz" in without.warnings[0]


def test_of_two_effects_the_harmful_one_is_left_out(record: FloatingRecord) -> None:
    readings = dict(record.readings)
    readings["right_plate"] = readings["right_plate"] * np.array([1.0, 1.0, 1.05, 1.0, 1.0, 1.0])
    problem = build_problem(replace(record, readings=readings))
    before = nominal_fit(problem.identification_only)
    gains = tuple(Placed(FLOATING_EFFECTS["sensor_gain"], f"{side}_plate.fz") for side in ("right", "left"))
    after = refine_fit(problem.identification_only, gains, (np.array([0.05]), np.zeros(1)), before)
    after = replace(after, theta=(after.theta[0], np.array([0.02])))
    found = simulate_effects(problem, before, after, np.random.default_rng(0), None)
    assert found.after["base.pz"] < 0.1 * found.before["base.pz"]
    assert "the model is without sensor_gain at left_plate.fz" in found.warnings[0]


def test_a_short_contact_is_heard(record: FloatingRecord) -> None:
    problem, share = build_problem(record), np.zeros(record.n_samples)
    share[record.spans[3].start + 40 : record.spans[3].start + 90] = 1.0
    theta = np.array([0.0, 0.0, 60.0, 0.0, 0.0, 0.0])
    there = slice(record.spans[3].start + 30, record.spans[3].start + 100)
    (one,), (more,) = (
        Reloaded(
            problem, with_effect(problem, UnloggedContact(share), "arm_left_7_link", size * theta)
        ).rollout_errors([there])
        for size in (1.0, 1.5)
    )
    assert np.abs(more - one).max() > 1e-4


def test_the_drive_is_that_of_the_models_robot(gap_dir: Path) -> None:
    """Loads that bend a joint are those of the fitted bodies, not of the nominal ones."""
    record = prepare_record(load_log(gap_dir / "floating" / "case_004"))
    problem = build_problem(record)
    error = np.zeros(10)
    error[0] = 4.0
    heavy, soft = (FLOATING_EFFECTS[name] for name in ("link_inertia", "joint_elasticity"))
    fitted = nominal_fit(problem)
    torso = record.robot.segments[record.tree.names.index("waist_pitch_joint") - 1].link
    placed = (Placed(heavy, torso), Placed(soft, "waist_roll_joint"))
    theta = (error, np.array([2e-3, 0.0]))
    fitted = replace(fitted, placed=placed, theta=theta, delta=np.zeros_like(fitted.delta))
    drive = Simulator(standing_model(problem, fitted).xml, record).driving_state
    expected, logged = explained_state(problem, fitted).q, record.q
    bend = np.linalg.norm(expected - logged)
    assert np.linalg.norm(drive.q - expected) < 1e-3 * bend


def test_where_no_trial_is_long_enough_it_says_so(problem: Problem) -> None:
    record = replace(problem.record, spans=tuple(slice(s.start, s.start + 10) for s in problem.record.spans))
    short = replace(problem, record=record)
    nominal = nominal_fit(problem)
    found = simulate_effects(short, nominal, nominal, np.random.default_rng(0), None)
    assert found.before == {} and "no trial is as long as a roll-out" in found.warnings[0]


def test_a_log_of_validation_trials_alone_has_roll_outs(problem: Problem) -> None:
    alone = replace(problem, record=replace(problem.record, validation=(True,) * len(problem.record.spans)))
    force = with_effect(
        problem, FLOATING_EFFECTS["external_force"], "torso_2_link", [5.0, 0, 0, 0, 0, 0, 0, 0]
    )
    found = simulate_effects(alone, nominal_fit(problem), force, np.random.default_rng(0), None)
    assert found.after == found.before and "the model is without" in found.warnings[0]


def test_what_mujoco_refuses_is_no_reason_to_say_nothing(problem: Problem, tmp_path: Path) -> None:
    first, *rest = problem.record.robot.segments
    # A body's name that another one has.
    robot = replace(problem.record.robot, segments=(replace(first, link=rest[0].link), *rest))
    refused = replace(problem, record=replace(problem.record, robot=robot))
    nominal = nominal_fit(problem)
    found = simulate_effects(refused, nominal, nominal, np.random.default_rng(0), tmp_path)
    assert "MuJoCo refuses the model" in found.warnings[0]
    assert not list(tmp_path.iterdir())


def test_the_model_is_written_where_there_is_a_folder(gap_dir: Path, tmp_path: Path) -> None:
    log = few_trials(load_log(gap_dir / "floating" / _FEET))
    found = diagnose(log, out=tmp_path).to_json()["simulation"]
    assert found["model"] == rollout_compare.MODEL
    model = mujoco.MjModel.from_xml_path(str(tmp_path / found["model"]))
    assert model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    ratios = [found["after"][c] / found["before"][c] for c in found["before"]]
    assert np.median(ratios) < 0.3 and max(ratios) < 1.0
    assert json.dumps(found)
