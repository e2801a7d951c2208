"""Repairs: each against independent truth, and the paths and laws that they hand on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.motion.generators.curves import SplineCurve
from excite.motion.generators.registry import make_generator
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.checks.sweep import Sweep
from excite.safety.filter import REPAIRS, make_repairs
from excite.safety.repairs.collisions import CollisionProbe
from excite.safety.repairs.draft import Draft, Rejection, Repair
from excite.safety.repairs.rows import PathLimits, Shares, support_of, zmp_rows
from excite.safety.repairs.sampling import plan_transfer
from excite.safety.repairs.time_scaling import largest_factor
from tests.safety.soles import foot_displacements


@pytest.fixture(scope="module")
def repairs(g1: Robot) -> list[Repair]:
    return make_repairs(g1)


@pytest.fixture(scope="module", params=["random_joint", "leg_swing", "squat"])
def drafts(request: pytest.FixtureRequest, g1: Robot, repairs: list[Repair]) -> list[Draft]:
    """A candidate's draft after each repair."""
    candidate = make_generator(request.param).candidates(g1, 1, np.random.SeedSequence(4))[0]
    found: list[Draft] = [Draft(candidate)]
    for repair in repairs:
        outcome = repair.repair(found[-1])
        assert isinstance(outcome, Draft), outcome
        found.append(outcome)
    return found


def test_registry_and_order(g1: Robot, repairs: list[Repair]) -> None:
    assert [repair.name for repair in repairs] == list(REPAIRS)


def test_path_derivatives_are_pinocchios(drafts: list[Draft], g1: Robot) -> None:
    path = drafts[-1].path
    assert path is not None
    h = 1e-5
    s = np.linspace(0.4, path.s[-1] - 0.4, 9) + 0.01
    here, before, after = path.sample(s), path.sample(s - h), path.sample(s + h)
    for i in range(len(s)):
        step = pin.difference(g1.model, before.q[i], after.q[i]) / (2 * h)
        assert np.allclose(here.twist[i], step, atol=1e-6)
    assert np.allclose(here.curvature, (after.twist - before.twist) / (2 * h), atol=1e-4)


def test_feet_and_centre_of_mass_stay(drafts: list[Draft], g1: Robot) -> None:
    path, candidate = drafts[-1].path, drafts[-1].candidate
    assert path is not None
    s = np.linspace(0.0, candidate.length, 301)
    q = path.sample(s).q
    moved = foot_displacements(g1, q)
    for foot in g1.feet:
        assert moved[foot.name][candidate.supports(s, foot.name)].max() < 1e-4
    data = g1.model.createData()
    asked = pin.centerOfMass(g1.model, data, g1.rest)[:2].copy()
    asked = asked + (0.0 if candidate.com is None else candidate.com.evaluate(s))
    com = np.array([pin.centerOfMass(g1.model, data, row)[:2] for row in q])
    assert np.abs(com - asked).max() < 1e-4
    assert np.allclose(q[[0, -1]], g1.rest, atol=1e-6)


def test_rows_are_inverse_dynamics(drafts: list[Draft], g1: Robot) -> None:
    """Acceleration and upper-body torque rows at a speed against a = Δv and RNEA."""
    path, limits = drafts[-1].path, drafts[-1].limits
    assert path is not None and limits is not None
    k = len(path.s) // 2
    rows = limits.rows(path.knots)
    rate, slope = 2.3, -1.7
    value = rows.static[k] + rows.curved[k] * rate**2 + rows.driven[k] * slope
    sample = path.knots
    a = sample.curvature[k] * rate**2 + sample.twist[k] * slope
    shares = Shares()
    tau = pin.rnea(g1.model, g1.model.createData(), sample.q[k], sample.twist[k] * rate, a)
    tau[6:] += 0.01 * a[6:]
    for joint in (12, 20, 28):
        label = ("joint_acceleration", g1.joint_names[joint])
        column = rows.labels.index(label)
        assert value[column] == pytest.approx(
            a[6 + joint] / (shares.acceleration * g1.limits.acceleration[joint]) - 1.0
        )
        column = rows.labels.index(("joint_torque", g1.joint_names[joint]))
        friction = 0.2 * shares.velocity * g1.limits.velocity[joint]
        limit = shares.torque * g1.limits.torque[joint] - friction
        assert value[column] == pytest.approx(tau[6 + joint] / limit - 1.0, abs=1e-9)


