"""The repairs' search for collisions, the bound on approach, and what the check says of a pair that comes too close."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import coal
import numpy as np
import pinocchio as pin
import pytest

from excite.motion.generators.curves import SplineCurve, hermite_curve
from excite.motion.generators.generator import Draws
from excite.motion.generators.registry import make_generator
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_model
from excite.safety.checks import collision
from excite.safety.checks.collision import Distances, approach_rates, find_closest, judge_self_collision
from excite.safety.checks.sweep import Sweep
from excite.safety.repairs.collisions import EXTRA, CollisionProbe, TooClose
from excite.safety.repairs.draft import Draft, Rejection
from excite.safety.repairs.waypoints import Waypoints
from excite.safety.repairs.whole_body import milder_candidates
from tests.safety.motions import moved_joint, smooth, squat


def all_distances(robot: Robot, q: np.ndarray) -> np.ndarray:
    geometry = collision_model(robot)
    model_data, data = robot.model.createData(), geometry.createData()
    pin.updateGeometryPlacements(robot.model, model_data, geometry, data, q)
    pin.computeDistances(geometry, data)
    return np.array([result.min_distance for result in data.distanceResults])


# --- The probe


def margins(robot: Robot) -> np.ndarray:
    """What the probe keeps of each pair: 4 mm more than required, or a quarter of what is spare at rest."""
    required = robot.description.collision.margin
    return required + np.minimum(EXTRA, 0.25 * np.maximum(0.0, all_distances(robot, robot.rest) - required))


def test_the_probe_keeps_a_little_more_than_is_required(g1: Robot) -> None:
    assert EXTRA == 0.004
    probe, keep = CollisionProbe(g1), margins(g1)
    rng = np.random.default_rng(1)
    near = [0, 0]
    for _ in range(120):
        q = g1.rest.copy()
        q[7:] += rng.normal(size=g1.n_joints) * rng.choice([0.05, 0.15, 0.3])
        spare = (all_distances(g1, q) - keep).min()
        if abs(spare) > 1e-5:
            assert probe.collides(q) is bool(spare < 0.0)
            near[int(spare < 0.0)] += abs(spare) < EXTRA
    assert min(near) > 0, "some were within the extra distance on either side"


def test_the_probe_finds_the_first_and_names_the_closest(g1: Robot) -> None:
    probe, keep = CollisionProbe(g1), margins(g1)
    path = np.tile(g1.rest, (6, 1))
    path[3:, 7 + g1.joint_index("left_shoulder_roll_joint")] -= np.array([0.5, 0.6, 0.7])
    assert probe.first(path) == 3
    assert probe.first(path[:3]) is None
    pair = collision_model(g1).collisionPairs[int(np.argmin(all_distances(g1, path[3]) - keep))]
    names = [collision_model(g1).geometryObjects[i].name.rsplit("_", 1)[0] for i in (pair.first, pair.second)]
    first, worst = probe.closest(path[3:4]), probe.closest(path[3:])
    assert first.pair == worst.pair == " - ".join(names)
    assert worst.distance == pytest.approx(
        min(probe.closest(row[None]).distance for row in path[3:]), abs=1e-6
    )
    assert worst.distance < first.distance - 1e-3
    np.testing.assert_array_equal(worst.posture, path[5])


# --- How fast bodies approach


def chain(free: bool = False) -> tuple[pin.Model, pin.GeometryModel]:
    """A revolute joint, a prismatic one 0.5 m beyond it, a revolute one 0.2 m further; spheres of 0.1 m."""
    model = pin.Model()
    parent = 0
    if free:
        parent = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
    joints = [parent]
    for kind, x in ((pin.JointModelRZ(), 0.4), (pin.JointModelPX(), 0.5), (pin.JointModelRY(), 0.2)):
        placement = pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))
        joints.append(model.addJoint(joints[-1], kind, placement, f"joint_{len(joints)}"))
    start = model.idx_qs[joints[1]]
    model.lowerPositionLimit[start : start + 3] = [-1.0, -0.1, -1.0]
    model.upperPositionLimit[start : start + 3] = [1.0, 0.3, 1.0]
    geometry = pin.GeometryModel()
    ball = coal.Sphere(0.1)
    for joint in (0, *joints[1:]):
        placement = pin.SE3(np.eye(3), np.array([0.05, 0.0, 0.0]))
        geometry.addGeometryObject(pin.GeometryObject(f"ball_{joint}", joint, placement, ball))
    for first, second in ((0, 3), (1, 3), (2, 3), (0, 1)):
        geometry.addCollisionPair(pin.CollisionPair(first, second))
    return model, geometry


def test_bodies_approach_no_faster_than_their_farthest_point() -> None:
    reach = 0.05 + 0.1
    expected = np.array(
        [
            [reach + 0.2 + 0.3 + 0.5, 1.0, reach],
            [0.0, 1.0, reach],
            [0.0, 0.0, reach],
            [reach, 0.0, 0.0],
        ]
    )
    assert np.allclose(approach_rates(*chain()), expected)
    free = approach_rates(*chain(free=True))
    assert free.shape == (4, 5)
    assert np.allclose(free[:, 2:], expected)
    assert np.allclose(free[1:3, :2], 0.0), "both bodies go with the base"
    assert np.allclose(free[0, :2], [1.0, expected[0, 0] + 0.4])
    assert np.allclose(free[3, :2], [1.0, reach + 0.4])


# --- The check


@pytest.fixture(scope="module")
def inwards(humanoid: Robot) -> Motion:
    """The left arm goes into the trunk and out again."""
    still = squat(humanoid, depth=0.0, sway=0.0, duration=1.5)
    s = still.time / still.duration
    return moved_joint(
        humanoid, still, "left_shoulder_roll_joint", -0.5 * smooth(2.5 * s) * smooth(2.5 * (1.0 - s))
    )


def test_a_pair_is_reported_at_the_first_sample_that_is_too_close(humanoid: Robot, inwards: Motion) -> None:
    required = humanoid.description.collision.margin
    sweep = Sweep(humanoid, inwards)
    result = judge_self_collision(sweep)
    every = np.array([all_distances(humanoid, q) for q in sweep.fine.q])
    assert result.margin == pytest.approx(every.min(), abs=2e-3)
    assert result.violations
    geometry = collision_model(humanoid)
    names = [
        f"{geometry.geometryObjects[p.first].name} - {geometry.geometryObjects[p.second].name}"
        for p in geometry.collisionPairs
    ]
    for violation in result.violations:
        pair = names.index(violation.where)
        row = int(np.argmax(every[:, pair] < required))
        assert violation.kind == "self_collision" and violation.limit == required
        assert violation.time_s == pytest.approx(sweep.fine.time[row])
        assert violation.value == pytest.approx(every[row, pair], abs=1e-7)  # a tenth of coal's tolerance


def test_where_the_smallest_distance_suffices_the_margin_is_a_lower_bound(humanoid: Robot) -> None:
    motion = squat(humanoid, depth=0.03, duration=1.5)
    distances = Distances(Sweep(humanoid, motion))
    truth = min(all_distances(humanoid, q).min() for q in motion.resampled(humanoid, 1000.0).q[::3])
    for required, gap in ((truth - 0.01, 1e-3), (truth - 5e-4, 1e-3)):
        closest = find_closest(distances, required)
        assert not closest.found
        assert closest.upper - closest.lower <= gap
        assert closest.lower <= truth + 1e-9 and closest.upper >= truth - 1e-4
    # Where a coarse bound leaves it open whether the distance suffices, the search goes on.
    closest = find_closest(distances, truth - 1.5e-4)
    assert closest.lower >= truth - 1.5e-4 or closest.upper - closest.lower <= 1e-4


def test_a_bound_below_what_is_required_leaves_no_margin(
    humanoid: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep = Sweep(humanoid, squat(humanoid, depth=0.03, duration=1.5))
    required = humanoid.description.collision.margin
    for lower, margin in ((required, required), (required - 1e-9, None)):
        monkeypatch.setattr(
            collision, "find_closest", lambda *_, lower=lower: collision.Closest(lower, lower + 1e-4, {})
        )
        result = judge_self_collision(sweep)
        assert (result.margin, result.violations) == (margin, ())


# --- Waypoints and milder legs


def colliding(robot: Robot) -> np.ndarray:
    """A posture of the arm that its probe finds too close."""
    q = np.array([0.0, 1.7, 0.0, -3.0, 0.0, 0.1, 0.0])
    assert CollisionProbe(robot).collides(q)
    return q


def test_only_points_that_collide_are_redrawn_and_from_their_box(panda: Robot) -> None:
    rest, box = panda.rest, 0.3
    control = np.tile(rest, (12, 1))
    control[3:9] += np.random.default_rng(0).uniform(-box, box, size=(6, 7))
    draws = Draws(rest - box, rest + box, 3, 9)
    candidate = replace(
        make_generator("random_joint").candidates(panda, 1, np.random.SeedSequence(0))[0],
        posture=SplineCurve(control),
        draws=draws,
    )
    repair, probe = Waypoints(panda, CollisionProbe(panda)), CollisionProbe(panda)
    kept = repair.repair(Draft(candidate))
    assert isinstance(kept, Draft)
    assert np.array_equal(kept.candidate.posture.control, control), "what is free stays"
    control[5] = colliding(panda)
    mended = repair.repair(Draft(replace(candidate, posture=SplineCurve(control))))
    again = repair.repair(Draft(replace(candidate, posture=SplineCurve(control))))
    assert isinstance(mended, Draft) and isinstance(again, Draft)
    found = mended.candidate.posture
    assert np.array_equal(found.control, again.candidate.posture.control), "the same seed, the same points"
    changed = np.abs(found.control - control).max(axis=1) > 0.0
    assert changed[5] and not changed[[0, 1, 2, 9, 10, 11]].any()
    assert (np.abs(found.control[changed] - rest) <= box).all()
    assert probe.first(found.evaluate(np.linspace(0.0, found.length, 200))) is None


def test_without_a_way_out_the_candidate_is_refused(panda: Robot) -> None:
    bad = colliding(panda)
    control = np.tile(panda.rest, (12, 1))
    control[3:9] = bad
    candidate = replace(
        make_generator("random_joint").candidates(panda, 1, np.random.SeedSequence(0))[0],
        posture=SplineCurve(control),
        draws=Draws(bad - 1e-4, bad + 1e-4, 3, 9),
    )
    assert isinstance(Waypoints(panda, CollisionProbe(panda)).repair(Draft(candidate)), Draft), (
        "ever harder pulled to rest a point gets free"
    )
    rigid = replace(candidate, draws=None, posture=SplineCurve(control))
    outcome = Waypoints(panda, CollisionProbe(panda)).repair(Draft(rigid))
    # A point is pulled to rest by the same share each time, until it is free.
    assert isinstance(outcome, Draft)
    share = (outcome.candidate.posture.control[5] - panda.rest) / (bad - panda.rest + 1e-12)
    steps = np.log(share[np.abs(bad - panda.rest) > 0.1]) / np.log(0.85)
    assert np.allclose(steps, np.round(steps[0])) and 1 <= round(steps[0]) < 10


def test_milder_squats_and_swings(g1: Robot) -> None:
    squatting = make_generator("squat").candidates(g1, 1, np.random.SeedSequence(1))[0]
    shares = [
        milder.pelvis.control[6, 0] / squatting.pelvis.control[6, 0]
        for milder in milder_candidates(squatting)
    ]
    assert shares == pytest.approx([0.85, 0.7, 0.55])
    swinging = make_generator("leg_swing").candidates(g1, 1, np.random.SeedSequence(1))[0]
    (name,) = swinging.feet
    at = int(np.argmax(np.abs(swinging.feet[name].control).sum(axis=1)))
    feet, leans = [], []
    for milder in milder_candidates(swinging):
        full = swinging.feet[name].control[at]
        feet.append(np.linalg.norm(milder.feet[name].control[at]) / np.linalg.norm(full))
        leans.append(milder.pelvis.control[6, 1] / swinging.pelvis.control[6, 1])
        assert milder.com is swinging.com
    assert feet == pytest.approx([0.85, 0.7, 0.55, 0.7, 0.55])
    assert leans == pytest.approx([1.0, 1.0, 1.0, 0.6, 0.4])
    upper = make_generator("random_joint").candidates(g1, 1, np.random.SeedSequence(1))[0]
    assert list(milder_candidates(replace(upper, pelvis=None, com=None, feet={}))) == []


def test_milder_walks_change_pitch_and_roll_alone() -> None:
    robot = load_robot("hrp2like")
    walk = make_generator("walking").candidates(robot, 1, np.random.SeedSequence(7))[0]
    s = np.linspace(0.0, 3.0, 4)
    feet = {name: hermite_curve(s, np.vstack([np.zeros(6), np.ones((3, 6))])) for name in walk.feet}
    walk = replace(walk, feet=feet, pelvis=hermite_curve(s, np.vstack([np.zeros(4), np.ones((3, 4))])))
    end, found = np.array([3.0]), []
    for milder in milder_candidates(walk):
        for name in feet:
            foot = milder.feet[name].evaluate(end)[0]
            assert np.delete(foot, 4) == pytest.approx(np.ones(5))
        pelvis = milder.pelvis.evaluate(end)[0]
        assert np.delete(pelvis, 1) == pytest.approx(np.ones(3))
        found.append((foot[4], pelvis[1]))
    assert np.allclose(found, [(0.5, 1.0), (0.5, 0.5), (0.5, 1.4)])


class Never:
    """A probe to which everything collides; keeps the point that each look began with."""

    def __init__(self) -> None:
        self.seen: list[np.ndarray] = []

    def first(self, q: np.ndarray) -> int:
        self.seen.append(q[0].copy())
        return 0

    def closest(self, q: np.ndarray) -> TooClose:
        assert any(np.array_equal(q[0], point) for point in self.seen), "a posture that was looked at"
        return TooClose("hand - base", 0.001, 0.02, q[0])


class Corner(Draws):
    """Draws the box's upper corner, always."""

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        return self.upper


