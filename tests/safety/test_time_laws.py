"""How fast a path is run: time laws, their smoothing, the factor that keeps every limit, transfers, samples."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from excite.motion.generators.curves import SplineCurve
from excite.motion.generators.generator import Candidate, SupportPhase
from excite.motion.generators.registry import make_generator
from excite.robot.robot import Robot
from excite.safety.checks.motion import judge_sampling
from excite.safety.checks.sweep import Sweep
from excite.safety.repairs.collisions import CollisionProbe
from excite.safety.repairs.draft import Draft, Rejection
from excite.safety.repairs.path import MotionPath, TimeLaw
from excite.safety.repairs.retiming import Retiming, fastest_rate, smoothed_law
from excite.safety.repairs.rows import PathLimits, Rows, Shares
from excite.safety.repairs.sampling import Sampling, plan_transfer
from excite.safety.repairs.time_scaling import TimeScaling, largest_factor

# --- Time laws


def test_a_law_keeps_its_rates_and_its_interval() -> None:
    time = np.linspace(0.0, 2.0, 41)
    law = TimeLaw(time, 3.0 * time, (3.0, 3.0))
    assert law.duration == 2.0
    assert law.evaluate(np.array([-1.0, 0.5, 9.0])) == pytest.approx([0.0, 1.5, 6.0])
    assert law.evaluate(np.array([0.0, 1.0, 2.0]), 1) == pytest.approx([3.0, 3.0, 3.0])
    quick = law.faster(1.5)
    assert quick.duration == pytest.approx(2.0 / 1.5)
    assert quick.evaluate(np.array([0.0, 1.0]), 1) == pytest.approx([4.5, 4.5])
    assert quick.evaluate(np.array([1.0])) == pytest.approx([4.5])
    rest = TimeLaw(time, 3.0 * (1.0 - np.cos(0.5 * np.pi * time)))
    assert rest.evaluate(np.array([0.0, 2.0]), 1) == pytest.approx([0.0, 0.0])


def free_rows(n: int, limit: float) -> Rows:
    """``|s̈| ≤ limit`` at each of ``n`` knots."""
    one = np.ones((n, 1))
    return Rows(
        (("a", "x"), ("a", "x")),
        np.hstack([-limit * one, -limit * one]),
        np.zeros((n, 2)),
        np.hstack([one, -one]),
    )


def test_speed_keeps_its_bound_and_the_slowest_unit() -> None:
    s = np.linspace(0.0, 12.0, 1201)
    bound = np.where((s > 3.0) & (s < 4.0), 1.2, np.inf)
    rate = fastest_rate(s, free_rows(len(s), 100.0), bound)
    assert rate is not None
    assert rate[0] == rate[-1] == pytest.approx(0.0, abs=1e-9)
    assert rate[(s > 3.0) & (s < 4.0)].max() == pytest.approx(1.2, abs=1e-6)
    assert rate.max() == pytest.approx(1.0 / 0.12, rel=1e-3), "no unit takes less than 0.12 s"
    slope = np.diff(rate**2) / (2.0 * np.diff(s))
    assert np.abs(slope).max() == pytest.approx(12.0, rel=1e-3), (
        "nor does the rate change by more than 12 1/s²"
    )


def test_a_path_on_which_nothing_can_stand_has_no_speed() -> None:
    s = np.linspace(0.0, 1.0, 101)
    assert fastest_rate(s, free_rows(len(s), -1.0), np.full(len(s), np.inf)) is None


def test_smoothing_takes_the_jumps_away_and_little_else() -> None:
    """A profile that accelerates by 4 and brakes by 4: the smooth one takes as long as the kernel more."""
    s = np.linspace(0.0, 4.0, 401)
    rate = np.sqrt(2.0 * 4.0 * np.minimum(s, 4.0 - s))
    law = smoothed_law(s, rate)
    assert law.duration == pytest.approx(2.0 + 0.14, abs=0.006)
    time = np.linspace(0.0, law.duration, 4001)
    position, speed, acceleration = (law.evaluate(time, order) for order in range(3))
    assert position[[0, -1]] == pytest.approx([0.0, 4.0])
    assert (np.diff(position) >= -1e-12).all()
    assert speed.max() < 4.0 and speed[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert np.abs(acceleration).max() == pytest.approx(4.0, rel=0.02)
    # In the middle of the first half it is the profile itself, later by half a kernel.
    late = (time > 0.3) & (time < 0.8)
    assert position[late] == pytest.approx(2.0 * (time[late] - 0.07) ** 2 + 2.0 * 0.0007, abs=1e-3)
    # A jump of 4 spread over a kernel of 0.14 s: at most twice as steep as evenly.
    jerk = np.diff(acceleration) / (time[1] - time[0])
    assert np.abs(jerk[(time[1:] < 0.4)]).max() < 1.15 * 2.0 * 4.0 / 0.14
    assert np.allclose(position + position[::-1], 4.0, atol=0.02), "forwards and backwards alike"


# --- The factor that keeps every limit


@pytest.fixture(scope="module")
def path(panda: Robot) -> MotionPath:
    s = np.linspace(0.0, 5.0, 101)
    bump = np.sin(np.pi * s / 5.0)[:, None] ** 2
    way = np.array([0.6, -0.4, 0.5, 0.3, -0.7, 0.4, 0.8])
    swing = np.sin(1.7 * s[:, None] + np.arange(7)) - np.sin(np.arange(7))
    return MotionPath(panda, s, panda.rest + bump * (way + 0.3 * swing))


@pytest.fixture(scope="module")
def candidate(panda: Robot) -> Candidate:
    control = np.tile(panda.rest, (8, 1))
    return Candidate("c", "here", (), 0, SplineCurve(control))


@pytest.fixture(scope="module")
def law() -> TimeLaw:
    time = np.linspace(0.0, 4.0, 81)
    u = time / 4.0
    return TimeLaw(time, 5.0 * u**3 * (10.0 - 15.0 * u + 6.0 * u**2))


def usage(limits: PathLimits, law: TimeLaw, rate_hz: float) -> dict[str, np.ndarray]:
    """How much of each limit a law uses at each sample; 1 at the limit."""
    robot, shares = limits.path.robot, limits.shares
    time = np.linspace(0.0, law.duration, round(law.duration * rate_hz) + 1)
    s, speed, acceleration = (law.evaluate(time, order) for order in range(3))
    sample = limits.path.sample(s)
    v = sample.twist * speed[:, None]
    a = sample.curvature * speed[:, None] ** 2 + sample.twist * acceleration[:, None]
    jerk = np.diff(a, axis=0) / np.diff(time)[:, None]
    rows = limits.rows(sample)
    value = rows.static + rows.curved * speed[:, None] ** 2 + rows.driven * acceleration[:, None]
    return {
        "joint_velocity": np.abs(v / (shares.velocity * robot.limits.velocity)).max(axis=1),
        "joint_jerk": np.abs(jerk / (shares.jerk * robot.limits.jerk)).max(axis=1),
        "phase_rate": speed / (1.25 * limits.phase_bound(s)),
        "rows": 1.0 + value.max(axis=1),
    }


BINDING = {
    "joint_velocity": Shares(velocity=0.15),
    "joint_jerk": Shares(jerk=0.002),
    "joint_acceleration": Shares(acceleration=0.05),
    "joint_torque": Shares(torque=0.7, acceleration=50.0, velocity=10.0, jerk=1e4),
    "phase_rate": Shares(),
}


@pytest.mark.parametrize("reason", list(BINDING))
def test_the_factor_reaches_the_limit_that_it_names(
    reason: str, path: MotionPath, candidate: Candidate, law: TimeLaw, panda: Robot
) -> None:
    if reason == "phase_rate":
        candidate = replace(candidate, phases=(SupportPhase(1.0, 3.0, (), 0.8),))
    limits = PathLimits(candidate, path, BINDING[reason])
    found = largest_factor(limits, law, 400.0)
    assert found.reason == reason
    scaled = law.faster(found.factor)
    used = usage(limits, scaled, 400.0 * found.factor)
    key = reason if reason in used else "rows"
    peak = {name: values.max() for name, values in used.items()}
    assert peak[key] == pytest.approx(1.0, abs=2e-3)
    assert max(peak.values()) <= 1.0 + 2e-3, "no other limit is passed"
    at = int(np.argmax(used[key]))
    assert found.time == pytest.approx(at / 400.0, abs=0.006), "the time in the law as it was"
    assert found.where == "path" if reason == "phase_rate" else found.where in panda.joint_names


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_where_standing_still_breaks_a_limit_no_speed_helps(
    sign: float, path: MotionPath, candidate: Candidate, law: TimeLaw
) -> None:
    class Impossible(PathLimits):
        def joint_shares(self, sample):
            shares = super().joint_shares(sample)
            static = shares.static.copy()
            static[np.abs(sample.s - 0.5 * self.path.s[-1]) < 1e-2, 3] = sign * 1.1
            return replace(shares, static=static)

    found = largest_factor(Impossible(candidate, path, Shares()), law, 400.0)
    assert (found.factor, found.reason) == (0.0, "joint_acceleration")
    assert found.time == pytest.approx(0.5 * law.duration, abs=0.01)


def scaled(limits: PathLimits, law: TimeLaw, **changes: object) -> Draft | Rejection:
    draft = Draft(replace(limits.candidate, **changes), limits.path, limits, law)
    return TimeScaling(limits.path.robot).repair(draft)


def test_a_law_is_sped_up_to_its_limit_in_whole_samples(
    path: MotionPath, candidate: Candidate, law: TimeLaw, panda: Robot
) -> None:
    rate = panda.description.sensors.rate_hz
    limits = PathLimits(candidate, path, Shares())
    factor = largest_factor(limits, law, min(2 * rate, 400.0)).factor
    for slower in (1.0, 1.4):
        outcome = scaled(limits, law.faster(factor / slower))
        assert isinstance(outcome, Draft) and outcome.law is not None
        samples = outcome.law.duration * rate
        assert samples == pytest.approx(round(samples), abs=1e-9)
        assert outcome.law.duration == pytest.approx(law.duration / factor, abs=1.5 / rate)
        assert outcome.law.duration >= law.duration / factor - 1e-9


def test_no_law_is_sped_up_by_more_than_1_6_and_none_with_its_own_speed(
    path: MotionPath, candidate: Candidate, law: TimeLaw, panda: Robot
) -> None:
    limits, slow = PathLimits(candidate, path, Shares()), law.faster(0.2)
    sample = 1.0 / panda.description.sensors.rate_hz
    outcome = scaled(limits, slow)
    assert isinstance(outcome, Draft) and outcome.law is not None
    assert outcome.law.duration == pytest.approx(slow.duration / 1.6, abs=sample)
    kept = scaled(limits, slow, speed=1.0)
    assert isinstance(kept, Draft) and kept.law is not None
    assert kept.law.duration == pytest.approx(slow.duration, abs=sample)


@pytest.mark.parametrize(("factor", "accepted"), [(0.31, True), (0.29, False)])
def test_what_has_to_be_run_too_slowly_is_refused(
    factor: float, accepted: bool, path: MotionPath, candidate: Candidate, law: TimeLaw
) -> None:
    limits = PathLimits(candidate, path, Shares(velocity=0.15))
    found = largest_factor(limits, law, 400.0)
    outcome = scaled(limits, law.faster(found.factor / factor))
    if accepted:
        assert isinstance(outcome, Draft)
    else:
        assert isinstance(outcome, Rejection)
        assert (outcome.reason, outcome.where) == (found.reason, found.where)
        assert outcome.time_s == pytest.approx(found.time * factor / found.factor, abs=0.01)


# --- Retiming


def test_curves_with_a_speed_of_their_own_keep_it(
    path: MotionPath, candidate: Candidate, panda: Robot
) -> None:
    outcome = Retiming(panda, shares=Shares()).repair(Draft(replace(candidate, speed=0.8), path))
    assert isinstance(outcome, Draft) and outcome.law is not None
    assert outcome.law.duration == pytest.approx(candidate.length / 0.8)
    time = np.linspace(0.0, outcome.law.duration, 50)
    assert outcome.law.evaluate(time) == pytest.approx(0.8 * time)
    assert outcome.law.evaluate(time, 1) == pytest.approx(np.full(50, 0.8))


def test_other_curves_are_run_as_fast_as_they_may(
    path: MotionPath, candidate: Candidate, panda: Robot
) -> None:
    outcome = Retiming(panda, shares=Shares()).repair(Draft(candidate, path))
    assert isinstance(outcome, Draft) and outcome.law is not None and outcome.limits is not None
    factor = largest_factor(outcome.limits, outcome.law, 400.0).factor
    assert 0.6 < factor < 1.3, "smoothing moves it a little off the limit"
    assert isinstance(Retiming(panda, shares=Shares()).repair(Draft(candidate)), Rejection)


# --- Transfers and samples


def test_a_transfer_uses_half_of_the_limits(panda: Robot) -> None:
    for way in (0.02, 0.4, 1.5):
        end = panda.rest + way * np.array([0.5, -0.2, 0.1, 0.3, -0.6, 0.2, 0.1])
        moved = plan_transfer(panda, panda.rest, end, 500.0)
        limits = panda.limits
        jerk = np.diff(moved.a, axis=0) * 500.0
        used = {
            name: (np.abs(values) / limit).max()
            for name, values, limit in (
                ("v", moved.v, limits.velocity),
                ("a", moved.a, limits.acceleration),
                ("j", jerk, limits.jerk),
            )
        }
        assert max(used.values()) <= 0.5 + 1e-9
        assert max(used.values()) > 0.45, "as fast as that allows"
        assert np.allclose(moved.time, np.arange(len(moved.q)) / 500.0)
        for values, rates in ((moved.q, moved.v), (moved.v, moved.a)):
            gained = np.cumsum(0.5 * (rates[1:] + rates[:-1]), axis=0) / 500.0
            assert np.allclose(values[1:] - values[0], gained, atol=0.01 * np.abs(values - values[0]).max())
        assert np.allclose(moved.a[[0, -1]], 0.0, atol=0.01 * limits.acceleration.max())


def test_a_motion_that_starts_elsewhere_is_reached_and_left(
    path: MotionPath, candidate: Candidate, law: TimeLaw, panda: Robot
) -> None:
    away = replace(path, coordinates=path.coordinates + np.r_[0.1, np.zeros(6)])
    sampling, rate = Sampling(panda, CollisionProbe(panda)), panda.description.sensors.rate_hz
    outcomes = {
        name: sampling.repair(Draft(candidate, p, None, law)) for name, p in (("away", away), ("at", path))
    }
    motions = {}
    for name, outcome in outcomes.items():
        assert isinstance(outcome, Draft) and outcome.motion is not None
        motion = motions[name] = outcome.motion
        assert np.allclose(motion.time, np.arange(motion.n_samples) / rate)
        assert np.allclose(motion.q[[0, -1]], panda.rest, atol=1e-9)
        assert np.allclose(motion.v[[0, -1]], 0.0, atol=1e-6)
        assert judge_sampling(Sweep(panda, motion)).violations == ()
        assert motion.metadata.robot_hash == panda.hash
        assert motion.metadata.seed == candidate.seed
    there = plan_transfer(panda, panda.rest, away.coordinates[0], rate)
    middle = motions["at"].n_samples
    assert motions["away"].n_samples == middle + 2 * (len(there.q) - 1)
    first = len(there.q) - 1
    assert np.allclose(motions["away"].q[first : first + middle], motions["at"].q + np.r_[0.1, np.zeros(6)])
    assert np.array_equal(motions["away"].q[: first + 1], there.q)


def test_a_transfer_that_collides_is_refused(
    path: MotionPath, candidate: Candidate, law: TimeLaw, panda: Robot
) -> None:
    folded = np.clip(
        np.array([0.0, 1.7, 0.0, -3.0, 0.0, 0.1, 0.0]),
        panda.limits.position_lower,
        panda.limits.position_upper,
    )
    probe = CollisionProbe(panda)
    assert probe.collides(folded)
    away = replace(path, coordinates=path.coordinates - path.coordinates[0] + folded)
    outcome = Sampling(panda, probe).repair(Draft(candidate, away, None, law))
    assert isinstance(outcome, Rejection)
    assert outcome.reason == "self_collision" and outcome.where.startswith("transfer, ")


def test_contacts_follow_the_phases(g1: Robot) -> None:
    candidate = make_generator("leg_swing").candidates(g1, 1, np.random.SeedSequence(4))[0]
    s = np.linspace(0.0, candidate.length, 200)
    coordinates = np.tile(np.r_[g1.rest[:3], np.zeros(3), g1.rest[7:]], (200, 1))
    law = TimeLaw(s / 2.0, s, (2.0, 2.0))
    outcome = Sampling(g1, CollisionProbe(g1)).repair(
        Draft(candidate, MotionPath(g1, s, coordinates), None, law)
    )
    assert isinstance(outcome, Draft) and outcome.motion is not None
    for foot in g1.feet:
        expected = candidate.supports(2.0 * outcome.motion.time, foot.name)
        assert np.mean(outcome.motion.contacts[foot.name] == expected) > 0.99


def test_what_a_newer_python_says_of_toppras_docstrings_is_not_shown(tmp_path):
    """As in the first run after an installation that compiles nothing (uv's); 3.11 says nothing of them anyway."""
    (tmp_path / "toppra").mkdir()
    (tmp_path / "toppra" / "__init__.py").write_text("import warnings; warnings.warn('odd', SyntaxWarning)")
    code = (
        "import numpy as np, sys; from excite.safety.repairs.retiming import fastest_rate; "
        f"sys.path.insert(0, {str(tmp_path)!r})\n"
        "try: fastest_rate(np.linspace(0, 1, 3), None, np.ones(3))\n"
        "except ImportError: print('imported')"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (run.stdout, run.stderr) == ("imported\n", "")