def test_law_keeps_rows_and_velocity(drafts: list[Draft], g1: Robot) -> None:
    law, limits, motion = drafts[-1].law, drafts[-1].limits, drafts[-1].motion
    assert law is not None and limits is not None and motion is not None
    assert largest_factor(limits, law, 400.0).factor >= 1.0 - 2e-3
    shares = Shares()
    assert (np.abs(motion.joint_velocities()) <= shares.velocity * g1.limits.velocity * (1 + 1e-6)).all()
    assert (np.abs(motion.joint_accelerations()) <= g1.limits.acceleration).all()
    jerk = np.diff(motion.joint_accelerations(), axis=0) * 200.0
    assert (np.abs(jerk) <= 1.05 * g1.limits.jerk).all()


def test_motion_is_its_own_derivative(drafts: list[Draft], g1: Robot) -> None:
    motion = drafts[-1].motion
    assert motion is not None
    h = np.diff(motion.time)[:, None]
    assert np.allclose(h, 1.0 / g1.description.sensors.rate_hz)
    step = np.array(
        [pin.difference(g1.model, a, b) for a, b in zip(motion.q[:-1], motion.q[1:], strict=True)]
    )
    mean = 0.5 * (motion.v[1:] + motion.v[:-1]) - h * np.diff(motion.a, axis=0) / 12.0
    assert np.abs(step / h - mean).max() < 1e-3
    assert np.abs(np.diff(motion.v, axis=0) / h - 0.5 * (motion.a[1:] + motion.a[:-1])).max() < 0.3
    assert np.allclose(motion.v[[0, -1]], 0.0, atol=1e-9)
    assert np.allclose(motion.a[[0, -1]], 0.0, atol=1e-2)
    assert np.allclose(motion.q[[0, -1]], g1.rest, atol=1e-6)


def test_scaling_is_quadratic(drafts: list[Draft]) -> None:
    """Twice as fast has half the room: the closed form scales as it must."""
    law, limits = drafts[-1].law, drafts[-1].limits
    assert law is not None and limits is not None
    one, two = largest_factor(limits, law, 400.0), largest_factor(limits, law.faster(2.0), 800.0)
    assert two.factor == pytest.approx(0.5 * one.factor, rel=1e-3)


def test_talos_swings_its_legs_though_its_hips_are_12_mm_apart() -> None:
    """Where the lean brings the thighs together it is reduced, and the rest of the motion stays."""
    talos = load_robot("talos")
    waypoints, whole_body = make_repairs(talos)[:2]
    candidates = make_generator("leg_swing").candidates(talos, 12, np.random.SeedSequence(4))[::2]
    probe, leaned = CollisionProbe(talos), []
    for candidate in candidates:
        draft = waypoints.repair(Draft(candidate))
        assert isinstance(draft, Draft)
        outcome = whole_body.repair(draft)
        if isinstance(outcome, Draft):
            assert outcome.path is not None
            assert probe.first(outcome.path.sample(np.linspace(0.0, outcome.path.s[-1], 50)).q) is None
            pelvis = outcome.candidate.pelvis
            assert pelvis is not None and candidate.pelvis is not None
            leaned.append(pelvis.control[6, 1] / candidate.pelvis.control[6, 1])
    assert len(leaned) >= 5
    assert min(leaned) >= 0.4 and max(leaned) == 1.0