def test_points_are_pulled_to_rest_ever_harder_and_given_up_in_the_end(panda: Robot) -> None:
    """Eleven free draws, then each 0.88 of the one before; 500 in all."""
    rest, away = panda.rest, 0.2
    candidate = replace(
        make_generator("random_joint").candidates(panda, 1, np.random.SeedSequence(0))[0],
        posture=SplineCurve(np.tile(rest, (12, 1))),
        draws=Corner(rest - away, rest + away, 3, 9),
    )
    probe = Never()
    outcome = Waypoints(panda, probe).repair(Draft(candidate))
    assert isinstance(outcome, Rejection)
    assert (outcome.reason, outcome.where) == ("self_collision", "hand - base")
    assert (outcome.value, outcome.limit) == (0.001, 0.02)
    drawn = [float((point - rest)[0] / away) for point in probe.seen]
    assert len(drawn) == 501, "the first point and 500 draws"
    expected = [0.0, *[1.0] * 11, *(0.88**k for k in range(1, 15))]
    assert drawn[:26] == pytest.approx(expected)
    assert drawn[26] == pytest.approx(1.0), "after 25 it begins anew, a point earlier"


def test_a_curve_that_must_not_be_redrawn_is_shrunk_ten_times(panda: Robot) -> None:
    control = np.tile(panda.rest, (12, 1))
    control[3:9] += 0.2
    candidate = replace(
        make_generator("random_joint").candidates(panda, 1, np.random.SeedSequence(0))[0],
        posture=SplineCurve(control),
        draws=None,
    )

    class After(Never):
        def __init__(self, tries: int) -> None:
            super().__init__()
            self.tries = tries

        def first(self, q: np.ndarray) -> int | None:
            super().first(q)
            return 0 if len(self.seen) <= self.tries else None

    for tries, share in ((0, 1.0), (3, 0.85**3), (9, 0.85**9)):
        outcome = Waypoints(panda, After(tries)).repair(Draft(candidate))
        assert isinstance(outcome, Draft)
        assert np.allclose(outcome.candidate.posture.control - panda.rest, share * (control - panda.rest))
    assert isinstance(Waypoints(panda, After(10)).repair(Draft(candidate)), Rejection)


