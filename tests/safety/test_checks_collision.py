"""Self-collision between samples, against brute force."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import make_interp_spline
from scipy.optimize import brentq

from excite.motion.motion import Motion, interpolate_motion
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_model
from excite.safety.check import check_motion
from excite.safety.checks import collision
from excite.safety.checks.collision import Distances, approach_rates, find_closest
from excite.safety.checks.sweep import Sweep
from tests.safety.motions import moved_joint, smooth, squat


def all_distances(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Distance of every pair, straight from coal."""
    geometry = collision_model(robot)
    model_data, data = robot.model.createData(), geometry.createData()
    pin.updateGeometryPlacements(robot.model, model_data, geometry, data, q)
    pin.computeDistances(geometry, data)
    return np.array([result.min_distance for result in data.distanceResults])


def test_distance_never_changes_faster_than_the_bound(humanoid: Robot) -> None:
    model = humanoid.model
    rates = approach_rates(model, collision_model(humanoid))
    rng = np.random.default_rng(0)
    tightest = 0.0
    for _ in range(60):
        q = pin.neutral(model)
        q[7:] = rng.uniform(humanoid.limits.position_lower, humanoid.limits.position_upper)
        # Few joints at a time, so that single columns of the bound are tried too.
        v = rng.normal(size=model.nv) * (rng.random(model.nv) < rng.choice([0.05, 0.2, 1.0]))
        dt = 1e-4
        change = (
            np.abs(all_distances(humanoid, pin.integrate(model, q, dt * v)) - all_distances(humanoid, q)) / dt
        )
        speeds = np.concatenate([[np.linalg.norm(v[:3]), np.linalg.norm(v[3:6])], np.abs(v[6:])])
        bound = rates @ speeds
        # Coal's own tolerance is 1e-6 m.
        assert (change * dt <= bound * dt * (1.0 + 1e-3) + 2e-6).all()
        moving = bound > 0.1
        tightest = max(tightest, float((change[moving] / bound[moving]).max(initial=0.0)))
    assert tightest > 0.5, "a bound never approached would be of no use"


def test_pairs_on_one_branch_ignore_the_base(humanoid: Robot) -> None:
    rates = approach_rates(humanoid.model, collision_model(humanoid))
    assert (rates[:, :2] == 0.0).all(), "no pair of a free robot's own bodies depends on its base"
    assert ((rates > 0.0).sum(axis=1) >= 2).all(), "pairs on adjacent joints are not in the model"


def test_smallest_distance_matches_brute_force(humanoid: Robot) -> None:
    still = squat(humanoid, depth=0.05, duration=1.5)
    s = still.time / still.duration
    towards = -0.25 * smooth(2.5 * s) * smooth(2.5 * (1.0 - s))
    motion = moved_joint(humanoid, still, "left_shoulder_roll_joint", towards)
    dense = motion.resampled(humanoid, 1000.0)
    truth = min(all_distances(humanoid, q).min() for q in dense.q[::5])
    for required in (0.0, truth + 0.01):
        closest = find_closest(Distances(Sweep(humanoid, motion)), required)
        assert closest.lower <= truth + 1e-9
        assert closest.upper - closest.lower <= 1e-3 + 1e-12
        assert truth - closest.upper <= 1e-3
        assert bool(closest.found) is bool(truth < required)


def test_arm_into_the_trunk(humanoid: Robot) -> None:
    still = squat(humanoid, depth=0.0, sway=0.0)
    s = still.time / still.duration
    inwards = -0.5 * smooth(2.5 * s) * smooth(2.5 * (1.0 - s))
    verdict = check_motion(humanoid, moved_joint(humanoid, still, "left_shoulder_roll_joint", inwards))
    assert {v.kind for v in verdict.violations} == {"self_collision"}
    assert all("left_" in v.where for v in verdict.violations)
    assert verdict.margins.self_collision_m < humanoid.description.collision.margin