def test_broad_feet_let_the_free_leg_swing_fast() -> None:
    """The edge that faces the free foot may be approached to 2 cm, the others to no less than before."""
    robot = load_robot("hrp2like")
    candidate = make_generator("leg_swing").candidates(robot, 1, np.random.SeedSequence(3))[0]
    motions = []
    for inwards in (1.0, Shares().zmp_inwards):
        draft: Draft | Rejection = Draft(candidate)
        for repair in make_repairs(robot, replace(Shares(), zmp_inwards=inwards)):
            assert isinstance(draft, Draft)
            draft = repair.repair(draft)
        assert isinstance(draft, Draft) and draft.motion is not None
        motions.append(draft.motion)
    slow, fast = motions
    assert fast.duration < 0.7 * slow.duration
    (stance,) = (foot for foot in robot.feet if fast.contacts[foot.name].all())
    (free,) = (foot for foot in robot.feet if foot is not stance)
    alone = ~fast.contacts[free.name]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.rest)
    edges = [data.oMi[stance.joint].act(corner)[1] for corner in stance.sole]
    towards = np.sign(data.oMi[free.joint].translation[1] - data.oMi[stance.joint].translation[1])
    sweep = Sweep(robot, fast, 1.0)
    lateral = towards * sweep.zmp[np.interp(sweep.fine.time, fast.time, alone) == 1.0, 1]
    inner, outer = max(towards * edge for edge in edges), min(towards * edge for edge in edges)
    assert inner - lateral.max() > 0.018
    assert lateral.min() - outer > 0.044


def test_unreachable_feet_are_rejected(g1: Robot, repairs: list[Repair]) -> None:
    candidate = make_generator("squat").candidates(g1, 1, np.random.SeedSequence(1))[0]
    pelvis = candidate.pelvis.control.copy()
    pelvis[5:8, 0] = 2.0
    outcome = repairs[1].repair(Draft(replace(candidate, pelvis=SplineCurve(pelvis))))
    assert isinstance(outcome, Rejection)
    assert outcome.reason in {"unreachable", "joint_position"}


def test_repairs_without_their_input_reject(g1: Robot, repairs: list[Repair]) -> None:
    candidate = make_generator("squat").candidates(g1, 1, np.random.SeedSequence(1))[0]
    for repair in repairs[2:]:
        assert isinstance(repair.repair(Draft(candidate)), Rejection)


def test_zmp_rows_are_distances() -> None:
    sole = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.1, 0.0], [0.0, 0.1, 0.0]])
    support = support_of([sole], 0.7)
    assert support.inradius == pytest.approx(0.05)
    point = np.array([0.13, 0.03])
    wrench = np.array([0.0, 0.0, 1.0, point[1], -point[0], 0.0])
    rows = zmp_rows(wrench[None], support, 0.02)
    assert rows.max() == pytest.approx(10.0 * (0.02 - 0.03))


def test_transfer_is_straight_and_limited() -> None:
    robot = load_robot("panda")
    end = robot.rest + np.array([0.5, -0.2, 0.1, 0.3, -0.6, 0.2, 0.0])
    moved = plan_transfer(robot, robot.rest, end, 200.0)
    assert np.allclose(moved.q[[0, -1]], [robot.rest, end])
    assert np.allclose(moved.v[[0, -1]], 0.0, atol=1e-6)
    share = (moved.q - robot.rest) @ (end - robot.rest) / np.sum((end - robot.rest) ** 2)
    assert np.allclose(moved.q, robot.rest + share[:, None] * (end - robot.rest), atol=1e-6)
    assert (np.abs(moved.v) <= robot.limits.velocity).all()
    assert (np.abs(moved.a) <= robot.limits.acceleration).all()
    assert np.allclose(np.gradient(moved.q, 0.005, axis=0)[5:-5], moved.v[5:-5], atol=0.02)


def test_limits_say_where_the_path_is_static(g1: Robot, drafts: list[Draft]) -> None:
    path = drafts[-1].path
    assert path is not None
    limits = PathLimits(drafts[-1].candidate, path, Shares())
    assert (limits.rows(path.knots).static <= 0.0).all()
    assert (limits.speed_bound() > 0.0).all()