# --- The search itself, on distances that are functions of time


class Profiles:
    """Stands for :class:`Distances`: pair ``k`` is ``level − steepness·max(0, width − |t − at|)`` apart."""

    def __init__(
        self, dips: list[tuple[float, float, float]], duration: float, rate_hz: float = 200.0
    ) -> None:
        self.dips = np.array(dips)
        self.time = np.linspace(0.0, duration, round(duration * rate_hz) + 1)
        self.sweep = SimpleNamespace(fine=SimpleNamespace(time=self.time))
        self._times = self.time.tolist()
        self.n_pairs = len(dips)
        self.asked = 0

    steepness = 2.0

    def at(self, time: float, pairs: np.ndarray) -> np.ndarray:
        self.asked += 1
        level, at, width = self.dips[pairs].T
        return level - self.steepness * np.maximum(0.0, width - np.abs(time - at))

    def at_least(self, times: np.ndarray) -> np.ndarray:
        """Bounds that are loose by more and less, of every other pair none."""
        found = np.array([self.at(float(time), np.arange(self.n_pairs)) for time in times])
        return found - np.where(
            np.arange(self.n_pairs) % 2, np.inf, 0.3 * np.abs(np.sin(40.0 * times))[:, None]
        )

    def approach(self, start: float, end: float, pairs: np.ndarray) -> np.ndarray:
        return np.full(len(pairs), self.steepness * (end - start))

    def ways(self, times: np.ndarray) -> np.ndarray:
        return np.repeat(self.steepness * np.diff(times)[:, None], self.n_pairs, axis=1)

    midpoint = Distances.midpoint