def swings(robot: Robot, offset: float) -> Motion:
    """At 25 Hz the left arm swings with 20 rad/s² and turns inwards halfway between two samples each time."""
    time = np.arange(0.0, 4.0 + 1e-9, 0.04)
    frequency = 2.0 * np.pi * 2.5
    phase, amplitude = frequency * (time - 2.02), 20.0 / frequency**2
    window = make_interp_spline(time, smooth(time / 1.5) * smooth((4.0 - time) / 1.5), k=5)
    swing = [offset - amplitude * np.cos(phase), amplitude * frequency * np.sin(phase), 20.0 * np.cos(phase)]
    inside = [window(time, order) for order in range(3)]
    column = 7 + robot.joint_index("left_shoulder_roll_joint")
    q = np.tile(robot.rest, (len(time), 1))
    v, a = np.zeros((len(time), robot.model.nv)), np.zeros((len(time), robot.model.nv))
    q[:, column] += swing[0] * inside[0]
    v[:, column - 1] = swing[1] * inside[0] + swing[0] * inside[1]
    a[:, column - 1] = swing[2] * inside[0] + 2.0 * swing[1] * inside[1] + swing[0] * inside[2]
    contacts = {foot.name: np.ones(len(time), bool) for foot in robot.feet}
    return Motion("swings", robot.name, robot.joint_names, time, q, v, a, contacts)


def test_collision_between_samples_only(humanoid: Robot) -> None:
    required = humanoid.description.collision.margin

    def closest(offset: float) -> tuple[float, float]:
        """Smallest distance at the sample before the turn, and at the turn."""
        motion = swings(humanoid, offset)
        turn = interpolate_motion(motion, humanoid, np.array([2.02])).q[0]
        at = int(np.argmin(np.abs(motion.time - 2.0)))
        return all_distances(humanoid, motion.q[at]).min(), all_distances(humanoid, turn).min()

    # Where the samples keep the distance as clearly as the instants between them miss it.
    offset = brentq(lambda x: 0.5 * sum(closest(x)) - required, -0.4, 0.1, xtol=1e-5)
    motion, between = swings(humanoid, offset), closest(offset)[1]
    at_samples = min(all_distances(humanoid, q).min() for q in motion.q)
    assert between + 3e-4 < required < at_samples - 3e-4
    verdict = check_motion(humanoid, motion)
    assert {v.kind for v in verdict.violations} == {"self_collision"}
    assert verdict.margins.self_collision_m == pytest.approx(between, abs=1e-3)
    assert np.abs(motion.time - verdict.violations[0].time_s).min() > 1e-3, "no sample shows it"


def test_undecided_search_is_unsafe(humanoid: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    motion = swings(humanoid, 0.0)
    assert check_motion(humanoid, motion).safe
    monkeypatch.setattr(collision, "_MAX_EVALUATIONS", 0)
    monkeypatch.setattr(collision, "_FIRST_STEP", 2.0)
    verdict = check_motion(humanoid, motion)
    assert not verdict.safe
    assert verdict.not_computed == ("self_collision_m",)
    assert "could not compute" in verdict.summary()


def test_balls_bound_distances_from_below_and_change_no_answer(
    humanoid: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of pairs that balls show to be far, nothing is asked, and what is found is what it would be of all pairs."""
    sweep = Sweep(humanoid, squat(humanoid))
    distances, times = Distances(sweep), sweep.fine.time[::20]
    every = np.array([distances.at(float(time), np.arange(distances.n_pairs)) for time in times])
    assert (distances.at_least(times) <= every).all()
    required = float(every.min())
    for level in (required - 0.01, required + 0.005):
        with_balls = find_closest(distances, level)
        with monkeypatch.context() as patched:
            patched.setattr(Distances, "at_least", lambda d, times: np.full((len(times), d.n_pairs), -np.inf))
            without = find_closest(Distances(sweep), level)
        assert (with_balls.lower, with_balls.upper, with_balls.found) == (
            without.lower,
            without.upper,
            without.found,
        )


def test_a_distance_does_not_depend_on_what_was_asked_before(humanoid: Robot) -> None:
    sweep = Sweep(humanoid, squat(humanoid))
    there, back = Distances(sweep), Distances(sweep)
    times, pairs = sweep.fine.time[::25], np.arange(there.n_pairs)
    first = [there.at(float(time), pairs) for time in times]
    second = [back.at(float(time), pairs) for time in times[::-1]][::-1]
    np.testing.assert_array_equal(first, second)
