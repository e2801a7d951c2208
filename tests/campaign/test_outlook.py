"""Predicted precision against draws of noise and against simulation and identification."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import excite
from excite.campaign.expected import is_predictable, predict_statistics
from excite.campaign.plan import Plan
from excite.identification.judgement import Forecast
from excite.identification.noise import equation_noise, trial_grids
from excite.identification.problem import build_problem
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import Log, Trial
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.simulation.sensing import log_header


def test_noise_of_a_standing_humanoids_rows_is_that_of_draws(g1: Robot) -> None:
    sensors, n = g1.description.sensors, 4000
    time = np.arange(n) / sensors.rate_hz
    still = np.zeros((n, g1.model.nv))
    motion = Motion("still", g1.name, g1.joint_names, time, np.tile(g1.rest, (n, 1)), still, still)
    random = np.random.default_rng(0)
    pose = np.tile(g1.rest[:7], (n, 1))
    pose[:, :3] += sensors.noise_base_position * random.normal(size=(n, 3))
    turn = sensors.noise_base_orientation * random.normal(size=(n, 3))
    pose[:, 3:] = [(pin.Quaternion(g1.rest[3:7]) * pin.Quaternion(pin.exp3(w))).coeffs() for w in turn]
    wrenches = {
        s.name: random.normal(size=(n, 6)) * np.repeat([s.noise_force, s.noise_moment], 3) for s in g1.sensors
    }
    q = g1.rest[7:] + sensors.noise_position * random.normal(size=(n, g1.n_joints))
    header = log_header(g1, (TrialHeader(file="still.parquet", role="identification"),))
    trial = Trial("still", "identification", time, q, base=pose, wrenches=wrenches)
    problem = build_problem(g1, Log(header, (trial,)))
    errors = problem.residual(problem.prior)
    drawn = [errors[problem.channel == c].std() for c in range(6)]
    noise = equation_noise(g1, problem, trial_grids(problem), {"still": motion}, sensors.rate_hz)
    # Some 190 independent rows a channel know a standard deviation to 5 %.
    np.testing.assert_allclose(noise.channel_std(), drawn, rtol=0.2)
    one = np.zeros((problem.n_rows, 1))
    one[problem.channel == 2] = 1.0
    # Twice differentiated noise has nothing at zero frequency: a constant force is far better known.
    assert np.sqrt(noise.meat(one)[0, 0]) < 0.7 * drawn[2] * np.sqrt(one.sum())


@pytest.mark.slow
def test_predicted_rsd_is_found_within_a_factor(ur10: Robot, small_plan: Plan) -> None:
    expected = small_plan.outlook
    assert expected is not None
    roles = {motion.name: "identification" for motion in small_plan.motions}
    run = excite.simulate(ur10, small_plan.motions, nominal=True, roles=roles, seed=1)
    identified = excite.identify(ur10, run.log, "wls")
    found = {item.name: item.rsd_percent for item in identified.base}
    both = expected.essential_rsd.keys() & {item.name for item in identified.essential}
    assert len(both) >= 20
    for name in both:
        assert 1.0 / 1.5 < expected.essential_rsd[name] / found[name] < 1.5, name


def test_four_times_the_same_motions_halve_every_deviation(ur10: Robot, small_plan: Plan) -> None:
    once = small_plan.motions[:3]
    again = [motion.renamed(f"{motion.name}_{turn}") for turn in range(4) for motion in once]
    np.testing.assert_allclose(
        predict_statistics(ur10, again).std, 0.5 * predict_statistics(ur10, once).std, rtol=1e-6
    )


def test_plan_says_what_to_expect_of_each_base_parameter(ur10: Robot, small_plan: Plan) -> None:
    entries = small_plan.to_json()["base_parameters"]
    assert len(entries) == 36 + 12 + 4  # four armatures are no part of an inertia
    assert all(entry["excitable"] and entry["excited"] for entry in entries)
    assert "predicted RSD of" in small_plan.summary()
    essential = [entry for entry in entries if entry["essential"]]
    assert 20 <= len(essential) < len(entries)
    assert all(0.0 < entry["predicted_rsd_percent"] < 100.0 for entry in essential)


def test_plan_says_how_much_motion_its_target_takes(ur10: Robot, small_plan: Plan) -> None:
    forecast = replace(small_plan, target_rsd=0.5).forecast
    rsd = small_plan.outlook.essential_rsd
    assert forecast.seconds == pytest.approx(small_plan.duration_s)
    assert 0 < forecast.within == sum(value <= 0.5 for value in rsd.values()) < len(rsd)
    # Twice the motion brings a parameter down by the square root of two: what needs it is there then.
    again = tuple(motion.renamed(f"{motion.name}_again") for motion in small_plan.motions)
    twice = replace(small_plan, target_rsd=0.5, before=again).forecast
    assert twice.seconds == pytest.approx(2.0 * forecast.seconds)
    for name in twice.needed_s.keys() & forecast.needed_s.keys():
        assert twice.needed_s[name] == pytest.approx(forecast.needed_s[name], rel=1e-5), name
    assert twice.within > forecast.within


def test_large_deviations_are_percentages_a_person_writes(small_plan: Plan) -> None:
    first = small_plan.outlook.parameters[0]
    vague = replace(first, name="vague", excited=True, rsd_percent=223.4, essential=True)
    said = replace(small_plan.outlook, parameters=(*small_plan.outlook.parameters, vague)).summary()
    assert "largest 223 % (vague)" in said
    # Ten times the motion would not tell it from zero: how far it is off is no figure for a person.
    unseen = replace(vague, rsd_percent=4880455121.0)
    said = replace(small_plan.outlook, parameters=(*small_plan.outlook.parameters, unseen)).summary()
    assert "largest not shown by these motions (vague)" in said


def test_a_forecast_tells_more_motion_from_too_much_motion() -> None:
    forecast = Forecast.of({"a": 5.0, "b": 10.0, "c": 20.0, "d": 31.0, "e": 80.0}, 10.0, 60.0)
    assert forecast.summary() == (
        "to be expected of 60 s: 2 of 5 essential parameters within 10 %; 2 more would take motion like this for "
        "240 s to 577 s in all; 1 would take more than 10 times as much"
    )
    assert Forecast.of({"a": 5.0}, 10.0, 60.0).summary().endswith("1 of 1 essential parameters within 10 %")
    assert Forecast.from_json(forecast.to_json()) == forecast


def test_a_robot_that_does_not_state_its_noise_gets_no_prediction(ur10: Robot, small_plan: Plan) -> None:
    sensors = ur10.description.sensors.model_copy(update={"noise_torque": None})
    silent = replace(ur10, description=ur10.description.model_copy(update={"sensors": sensors}))
    assert not is_predictable(silent)
    without = replace(small_plan, robot=silent)
    assert without.to_json()["base_parameters"] == [] and without.to_json()["forecast"] is None