@pytest.mark.parametrize("duration", [0.33, 1.0, 2.7])
def test_the_search_finds_every_dip_wherever_it_is(duration: float) -> None:
    """Also between two samples of the grid, in the first and the last of them, and of the pair that is far at first."""
    rng = np.random.default_rng(0)
    places = [0.002, 0.4 * duration, duration - 0.0021, *rng.uniform(0.0, duration, size=5)]
    for at in places:
        for depth in (0.004, 0.03, 0.3):
            dips = [(1.0, 0.0, 0.0), (0.2 + depth, at, 0.5 * depth), (0.25, 0.5 * duration, 0.01)]
            profiles = Profiles(dips, duration)
            truth = float(min(0.2, profiles.at(0.5 * duration, np.arange(3)).min()))
            for required, found in ((0.15, False), (0.205, True)):
                closest = find_closest(profiles, required)
                assert closest.lower <= truth + 1e-12
                assert closest.upper >= truth - 1e-12
                assert closest.upper - closest.lower <= 1e-3
                assert (1 in closest.found) is found or not found
                assert bool(closest.found) is found
                for pair, (time, value) in closest.found.items():
                    assert value == pytest.approx(profiles.at(time, np.array([pair]))[0])
                    assert value < required


def test_the_search_evaluates_little_where_nothing_comes_near() -> None:
    far = Profiles([(1.0, 0.0, 0.0), (0.9, 0.5, 0.001)], 2.0)
    closest = find_closest(far, 0.05)
    assert closest.lower >= 0.05 and not closest.found
    assert far.asked < 2000
