"""Floating-base diagnosis against pinocchio, finite differences and simulated cases with a known answer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.floating.answer import draw_residual_power, gap_of, residual_of
from excite.diagnosis.floating.bodies import SwingingJoint
from excite.diagnosis.floating.diagnose import attribute_gap, unknown_places
from excite.diagnosis.floating.effect import FloatingEffect
from excite.diagnosis.floating.hypotheses import Placed, nominal_fit, refine_fit
from excite.diagnosis.floating.problem import Problem, build_problem, find_unloaded
from excite.diagnosis.floating.record import FloatingRecord, prepare_record
from excite.diagnosis.floating.registry import FLOATING_EFFECTS
from excite.diagnosis.floating.search import keep_needed
from excite.diagnosis.floating.state import State
from excite.errors import LogError
from excite.logs.files import load_log
from excite.logs.log import Log
from excite.logs.signals.butterworth import lowpass

# Nominal inertials given and right; plates under a TALOS; nothing hidden.
_CLEAN = "case_013"
_FOOTED = "case_000"
_BIASED, _BIAS = "case_024", (5.264572, 7.468074, -9.363308, -4.561285, -5.174294, -5.676496)


@pytest.fixture(scope="module")
def clean_log(gap_dir: Path) -> Log:
    return load_log(gap_dir / "floating" / _CLEAN)


@pytest.fixture(scope="module")
def record(clean_log: Log) -> FloatingRecord:
    return prepare_record(clean_log)


@pytest.fixture(scope="module")
def problem(record: FloatingRecord) -> Problem:
    return build_problem(record)


@pytest.fixture(scope="module")
def footed(gap_dir: Path) -> FloatingRecord:
    """The first samples of a record with sensors in the feet."""
    return first_samples(prepare_record(load_log(gap_dir / "floating" / _FOOTED)))


def first_samples(record: FloatingRecord, n: int = 200) -> FloatingRecord:
    return replace(
        record,
        q=record.q[:n],
        v=record.v[:n],
        a=record.a[:n],
        readings={k: x[:n] for k, x in record.readings.items()},
        readings_rate={k: x[:n] for k, x in record.readings_rate.items()},
        spans=(slice(0, n),),
    )


def with_readings(record: FloatingRecord, sensor: str, change) -> FloatingRecord:
    """The record as it would be if a sensor had said something else."""
    return replace(record, readings=record.readings | {sensor: change(record.readings[sensor])})


def with_relief(record: FloatingRecord, point: np.ndarray, force: np.ndarray) -> FloatingRecord:
    """The record as it would be if world forces ``(n, 3)`` at points ``(n, 3)`` had relieved the plates as loaded."""
    load = {s.name: np.linalg.norm(record.readings[s.name][:, :3], axis=1) for s in record.robot.sensors}
    for sensor in record.robot.sensors:
        plate = sensor.placement
        part = (load[sensor.name] / sum(load.values()))[:, None] * force
        relief = np.hstack([part, np.cross(point - plate.translation, part)])
        relief = np.hstack([relief[:, :3] @ plate.rotation, relief[:, 3:] @ plate.rotation])
        record = with_readings(record, sensor.name, lambda x, relief=relief: x - relief)
    return record


def test_prediction_is_inverse_dynamics(record: FloatingRecord) -> None:
    state, model = State.from_log(record), record.robot.model
    data = model.createData()
    for i in (0, 700, 1500):
        expected = pin.rnea(model, data, record.q[i], record.v[i], record.a[i])[:6]
        np.testing.assert_allclose(state.predicted_forces[i], expected, atol=1e-8)


def test_noise_of_a_clean_record_is_as_expected(problem: Problem) -> None:
    power = problem.residual_power(problem.nominal_rows) / len(problem.nominal_rows)
    assert 0.7 < power < 1.3


def test_nothing_is_found_where_nothing_is(record: FloatingRecord) -> None:
    assert attribute_gap(build_problem(record.halve_rate())).verdict == "none"


def test_a_wrong_gain_is_named_and_measured(record: FloatingRecord) -> None:
    gained = with_readings(record.halve_rate(), "left_plate", lambda x: x * np.array([1, 1, 1.02, 1, 1, 1]))
    found = attribute_gap(build_problem(gained))
    assert found.verdict == "effect"
    assert (found.accepted_fit.placed[0].effect.name, found.accepted_fit.placed[0].location) == (
        "sensor_gain",
        "left_plate.fz",
    )
    assert found.accepted_fit.theta[0][0] == pytest.approx(0.02, abs=0.001)


def test_what_a_later_effect_makes_superfluous_is_dropped(record: FloatingRecord) -> None:
    gained = with_readings(record.halve_rate(), "left_plate", lambda x: x * np.array([1, 1, 1.02, 1, 1, 1]))
    problem = build_problem(gained)
    baseline = nominal_fit(problem)
    pull = Placed(FLOATING_EFFECTS["external_force"], "torso_2_link")
    gain = Placed(FLOATING_EFFECTS["sensor_gain"], "left_plate.fz")
    one = refine_fit(problem, (pull,), (np.zeros(8),), baseline)
    assert baseline.power - one.power > 1000.0
    both = refine_fit(problem, (pull, gain), (*one.theta, np.array([0.01])), one)
    kept = keep_needed(problem, both, baseline)
    assert [item.effect.name for item in kept.placed] == ["sensor_gain"]


def test_a_foot_in_the_air_tells_the_bias(gap_dir: Path) -> None:
    record = prepare_record(load_log(gap_dir / "floating" / _BIASED))
    state = State.from_log(record)
    unloaded = find_unloaded(record, state)
    seen = {
        name: values
        for name, values in zip(unloaded.sensors, unloaded.mean_readings(state.readings), strict=True)
    }
    np.testing.assert_allclose(seen["right_plate"], _BIAS, atol=0.2)
    np.testing.assert_allclose(seen["left_plate"], 0.0, atol=0.5)


def test_wrenches_are_needed(clean_log: Log) -> None:
    bare = replace(clean_log, trials=tuple(replace(t, wrenches={}) for t in clean_log.trials))
    with pytest.raises(LogError, match="wrench"):
        prepare_record(bare)


def test_a_trial_that_filters_take_whole_is_named(clean_log: Log) -> None:
    first, *rest = clean_log.trials
    n = 150
    short = replace(
        first,
        time=first.time[:n],
        q=first.q[:n],
        base=None if first.base is None else first.base[:n],
        wrenches={name: values[:n] for name, values in first.wrenches.items()},
    )
    with pytest.raises(LogError, match=r"trial_00: time: lasts 1\.5 s, .*record trials of 1\.8 s"):
        prepare_record(replace(clean_log, trials=(short, *rest)))


@pytest.mark.parametrize("name", ["encoder_offset", "joint_elasticity", "soft_tissue"])
def test_columns_of_joints_under_foot_sensors_are_finite_differences(
    footed: FloatingRecord, name: str
) -> None:
    effect, state = FLOATING_EFFECTS[name], State.from_log(footed)
    for location in effect.locations(state)[2:12:3]:
        theta = 0.5 * effect.parameter_scales(state, location)
        columns = effect.residual_columns(state, location, theta)
        expected = FloatingEffect.residual_columns(effect, state, location, theta)
        off = np.linalg.norm(columns - expected, axis=(0, 1))
        assert (off < 0.01 * np.linalg.norm(expected, axis=(0, 1))).all()


def before_the_spring(record: FloatingRecord, name: str, largest: float) -> tuple[State, float, np.ndarray]:
    """What an encoder reads where the record is the truth behind a spring that bends by ``largest`` [rad] at most.

    Returns:
        The logged state, the spring's compliance and the bend.
    """
    state = State.from_log(record)
    joint = state.tree.names.index(name)
    iq, iv = state.tree.idx_q[joint], state.tree.idx_v[joint]
    torque = state.smooth_torques[:, iv]
    compliance = largest / np.abs(torque).max()
    bend = compliance * torque
    rate = np.gradient(bend, 1.0 / record.rate_hz)
    q, v, a = record.q.copy(), record.v.copy(), record.a.copy()
    q[:, iq] += bend
    v[:, iv] += rate
    a[:, iv] += np.gradient(rate, 1.0 / record.rate_hz)
    return State.from_log(replace(record, q=q, v=v, a=a)), compliance, bend


def test_a_bent_joint_leans_further(footed: FloatingRecord) -> None:
    name = "waist_pitch_joint"
    logged, compliance, bend = before_the_spring(footed, name, 0.03)
    joint = logged.tree.names.index(name)
    iq, iv = logged.tree.idx_q[joint], logged.tree.idx_v[joint]
    found = FLOATING_EFFECTS["joint_elasticity"].apply_to(logged, name, np.array([compliance, 0.0]))
    off, as_logged = found.q[:, iq] - footed.q[:, iq], compliance * logged.smooth_torques[:, iv] - bend
    assert off.std() < 0.05 * bend.std()
    assert off.std() < 0.6 * as_logged.std()


def test_what_a_soft_joint_carries_swings_on_it(footed: FloatingRecord) -> None:
    name, off = "waist_roll_joint", {}
    logged, compliance, bend = before_the_spring(footed, name, 0.02)
    iq = logged.tree.idx_q[logged.tree.names.index(name)]
    for effect in (SwingingJoint(), FLOATING_EFFECTS["joint_elasticity"]):
        found = effect.apply_to(logged, name, np.array([compliance, 0.0])).q[:, iq] - footed.q[:, iq]
        off[effect.form_name] = float(found.std() / bend.std())
    assert off["swinging_joint"] < 0.06
    assert off["swinging_joint"] < 0.5 * off["joint_elasticity"]


def test_a_hand_pressed_on_something_soft_is_placed(record: FloatingRecord) -> None:
    thin = record.halve_rate()
    link = "arm_left_7_link"
    segment = [s.link for s in thin.robot.segments].index(link)
    state = State.from_log(thin)
    hand = state.poses.point(segment + 1, np.array([0.02, 0.0, 0.03]))
    # A mattress: it gives way over 15 cm and never is fully pressed.
    edge = float(np.quantile(hand[:, 2], 0.5))
    force = np.clip((edge - hand[:, 2]) / 0.15, 0.0, 1.0)[:, None] * np.array([8.0, 0.0, 60.0])
    found = attribute_gap(build_problem(with_relief(thin, hand, force)))
    assert found.verdict == "effect"
    assert found.accepted_fit.placed[0].effect.name == "unlogged_contact"
    assert link in found.tied[0]
    assert found.overdispersion < 1.2


def test_what_is_unknown_is_placed_beside_inertials_that_would_imitate_it(record: FloatingRecord) -> None:
    thin, link = replace(record.halve_rate(), inertials_free=True), "arm_right_5_link"
    point = State.from_log(thin).poses.point(
        [s.link for s in thin.robot.segments].index(link) + 1, np.zeros(3)
    )
    wild = np.random.default_rng(4).standard_normal((thin.n_samples, 3))
    force = np.concatenate([lowpass(wild[span], thin.rate_hz, 0.8) for span in thin.spans])
    problem = build_problem(with_relief(thin, point, 40.0 * force))
    tied = unknown_places(problem, nominal_fit(problem))
    assert link in tied
    assert len(tied) <= 3


def test_a_channel_that_is_cut_off_is_unknown_and_placed(record: FloatingRecord) -> None:
    """Steps of a load that a plate does not show look like a contact that comes and goes."""
    thin = record.halve_rate()
    top = float(np.quantile(thin.readings["left_plate"][:, 2], 0.6))

    def cut(reading: np.ndarray) -> np.ndarray:
        reading = reading.copy()
        reading[:, 2] = np.minimum(reading[:, 2], top + 0.1 * (reading[:, 2] - top))
        return reading

    problem = build_problem(with_readings(thin, "left_plate", cut))
    assert attribute_gap(problem).verdict == "unknown"
    assert unknown_places(problem, nominal_fit(problem))[0] == "left_plate.fz"


def test_a_cord_to_an_anchor_is_one_effect(record: FloatingRecord) -> None:
    thin = record.halve_rate()
    link, point = "torso_2_link", np.array([0.05, 0.0, 0.1])
    hooked = State.from_log(thin).poses.point([s.link for s in thin.robot.segments].index(link) + 1, point)
    away = np.array([1.6, -1.2, 1.0]) - hooked
    length = np.linalg.norm(away, axis=1)
    pull = (100.0 * (length - length.mean() + 0.4) / length)[:, None] * away
    problem = build_problem(with_relief(thin, hooked, pull))
    cord = Placed(FLOATING_EFFECTS["external_force"], link)
    fitted = refine_fit(problem, (cord,), (np.zeros(8),), nominal_fit(problem), 20)
    assert fitted.power < 1.3 * len(problem.nominal_rows)
    # Across its direction a cord is as stiff as its tension over its length.
    (theta,) = fitted.theta
    assert theta[3] == pytest.approx(40.0 / length.mean(), rel=0.3)
    assert theta[3] + theta[7] == pytest.approx(100.0, rel=0.1)


def test_a_table_that_rubs_is_a_contact(record: FloatingRecord) -> None:
    thin = record.halve_rate()
    link = "arm_left_7_link"
    segment, palm = [s.link for s in thin.robot.segments].index(link), np.array([0.02, 0.0, 0.06])
    hand = State.from_log(thin).poses.point(segment + 1, palm)
    speed = np.concatenate([np.gradient(hand[span], 1.0 / thin.rate_hz, axis=0) for span in thin.spans])
    edge = float(np.quantile(hand[:, 2], 0.5))
    press = 60.0 * np.clip((edge - hand[:, 2]) / 0.05, 0.0, 1.0)
    force = np.column_stack([*(-0.4 * press * np.tanh(speed[:, :2] / 0.05).T), press])
    found = attribute_gap(build_problem(with_relief(thin, hand, force)))
    assert (found.verdict, found.accepted_fit.placed[0].effect.name) == ("effect", "unlogged_contact")
    assert link in found.tied[0]
    assert found.accepted_fit.theta[0][8] == pytest.approx(0.4, rel=0.35)


def test_of_two_effects_both_are_named_and_placed(record: FloatingRecord) -> None:
    # The bias is found only once the gain's share of the other foot's load is told from it.
    both = with_readings(
        with_readings(record.halve_rate(), "left_plate", lambda x: x * 1.03),
        "right_plate",
        lambda x: x + np.array([6.0, -4.0, 8.0, 1.0, 2.0, -1.0]),
    )
    found = attribute_gap(build_problem(both))
    assert {(p.effect.name, p.location) for p in found.accepted_fit.placed} == {
        ("sensor_gain", "left_plate"),
        ("sensor_bias", "right_plate"),
    }
    # Each has its rivals given the other, so that no first step is judged by what it left.
    assert all(step[0].evidence > 1000.0 for step in found.steps)
    assert found.overdispersion < 1.2


def test_the_interval_of_the_share_closed_is_one(record: FloatingRecord) -> None:
    gained = with_readings(record.halve_rate(), "left_plate", lambda x: x * np.array([1, 1, 1.1, 1, 1, 1]))
    problem = build_problem(gained)
    gain = Placed(FLOATING_EFFECTS["sensor_gain"], "left_plate.fz")
    full = refine_fit(problem, (gain,), (np.array([0.1]),), nominal_fit(problem))
    seen = problem.identification_only
    alone = refine_fit(seen, full.placed, full.theta, full)
    gap = gap_of(problem, nominal_fit(seen), alone, np.random.default_rng(0))
    assert gap.interval is not None
    low, high = gap.interval
    # What is left is noise, so that nothing speaks against a gap that is closed.
    assert 0.9 < low <= gap.share_closed <= high == 1.0
    assert high - low > 1e-5
    # A half of the effect leaves 1.1/1.05 − 1 of a tenth, and the interval says so.
    closed = 1.0 - (1.1 / 1.05 - 1.0) ** 2 / 0.1**2
    half = replace(full, theta=(np.array([0.05]),))
    part = gap_of(problem, nominal_fit(problem), half, np.random.default_rng(0)).interval
    assert part is not None
    assert part[0] < closed < part[1]
    assert part[1] - part[0] < 0.1


def test_errors_of_parameters_leave_what_their_spread_does_to_the_residual(record: FloatingRecord) -> None:
    gained = with_readings(record.halve_rate(), "left_plate", lambda x: x * np.array([1, 1, 1.1, 1, 1, 1]))
    problem = build_problem(gained)
    gain = Placed(FLOATING_EFFECTS["sensor_gain"], "left_plate.fz")
    seen = problem.identification_only
    alone = refine_fit(seen, (gain,), (np.array([0.1]),), nominal_fit(seen))
    held_out, scale = problem.record.validation_samples(), np.array([10.0, 20.0, 30.0, 4.0, 5.0, 6.0])
    draws = draw_residual_power(problem, alone, scale, held_out, np.random.default_rng(1), 4000)
    off = replace(alone, theta=(alone.theta[0] + alone.std[0],))
    change = (residual_of(problem, off) - residual_of(problem, alone))[held_out] / scale
    # One parameter: the mean of a chi-square of one degree of freedom is that of one standard deviation.
    assert draws.mean() == pytest.approx(float((change**2).mean()), rel=0.15)
    assert np.quantile(draws, 0.95) / draws.mean() == pytest.approx(3.84, rel=0.1)
