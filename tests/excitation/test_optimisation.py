"""Optimised excitation: derivatives against differences, limits against the independent check, repeatability."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.arrays import Array
from excite.errors import InputError, NoSolutionError, UnknownNameError
from excite.excitation.conditioning import motion_factor
from excite.excitation.near_bodies import NearBodies, closest_points
from excite.excitation.series import CRITERIA, ExcitationTask, MotionFamily, fourier_family
from excite.excitation.series_search import (
    SearchResult,
    SearchSettings,
    SeriesProgram,
    linear_rows,
    optimise_excitation,
    solve_program,
)
from excite.regressor.adjoint import regressor_gradient
from excite.regressor.kernels import base_link_regressor, joint_torque_regressor
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from tests.benchmarks.fourier_optimisation import AmplitudeSums
from tests.benchmarks.waypoints import waypoint_family

_STEP = 1e-6
FAMILY = fourier_family(8.0, 3)


@pytest.fixture(scope="module")
def iiwa() -> Robot:
    return load_robot("iiwa14")


@pytest.fixture(scope="module")
def found(iiwa: Robot) -> SearchResult:
    return optimise_excitation(
        ExcitationTask(iiwa, FAMILY), SearchSettings(starts=2, kicks=0, seed=1), jobs=1
    )


@pytest.mark.parametrize("name", ["iiwa14", "g1"])
def test_regressor_gradients_against_differences(name: str, request: pytest.FixtureRequest) -> None:
    robot = load_robot(name)
    model, rng = robot.model, np.random.default_rng(0)

    def moved(q: Array, way: Array) -> Array:
        return np.array([pin.integrate(model, *row) for row in zip(q, way, strict=True)])

    q = moved(np.tile(robot.rest, (2, 1)), 0.3 * rng.normal(size=(2, model.nv)))
    v, a = rng.normal(size=(2, 2, model.nv))
    regressor = base_link_regressor if robot.floating else joint_torque_regressor
    weights = rng.normal(size=regressor(model, q, v, a).shape)
    gradient = regressor_gradient(model, q, v, a, weights)
    ways = rng.normal(size=(3, 2, model.nv))
    for k, exact in enumerate((gradient.q, gradient.v, gradient.a)):
        ends = [np.array([k == i for i in range(3)])[:, None, None] * ways * step for step in (_STEP, -_STEP)]
        up, down = (
            (weights * regressor(model, moved(q, one[0]), v + one[1], a + one[2])).sum() for one in ends
        )
        assert (exact * ways[k]).sum() == pytest.approx((up - down) / (2 * _STEP), rel=1e-6, abs=1e-6)


def test_gradients_refuse_what_they_cannot_differentiate(iiwa: Robot) -> None:
    q, v = np.zeros((1, 7)), np.zeros((1, 7))
    with pytest.raises(InputError, match="weights"):
        regressor_gradient(iiwa.model, q, v, v, np.zeros((1, 7, 3)))


@pytest.mark.parametrize("name", sorted(CRITERIA))
@pytest.mark.parametrize("family", [FAMILY, waypoint_family(2.0, 4)], ids=["fourier", "waypoints"])
@pytest.mark.parametrize("held", [0.0, 30.0], ids=["free", "held"])
def test_gradient_of_the_program_against_differences(
    name: str, family: MotionFamily, held: float, iiwa: Robot
) -> None:
    """Criterion alone, and with multipliers that make every torque, pair of bodies and sum of amplitudes count."""
    rng = np.random.default_rng(3)
    sums = AmplitudeSums if held and family is FAMILY else None
    limits = iiwa.limits if held else replace(iiwa.limits, torque=1e6 * iiwa.limits.torque)
    start = None if sums is None else np.zeros(7)
    task = ExcitationTask(
        iiwa, family, name, limits=limits, start=start, further=sums, avoid_collisions=bool(held)
    )
    layout = task.layout()
    program = SeriesProgram(task, layout, 16.0, 0.0)
    x, way = 0.5 * rng.normal(size=(2, layout.size))
    multipliers = program.no_multipliers(x) + 100.0 * held
    value, gradient = program.evaluate(x, 4.0, multipliers)
    ends = [program.evaluate(x + step * way, 4.0, multipliers)[0] for step in (_STEP, -_STEP)]
    # The information matrix squares the condition number: differences of it are good to some 1e-4 of the gradient.
    room = 1e-4 * np.linalg.norm(gradient) * np.linalg.norm(way)
    assert gradient @ way == pytest.approx((ends[0] - ends[1]) / (2.0 * _STEP), abs=room)
    assert held or value == pytest.approx(program.value(x, 4.0))


def test_clearance_of_segments_against_coal(iiwa: Robot) -> None:
    """Distances of capsules and the table are the ones that the independent check finds."""
    from excite.robot.shapes.collision import collision_model

    layout = ExcitationTask(iiwa, FAMILY).layout()
    path = layout.curve(0.6 * np.random.default_rng(8).normal(size=layout.size)).evaluate(FAMILY.grid(8.0))
    geometry, data = collision_model(iiwa), iiwa.model.createData()
    state = geometry.createData()
    least = np.inf
    for q in path:
        pin.updateGeometryPlacements(iiwa.model, data, geometry, state, q)
        pairs = range(len(geometry.collisionPairs))
        least = min(least, *(pin.computeDistance(geometry, state, k).min_distance for k in pairs))
    bodies = NearBodies(iiwa, np.arange(7) + 1)
    near = bodies.find(path, bodies.kept + 10.0)[1]
    assert near.distance.min() == pytest.approx(least, abs=1e-5)
    apart = np.einsum("mi,mi->m", near.second - near.first, near.normal)
    assert np.allclose(apart, near.distance, atol=1e-6)


def test_closest_points_of_segments_against_a_grid() -> None:
    rng = np.random.default_rng(5)
    p0, p1, q0, q1 = rng.normal(size=(4, 40, 3))
    p1[0], q1[1] = p0[0], q0[1]
    q0[2], q1[2] = p0[2] + 1.0, p1[2] + 1.0
    one, two = closest_points(p0, p1, q0, q1)
    u = np.linspace(0.0, 1.0, 201)[:, None, None]
    first, second = p0 + u * (p1 - p0), q0 + u * (q1 - q0)
    grid = np.linalg.norm(first[:, None] - second[None], axis=3).min(axis=(0, 1))
    found = np.linalg.norm(one - two, axis=1)
    assert (found <= grid + 1e-9).all()
    assert np.allclose(found, grid, atol=0.02)


def test_motion_is_safe_by_the_independent_check_and_uses_its_limits(
    found: SearchResult, iiwa: Robot
) -> None:
    assert found.found
    for item in found.found:
        assert check_motion(iiwa, item.motion).safe
        ends = np.array([0.0, item.curve.length])
        assert np.allclose(item.curve.evaluate(ends, 1), 0.0, atol=1e-9)
        assert np.allclose(item.curve.evaluate(ends, 2), 0.0, atol=1e-9)
        speed = np.abs(item.motion.v).max(axis=0) / iiwa.limits.velocity
        assert speed.max() > 0.95


def test_value_is_the_condition_number_of_the_motion(found: SearchResult, iiwa: Robot) -> None:
    """Recomputed from the samples by another route: one R factor, the structural base parameters."""
    from excite.excitation.conditioning import compute_conditioning

    report = compute_conditioning(iiwa, [motion_factor(iiwa, found.best.motion, 200.0)])
    assert found.best.value == pytest.approx(report.full, rel=0.02)


def test_optimised_beats_the_best_of_many_random_series(found: SearchResult, iiwa: Robot) -> None:
    rng = np.random.default_rng(6)
    task = ExcitationTask(iiwa, FAMILY)
    layout = task.layout()
    program = SeriesProgram(task, layout, 40.0, 0.0)
    values = []
    for _ in range(60):
        x = rng.normal(size=layout.size)
        x[: iiwa.n_joints] = rng.uniform(-0.3, 0.3, iiwa.n_joints)
        values.append(np.exp(program.value(layout.scaled(x, 1.0 / layout.shares(x)))))
    assert found.best.value < 0.6 * min(values)


def test_solver_keeps_linear_rows_and_reaches_a_known_minimum(iiwa: Robot) -> None:
    layout = ExcitationTask(iiwa, FAMILY).layout()
    rows = linear_rows(layout, FAMILY.grid(12.0))
    target = 3.0 * np.random.default_rng(7).normal(size=layout.size)
    solution = solve_program(
        lambda x: (0.5 * float((x - target) @ (x - target)), x - target),
        rows,
        np.zeros(layout.size),
        iterations=60,
    )
    assert solution.feasible
    assert rows.excess(solution.x) <= 1e-6
    # Optimality: the gradient is a non-negative combination of the active rows.
    from scipy.optimize import nnls

    value = rows.matrix @ solution.x
    active = np.vstack([rows.matrix[value > rows.upper - 1e-5], -rows.matrix[value < rows.lower + 1e-5]])
    assert nnls(active.T, target - solution.x)[1] < 1e-3 * np.linalg.norm(target - solution.x)


def test_interrupt_keeps_the_best_so_far(iiwa: Robot) -> None:
    def interrupt(stage: str, done: int, total: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    result = optimise_excitation(
        ExcitationTask(iiwa, FAMILY), SearchSettings(starts=2, kicks=4), progress=interrupt
    )
    assert result.interrupted
    assert len(result.found) == 1
    assert check_motion(iiwa, result.best.motion).safe


def test_interrupt_inside_the_solver_reaches_the_caller(iiwa: Robot) -> None:
    layout = ExcitationTask(iiwa, FAMILY).layout()
    calls = []

    def objective(x: Array) -> tuple[float, Array]:
        calls.append(x)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return float(x @ x), 2.0 * x

    with pytest.raises(KeyboardInterrupt):
        solve_program(
            objective,
            linear_rows(layout, FAMILY.grid(8.0)),
            np.ones(layout.size),
            iterations=9,
        )


@pytest.mark.slow
def test_result_does_not_depend_on_the_number_of_processes(found: SearchResult, iiwa: Robot) -> None:
    other = optimise_excitation(
        ExcitationTask(iiwa, FAMILY), SearchSettings(starts=2, kicks=0, seed=1), jobs=2
    )
    for one, two in zip(found.found, other.found, strict=True):
        assert one.motion.q.tobytes() == two.motion.q.tobytes()
        assert one.value == two.value


def test_limits_without_room_are_one_clear_error(iiwa: Robot) -> None:
    velocity = iiwa.limits.velocity.copy()
    velocity[2] = 0.0
    with pytest.raises(NoSolutionError, match=r"joint3.*velocity"):
        optimise_excitation(ExcitationTask(iiwa, FAMILY, limits=replace(iiwa.limits, velocity=velocity)))
    start = np.zeros(7)
    start[1] = 3.0
    with pytest.raises(NoSolutionError, match=r"joint2.*starts at 3"):
        optimise_excitation(ExcitationTask(iiwa, FAMILY, start=start))


def test_bad_settings_are_named(iiwa: Robot) -> None:
    with pytest.raises(UnknownNameError, match="beauty"):
        ExcitationTask(iiwa, FAMILY, criterion="beauty")
    with pytest.raises(InputError, match="starts"):
        SearchSettings(starts=0)
    with pytest.raises(InputError, match="harmonics"):
        fourier_family(8.0, 2)


def test_a_robot_whose_base_is_free_is_refused(g1: Robot) -> None:
    with pytest.raises(InputError, match=r"arms with a motor in every joint.*another generator"):
        optimise_excitation(ExcitationTask(g1, FAMILY))
