"""Motions designed by gradients: derivatives against differences, safety, gain, and targets by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from excite.arrays import Array
from excite.campaign.gradient_search import GradientDesign, chosen_sources, sets_within
from excite.campaign.optimised_series import Asked
from excite.errors import InputError, UnknownNameError
from excite.excitation.design_rows import ArmRows, StandingRows, design_rows
from excite.excitation.gradient_design import (
    DesignProgram,
    design_motions,
    first_information,
)
from excite.excitation.selection import Criterion, LogDeterminant
from excite.excitation.targets import ReachedTargets, asked_parameters
from excite.motion.collection import load_motions
from excite.motion.generators.mixture import plan_proposals
from excite.motion.motion import Motion
from excite.regressor.kernels import forward_kinematics
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.filter import filter_candidate, filter_candidates
from excite.safety.parameter_set import stated_parameters


@pytest.fixture(scope="module")
def source(ur10: Robot) -> Motion:
    return load_motions("ur10")[0]


@pytest.fixture(scope="module")
def standing(g1: Robot) -> Motion:
    proposals = plan_proposals(g1, 1, np.random.SeedSequence(0), mix={"random_joint": 1.0}, targets=())
    return filter_candidates(g1, proposals).motions[0]


def _known_before(rows: StandingRows, motion: Motion) -> Array:
    """What makes all directions known: one motion leaves many in which differences would be of rounding."""
    known = first_information(rows, [motion])
    return np.asarray(known + 1e-2 * np.diag(np.diag(known)))


def test_gradient_of_a_standing_robot_against_differences(g1: Robot, standing: Motion) -> None:
    rows = StandingRows(g1)
    known = _known_before(rows, standing)
    program = DesignProgram(rows, standing, known, LogDeterminant())
    x, way = 0.5 * np.random.default_rng(0).normal(size=(2, program.size))
    program.watch(x)
    # Rates through samples carry a thousand times the rounding of positions. With a tenth of the limits every edge,
    # face and leg counts.
    for weight, share in ((0.0, 1.0), (5.0, 1.0), (5.0, 0.1)):
        program._burden.most *= share
        slope = program.evaluate(x, weight)[1] @ way
        ends = [program.evaluate(x + step * way, weight)[0] for step in (4e-4, -4e-4)]
        assert slope == pytest.approx((ends[0] - ends[1]) / 8e-4, rel=1e-5)


def test_a_standing_robots_design_leaves_the_stated_set_no_less_room_and_says_more(
    g1: Robot, standing: Motion
) -> None:
    rows = StandingRows(g1)
    known = _known_before(rows, standing)
    sampled = standing.resampled(g1, 24.0)
    own = known + rows.information(sampled.q, sampled.v, sampled.a)
    (design,) = design_motions(rows, [standing], known, LogDeterminant())
    assert check_motion(g1, design.motion).safe
    own_least, least = (
        check_motion(g1, motion, parameters=stated_parameters(g1)).robust.worst["zmp_m"]
        for motion in (standing, design.motion)
    )
    assert least.value >= min(own_least.value, own_least.limit)
    placed = [forward_kinematics(g1.model, motion.q) for motion in (standing, design.motion)]
    for foot in g1.feet:
        for part in ("translation", "rotation"):
            before, after = (getattr(one, part)[:, foot.joint] for one in placed)
            assert np.allclose(before, after, atol=1e-9)
    assert np.abs(design.motion.q[:, :3] - standing.q[:, :3]).max() > 0.005
    gain = np.linalg.slogdet(known + design.information)[1] - np.linalg.slogdet(own)[1]
    assert gain > 0.05 * len(known)


def _some_targets(rows: ArmRows) -> Criterion:
    return ReachedTargets.of(rows.robot, rows.base, ("forearm_link:com",), target_rsd=15.0, rows=2.4)


@pytest.mark.parametrize("criterion", [lambda _: LogDeterminant(), _some_targets], ids=["log_det", "targets"])
@pytest.mark.parametrize("weight", [0.0, 5.0])
def test_gradient_against_differences(
    weight: float, criterion: Callable[[ArmRows], Criterion], ur10: Robot, source: Motion
) -> None:
    rows = ArmRows(ur10)
    program = DesignProgram(rows, source, first_information(rows, [source]), criterion(rows))
    x, way = 0.5 * np.random.default_rng(0).normal(size=(2, program.size))
    program.watch(x)

    def value(step: float) -> float:
        return program.evaluate(x + step * way, weight)[0]

    slope = program.evaluate(x, weight)[1] @ way
    assert slope == pytest.approx((value(1e-6) - value(-1e-6)) / 2e-6, rel=1e-5)


def test_designed_motions_are_safe_and_each_adds_more_than_its_source(ur10: Robot, source: Motion) -> None:
    rows = ArmRows(ur10)
    known = first_information(rows, [source])
    sampled = source.resampled(ur10, 24.0)
    own = known + rows.information(sampled.q, sampled.v, sampled.a)
    values = [np.linalg.slogdet(known)[1]]
    speeds = []
    for design in design_motions(rows, [source, source], known, LogDeterminant()):
        assert check_motion(ur10, design.motion).safe
        assert np.allclose(design.motion.v[[0, -1]], 0.0, atol=1e-9)
        assert np.allclose(design.motion.q[[0, -1]], source.q[[0, -1]], atol=1e-9)
        speeds.append(np.max(np.abs(design.motion.v) / ur10.limits.velocity))
        known = known + design.information
        values.append(np.linalg.slogdet(known)[1])
    assert values[1] > np.linalg.slogdet(own)[1]
    assert np.all(np.diff(values) > 0.0)
    # Repairs keep to 80 %; the check does not ask for that.
    assert max(speeds) > 0.9


def test_what_stands_without_force_sensors_is_refused(g1: Robot) -> None:
    with pytest.raises(InputError, match="arms with a motor"):
        ArmRows(g1)
    for name in ("go2", "g1_no_ft"):
        with pytest.raises(InputError, match="force sensors in its feet"):
            design_rows(load_robot(name))


def _random_information(rng: np.random.Generator) -> Array:
    rows = rng.normal(size=(20, 6))
    return np.asarray(rows.T @ rows)


def test_targets_pull_by_their_gradient_and_not_once_they_are_met() -> None:
    rng = np.random.default_rng(1)
    criterion = ReachedTargets(rng.normal(size=(4, 6)), np.array([0.1, 0.2, 0.3, 50.0]))
    known, more = _random_information(rng), _random_information(rng)
    slope = (criterion.value(known + 1e-6 * more) - criterion.value(known - 1e-6 * more)) / 2e-6
    assert np.trace(criterion.gradient(known) @ more) == pytest.approx(slope, rel=1e-6)
    met = ReachedTargets(criterion.back[3:], criterion.goal[3:])
    assert criterion.value(known) < 1e3 * met.value(known) < 0.0


def test_targets_by_name() -> None:
    names = ("Ixx(arm)", "m(arm)", "viscous(elbow)", "coulomb(elbow)", "my(arm)")
    assert asked_parameters((), names) == names
    assert asked_parameters(("elbow:friction", "arm:mass"), names) == (
        "viscous(elbow)",
        "coulomb(elbow)",
        "m(arm)",
    )
    assert asked_parameters(("my(arm)",), names) == ("my(arm)",)
    with pytest.raises(InputError, match="no colon"):
        asked_parameters(("elbow",), names)
    with pytest.raises(InputError, match="no motion tells 'elbow:mass' by itself; ask for elbow:friction"):
        asked_parameters(("elbow:mass",), names)
    with pytest.raises(UnknownNameError, match="taste"):
        asked_parameters(("elbow:taste",), names)


def test_robots_with_loops_and_arms_without_noise_are_told(iiwa_without_noise: Robot) -> None:
    with pytest.raises(InputError, match="noise"):
        first_information(ArmRows(iiwa_without_noise), [load_motions("iiwa14")[0]])


@pytest.fixture
def iiwa_without_noise() -> Robot:
    robot = load_robot("iiwa14")
    sensors = robot.description.sensors.model_copy(update={"noise_torque": None})
    return replace(robot, description=robot.description.model_copy(update={"sensors": sensors}))


def test_a_motion_that_no_step_makes_richer_safely_keeps_its_generators_name(
    ur10: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("excite.excitation.gradient_design._is_safe", lambda *_, **__: False)
    made = GradientDesign().candidates(Asked(ur10, 1), seed=0)
    assert [(one.name, one.metadata.generator) for one in made] == [("random_joint_000", "random_joint")]


def test_sets_fit_into_the_time_and_leave_none_out(source: Motion) -> None:
    lengths = [8.0, 7.9, 9.4, 5.7, 30.0]
    motions = [replace(source, name=str(t), time=source.time * (t / source.duration)) for t in lengths]
    sets = sets_within(motions, 22.0)
    assert [[one.name for one in some] for some in sets] == [["8.0", "7.9", "5.7"], ["9.4"], ["30.0"]]
    assert [len(some) for some in sets_within(motions, None)] == [3, 2]


def test_sources_fit_into_the_minutes_and_say_more_than_others_that_do(ur10: Robot) -> None:
    rows, motions = ArmRows(ur10), load_motions("ur10")[:4]
    known = first_information(rows, motions)
    budget = sum(sorted(one.duration for one in motions)[-2:])
    chosen = chosen_sources(rows, motions, known, LogDeterminant(), budget)
    assert sum(one.duration for one in chosen) <= budget

    def value(some: Sequence[Motion]) -> float:
        return float(np.linalg.slogdet(known + sum(map(rows.of_motion, some)))[1])

    assert value(chosen) >= max(value(pair) for pair in combinations(motions, 2)) - 1e-9
    shortest = min(motions, key=lambda one: one.duration)
    assert chosen_sources(rows, motions, known, LogDeterminant(), 0.1) == [shortest]


def test_a_motion_is_judged_as_it_is_and_no_repair_slows_it(ur10: Robot, source: Motion) -> None:
    faster = 0.95 * min(
        np.min(ur10.limits.velocity / np.abs(source.v).max(axis=0)),
        np.sqrt(np.min(ur10.limits.acceleration / np.abs(source.a).max(axis=0))),
    )
    hurried = replace(
        source, time=source.time / faster, v=source.v * faster, a=source.a * faster**2, name="hurried"
    )
    outcome = filter_candidate(ur10, hurried)
    assert (outcome.rejection is None) == check_motion(ur10, hurried).safe
    too_fast = replace(hurried, time=hurried.time / 1.2, v=hurried.v * 1.2, a=hurried.a * 1.44)
    refused = filter_candidate(ur10, too_fast)
    assert refused.rejection is not None
    assert refused.rejection.reason.startswith("check_")
    assert refused.candidate == "hurried"
