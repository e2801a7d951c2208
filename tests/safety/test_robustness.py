"""Margins over a set of inertial parameters, against pinocchio at the corners of the set."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

import excite
from excite.campaign.candidates import candidates_of
from excite.campaign.optimised_series import Asked
from excite.errors import RobotError
from excite.motion.motion import Motion
from excite.robot.description import PayloadBlock, UncertaintyBlock
from excite.robot.loading import load_robot, portable_description
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.checks.joints import drive_torques
from excite.safety.checks.robustness import judge_robustness
from excite.safety.checks.sweep import Sweep
from excite.safety.filter import filter_candidates
from excite.safety.ground_forces import cone_facets, friction_edges, shares_of_wrench
from excite.safety.parameter_set import Ellipsoid, Load, ParameterSet, parameter_set, stated_parameters
from tests.safety.motions import RATE_HZ, arm_motion, squat, standing_motion

MASS, COM, INERTIA = 0.1, 0.01, 0.2
# One link of which all is uncertain, one of which mass and two coordinates of the centre are: ten sides, 1024 corners.
SIDES = 10


def some_bodies(model: pin.Model, whole: int, part: int) -> ParameterSet:
    """The set in which joint ``whole`` carries what is uncertain in all, ``part`` in mass and centre along x and y."""
    every = parameter_set(model, mass=MASS, com=COM, inertia=INERTIA)
    bodies = np.zeros_like(every.bodies)
    bodies[whole - 1] = every.bodies[whole - 1]
    bodies[part - 1, :, :3] = every.bodies[part - 1, :, :3]
    return replace(every, bodies=bodies)


def corners(model: pin.Model, whole: int, part: int) -> list[pin.Model]:
    """Models at the 1024 corners of that set, bodies as pinocchio writes them."""
    found = []
    for signs in itertools.product((-1.0, 1.0), repeat=SIDES):
        changed = model.copy()
        changed.inertias[whole] = perturbed(
            model.inertias[whole], signs[0], np.array(signs[1:4]), np.array(signs[4:7])
        )
        changed.inertias[part] = perturbed(
            model.inertias[part], signs[7], np.array([signs[8], signs[9], 0.0]), np.zeros(3)
        )
        found.append(changed)
    assert len(found) == 1024
    return found


def perturbed(body: pin.Inertia, mass: float, centre: np.ndarray, moments: np.ndarray) -> pin.Inertia:
    """A body with other mass, centre, and moments about the principal axes through its old centre."""
    m, d = body.mass * (1.0 + MASS * mass), COM * centre
    values, axes = np.linalg.eigh(body.inertia)
    about_old = axes @ np.diag(values * (1.0 + INERTIA * moments)) @ axes.T
    return pin.Inertia(m, body.lever + d, about_old - m * ((d @ d) * np.eye(3) - np.outer(d, d)))


def parameters(body: pin.Inertia, signs: np.ndarray) -> np.ndarray:
    """The ten parameters of such a body, also of one that cannot exist: centres of light links are as uncertain."""
    m, c, d = body.mass * (1.0 + MASS * signs[0]), body.lever, COM * signs[1:4]
    values, axes = np.linalg.eigh(body.inertia)
    inertia = axes @ np.diag(values * (1.0 + INERTIA * signs[4:])) @ axes.T
    for point, sign in ((c + d, m), (d, -m)):
        inertia = inertia + sign * ((point @ point) * np.eye(3) - np.outer(point, point))
    order = ([0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2])
    return np.concatenate([[m], m * (c + d), inertia[order]])


def forces(model: pin.Model, motion: Motion, samples: np.ndarray) -> np.ndarray:
    data = model.createData()
    return np.array([pin.rnea(model, data, motion.q[k], motion.v[k], motion.a[k]).copy() for k in samples])


def to_world(motion: Motion, samples: np.ndarray) -> np.ndarray:
    """What takes wrenches at the base to the world's origin, ``(n, 6, 6)``."""
    return np.array([pin.XYZQUATToSE3(motion.q[k, :7]).toActionMatrixInverse().T for k in samples])


def world_wrenches(model: pin.Model, motion: Motion, samples: np.ndarray) -> np.ndarray:
    """Contact wrenches about the world's origin, ``(n, 6)``."""
    return np.einsum("nij,nj->ni", to_world(motion, samples), forces(model, motion, samples)[:, :6])


@pytest.fixture(scope="module")
def short_squat(humanoid: Robot) -> Motion:
    """A quick and shallow squat."""
    return squat(humanoid, depth=0.01, sway=0.004, duration=0.6)


def test_torques_of_an_arm_are_those_of_the_worst_of_1024_corners(arm: Robot) -> None:
    sweep = Sweep(arm, arm_motion(arm, 0.6, 0.2))
    samples, limits = sweep.torque_samples, arm.limits.torque
    for whole, part in ((3, 6), (6, 2)):
        found = judge_robustness(sweep, some_bodies(arm.model, whole, part)).worst["joint_torque_nm"]
        assert found is not None
        drives = drive_torques(sweep) - forces(arm.model, sweep.fine, samples)
        brute = min(
            float((limits - np.abs(forces(model, sweep.fine, samples) + drives)).min())
            for model in corners(arm.model, whole, part)
        )
        assert found.value == pytest.approx(brute, abs=1e-9)


def test_margins_of_a_humanoid_are_those_of_the_worst_of_1024_corners(
    humanoid: Robot, short_squat: Motion
) -> None:
    sweep = Sweep(humanoid, short_squat)
    model, fine, samples = humanoid.model, sweep.fine, np.arange(sweep.fine.n_samples)
    whole, part = (
        model.getJointId("torso_joint" if model.existJointName("torso_joint") else "waist_pitch_joint"),
        1,
    )
    some = some_bodies(model, whole, part)
    sole = [np.concatenate([corner[k] for corner in sweep.sole_corners]) for k in samples]
    friction = np.repeat(
        [foot.friction for foot in humanoid.feet], [len(foot.sole) for foot in humanoid.feet]
    )
    centre = sole[0].mean(axis=0)
    facets = cone_facets(sole[0] - centre, friction)
    facets = facets[np.linalg.norm(facets[:, :2], axis=1) > 1e-6]
    facets = facets / np.linalg.norm(facets[:, :2], axis=1)[:, None]
    shares = shares_of_wrench(
        sweep.wrench[sweep.torque_samples],
        np.array(sole)[sweep.torque_samples],
        friction,
        [len(foot.sole) for foot in humanoid.feet],
    )
    edges = [ConvexHull(points[:, :2]).equations for points in sole]
    data, in_legs = model.createData(), []
    for k in sweep.torque_samples:
        pin.computeJointJacobians(model, data, fine.q[k])
        # A wrench about the world's origin does work on the velocity there: joint torques per wrench of all feet.
        of_feet = [
            pin.getJointJacobian(model, data, foot.joint, pin.ReferenceFrame.WORLD) for foot in humanoid.feet
        ]
        in_legs.append(
            sum(jacobian.T @ share for jacobian, share in zip(of_feet, shares[len(in_legs)], strict=True))
        )
    nominal = forces(model, fine, sweep.torque_samples)
    drives = drive_torques(sweep) - tree_torques(nominal, sweep.wrench[sweep.torque_samples], in_legs)
    torque, zmp, push = np.inf, np.inf, np.inf
    actions = to_world(fine, samples)
    for changed in corners(model, whole, part):
        tau = forces(changed, fine, samples)
        wrench = np.einsum("nij,nj->ni", actions, tau[:, :6])
        point = np.column_stack([-wrench[:, 4], wrench[:, 3]]) / wrench[:, 2:3]
        zmp = min(zmp, *(-(e[:, :2] @ p + e[:, 2]).max() for e, p in zip(edges, point, strict=True)))
        some_wrenches = wrench[sweep.torque_samples]
        about = some_wrenches.copy()
        about[:, 3:] -= np.cross(centre, about[:, :3])
        push = min(push, float((-(about @ facets.T) / about[:, 2:3]).min()))
        tau = tree_torques(tau[sweep.torque_samples], some_wrenches, in_legs) + drives
        torque = min(torque, float((humanoid.limits.torque - np.abs(tau)).min()))
    assert judge_robustness(sweep, some).worst["zmp_m"].value == pytest.approx(zmp, abs=1e-9)
    assert judge_robustness(sweep, some).worst["friction"].value == pytest.approx(push, abs=1e-9)
    assert judge_robustness(sweep, some).worst["joint_torque_nm"].value == pytest.approx(torque, abs=1e-9)


def tree_torques(tau: np.ndarray, wrench: np.ndarray, in_legs: list[np.ndarray]) -> np.ndarray:
    """Joint torques with the ground's forces in the legs, ``(n, n_joints)``."""
    return (tau - np.einsum("nij,nj->ni", np.array(in_legs), wrench))[:, 6:]


def test_feet_share_changes_as_they_share_the_whole(humanoid: Robot, short_squat: Motion) -> None:
    sweep = Sweep(humanoid, short_squat)
    at = sweep.torque_samples
    corners = np.concatenate([points[at] for points in sweep.sole_corners], axis=1)
    counts = [len(foot.sole) for foot in humanoid.feet]
    friction = np.repeat([foot.friction for foot in humanoid.feet], counts)
    shares = shares_of_wrench(sweep.wrench[at], corners, friction, counts)
    for i, foot in enumerate(sweep.contact_forces):
        force, points = foot.forces, sweep.sole_corners[i][at]
        wrench = np.hstack([force.sum(axis=1), np.cross(points, force).sum(axis=1)])
        assert np.allclose(np.einsum("nij,nj->ni", shares[:, i], sweep.wrench[at]), wrench, atol=1e-6)
    assert np.allclose(shares.sum(axis=1), np.eye(6), atol=0.1), "the feet's wrenches add up to the whole"


def test_over_one_foot_none_of_1000_corners_of_all_bodies_is_worse(humanoid: Robot) -> None:
    still = standing_motion(humanoid, np.tile([0.0, 0.1, 0.0], (9, 1)))
    other = humanoid.feet[1].name if humanoid.feet[0].name.startswith("left") else humanoid.feet[0].name
    motion = replace(still, contacts={**still.contacts, other: np.zeros(9, dtype=bool)})
    sweep = Sweep(humanoid, motion)
    every = parameter_set(humanoid.model, mass=MASS, com=COM, inertia=INERTIA)
    found = judge_robustness(sweep, every).worst["zmp_m"]
    assert found is not None
    rng, least = np.random.default_rng(5), np.inf
    stand = next(i for i, foot in enumerate(humanoid.feet) if foot.name != other)
    hull = ConvexHull(sweep.sole_corners[stand][0][:, :2]).equations
    at, data = 2, humanoid.model.createData()
    rows = pin.computeJointTorqueRegressor(
        humanoid.model, data, sweep.fine.q[at], sweep.fine.v[at], sweep.fine.a[at]
    )
    pose = pin.XYZQUATToSE3(sweep.fine.q[at, :7])
    for _ in range(1000):
        phi = [parameters(body, rng.choice([-1.0, 1.0], 7)) for body in list(humanoid.model.inertias)[1:]]
        wrench = (pose * pin.Force(rows[:6] @ np.concatenate(phi))).vector
        point = np.array([-wrench[4], wrench[3]]) / wrench[2]
        least = min(least, -float((hull[:, :2] @ point + hull[:, 2]).max()))
    assert found.value <= least
    # All bodies' centres to one side alone move the robot's by as much.
    assert found.value <= judge_robustness(sweep, parameter_set(humanoid.model)).worst["zmp_m"].value - COM


def test_margins_never_exceed_the_model_s_and_fall_as_the_set_grows(
    arm: Robot, humanoid: Robot, short_squat: Motion
) -> None:
    for robot, motion in ((arm, arm_motion(arm, 0.6, 0.2)), (humanoid, short_squat)):
        sweep, verdict = Sweep(robot, motion), check_motion(robot, motion)
        for name, nominal in (
            ("joint_torque_nm", verdict.margins.joint_torque_nm),
            ("zmp_m", verdict.margins.zmp_m),
            ("friction", None),
        ):
            before = judge_robustness(sweep, parameter_set(robot.model)).worst.get(name)
            if before is None:
                assert nominal is None
                continue
            if nominal is not None:
                assert before.value == pytest.approx(nominal, abs=1e-12), "nothing uncertain: the model's own"
            hand = Load(robot.model.njoints - 1, np.zeros(3), 1.0)
            for sizes in (
                {"mass": 0.05},
                {"mass": 0.1},
                {"mass": 0.1, "com": 0.01},
                {"mass": 0.1, "com": 0.01, "inertia": 0.2},
                {"mass": 0.1, "com": 0.01, "inertia": 0.2, "loads": [hand]},
                {"mass": 0.1, "com": 0.01, "inertia": 0.2, "loads": [replace(hand, mass=2.0)]},
            ):
                after = judge_robustness(sweep, parameter_set(robot.model, **sizes)).worst[name]
                assert after.value <= before.value, (robot.name, name, sizes)
                before = after
            assert before.value < judge_robustness(sweep, parameter_set(robot.model)).worst.get(name).value


def test_a_load_counts_where_it_hangs_and_where_it_does_not(arm: Robot) -> None:
    sweep = Sweep(arm, arm_motion(arm, 0.6, 0.2))
    joint, point, most = arm.model.njoints - 1, np.array([0.0, 0.02, 0.1]), 4.0
    found = judge_robustness(sweep, parameter_set(arm.model, loads=[Load(joint, point, most)])).worst[
        "joint_torque_nm"
    ]
    samples, limits, loaded = sweep.torque_samples, arm.limits.torque, arm.model.copy()
    loaded.inertias[joint] += pin.Inertia(most, point, np.zeros((3, 3)))
    bare = forces(arm.model, sweep.fine, samples)
    drives = drive_torques(sweep) - bare
    brute = min(
        float((limits - np.abs(tau + drives)).min()) for tau in (bare, forces(loaded, sweep.fine, samples))
    )
    assert found.value == pytest.approx(brute, abs=1e-9)


def test_an_ellipsoid_s_margins_are_the_formula_s(arm: Robot, humanoid: Robot, short_squat: Motion) -> None:
    rng = np.random.default_rng(2)
    for robot, motion in ((arm, arm_motion(arm, 0.6, 0.2)), (humanoid, short_squat)):
        sweep, n = Sweep(robot, motion), len(robot.nominal_parameters)
        root = rng.normal(size=(n, 5)) * 0.02 * np.abs(robot.nominal_parameters)[:, None]
        ellipsoid = Ellipsoid.of_covariance(robot.nominal_parameters, root @ root.T, 2.0)
        some = parameter_set(robot.model, ellipsoid=ellipsoid)
        zmp, torque = (
            judge_robustness(sweep, some).worst.get("zmp_m"),
            judge_robustness(sweep, some).worst["joint_torque_nm"],
        )
        if robot is arm:
            data, rises = robot.model.createData(), []
            for k in sweep.torque_samples:
                rows = pin.computeJointTorqueRegressor(
                    robot.model, data, sweep.fine.q[k], sweep.fine.v[k], sweep.fine.a[k]
                )
                rises.append(2.0 * np.linalg.norm(rows @ root, axis=1))
            brute = robot.limits.torque - np.abs(drive_torques(sweep)) - np.array(rises)
            assert torque.value == pytest.approx(brute.min(), abs=1e-9)
            continue
        # Of points on its edge none is worse, and the best of many comes near.
        at, values = int(np.argmin(np.abs(sweep.fine.time - zmp.time_s))), []
        hull = ConvexHull(np.concatenate([c[at] for c in sweep.sole_corners])[:, :2]).equations
        for u in rng.normal(size=(400, 5)):
            changed = robot.model.copy()
            phi = robot.nominal_parameters + 2.0 * root @ u / np.linalg.norm(u)
            for joint in range(1, changed.njoints):
                changed.inertias[joint] = pin.Inertia.FromDynamicParameters(phi[10 * joint - 10 : 10 * joint])
            wrench = world_wrenches(changed, sweep.fine, np.array([at]))[0]
            point = np.array([-wrench[4], wrench[3]]) / wrench[2]
            values.append(-float((hull[:, :2] @ point + hull[:, 2]).max()))
        nominal = judge_robustness(sweep, parameter_set(robot.model)).worst["zmp_m"].value
        assert zmp.value <= min(values) + 1e-12
        assert min(values) - zmp.value < 0.2 * (nominal - zmp.value)


def test_friction_left_is_the_push_that_a_linear_program_finds(humanoid: Robot, short_squat: Motion) -> None:
    """The least share of the vertical force by which a push at the feet's middle takes the wrench out of the cone."""
    sweep = Sweep(humanoid, short_squat)
    found = judge_robustness(sweep, parameter_set(humanoid.model)).worst["friction"]
    at = int(np.argmin(np.abs(sweep.fine.time - found.time_s)))
    corners = np.concatenate([points[at] for points in sweep.sole_corners])
    friction = np.repeat(
        [foot.friction for foot in humanoid.feet], [len(foot.sole) for foot in humanoid.feet]
    )
    edges = friction_edges(friction)
    about = corners - corners.mean(axis=0)
    rays = np.concatenate([edges, np.cross(about[:, None], edges)], axis=2).reshape(-1, 6)
    wrench = sweep.wrench[at].copy()
    wrench[3:] -= np.cross(corners.mean(axis=0), wrench[:3])
    least = np.inf
    for angle in np.linspace(0.0, 2.0 * np.pi, 73):
        push = np.array([np.cos(angle), np.sin(angle), 0.0, 0.0, 0.0, 0.0]) * wrench[2]
        solved = linprog(
            np.r_[np.zeros(len(rays)), -1.0],
            A_eq=np.column_stack([rays.T, -push]),
            b_eq=wrench,
            method="highs",
        )
        assert solved.status == 0
        least = min(least, -solved.fun)
    assert found.value <= least + 1e-6
    assert least < 1.01 * found.value


def test_the_verdict_says_so_and_decides_only_where_asked(humanoid: Robot, squatting: Motion) -> None:
    report = excite.check(humanoid, [squatting])
    (verdict,) = report.verdicts
    robust = verdict.robust
    assert verdict.safe
    assert not robust.decides
    assert robust.uncertainty.stated is False
    assert "± 10 % mass, ± 1 cm centre of mass, ± 20 % inertia of every body (assumed)" in report.summary()
    entry = report.to_json()["motions"][0]["robust"]
    assert entry["uncertainty"]["mass"] == 0.1
    for name in ("joint_torque_nm", "zmp_m", "friction"):
        assert entry[name] == robust.worst[name].value
    assert entry["zmp_m"] < verdict.margins.zmp_m
    unsure = uncertain(humanoid, mass=0.5, com=0.1)
    loose = check_motion(unsure, squatting, parameters=stated_parameters(unsure))
    assert loose.safe, "margins over a set decide only where somebody asks for it"
    assert not loose.robust.holds
    # The members that lean furthest are rehearsed where the set is stated.
    (fallen,) = excite.check(unsure, [squatting]).verdicts
    assert fallen.violations[0].kind == "fell_in_rehearsal" and fallen.rehearsal.robots[0] == "model"
    assert len(fallen.rehearsal.robots) > 1 and fallen.robust == loose.robust
    (strict,) = excite.check(unsure, [squatting], robust=True).verdicts
    assert not strict.safe
    assert strict.violations[0].kind == "robust_zmp"
    assert strict.violations[0].value == pytest.approx(loose.robust.zmp_m)
    assert "does not hold" in strict.robust.in_words()


def test_an_arm_has_no_feet_to_judge(arm: Robot, swinging: Motion) -> None:
    (verdict,) = excite.check(arm, [swinging], robust=True).verdicts
    assert verdict.safe
    assert set(verdict.robust.worst) == {"joint_torque_nm"}
    assert verdict.robust.to_json()["zmp_m"] is None
    assert (
        verdict.robust.joint_torque_nm
        == judge_robustness(Sweep(arm, swinging), stated_parameters(arm)).worst["joint_torque_nm"].value
    )
    assert Sweep(arm, swinging).motion.n_samples > RATE_HZ / 10


def uncertain(robot: Robot, **stated: object) -> Robot:
    """The robot with an uncertainty stated."""
    block = UncertaintyBlock(**stated)
    return replace(robot, description=robot.description.model_copy(update={"uncertainty": block}))


def test_a_filter_for_the_set_keeps_limits_that_others_break_with_a_load(arm: Robot) -> None:
    loaded = uncertain(arm, payload=PayloadBlock(link="tool0", mass=10.0, position=(0.0, 0.0, 0.1)))
    candidates = list(
        candidates_of("random_joint", Asked(loaded, 8), np.random.SeedSequence(0), 0).candidates
    )
    before = [o for o in filter_candidates(loaded, candidates).outcomes if o.motion is not None]
    every = stated_parameters(loaded)
    held = [check_motion(loaded, o.motion, parameters=every).robust.holds for o in before]
    assert not all(held), "made without the load in mind, some motions are too fast for it"
    after = [o for o in filter_candidates(loaded, candidates, robust=True).outcomes if o.motion is not None]
    assert {o.candidate for o in after} == {o.candidate for o in before}, "slower, none is lost"
    for outcome in after:
        assert outcome.verdict.robust.decides
        assert outcome.verdict.robust.holds
    assert sum(o.motion.duration for o in after) > sum(o.motion.duration for o in before)


def test_a_humanoid_s_rows_over_the_set_are_on_the_safe_side(humanoid: Robot) -> None:
    """Torque that a path's rows leave is never more than the exact worst case's, and not far from it."""
    candidate = candidates_of("random_joint", Asked(humanoid, 1), np.random.SeedSequence(3), 0).candidates
    (outcome,) = filter_candidates(humanoid, list(candidate), robust=True).outcomes
    assert outcome.rejection is None, outcome.rejection
    worst = outcome.verdict.robust
    assert worst.holds
    assert worst.zmp_m >= 0.015
    assert worst.joint_torque_nm < outcome.verdict.margins.joint_torque_nm


def test_an_identification_s_file_is_the_set(arm: Robot, tmp_path: Path) -> None:
    rng, n = np.random.default_rng(7), len(arm.nominal_parameters)
    root = rng.normal(size=(n, 3)) * 0.1 * np.abs(arm.nominal_parameters)[:, None]
    links = [segment.link for segment in arm.segments]
    covariance = root @ root.T
    np.savez(tmp_path / "u.npz", links=links, parameters=arm.nominal_parameters, covariance=covariance)
    text = portable_description(arm) + "uncertainty: {identified: u.npz, sigmas: 3.0}\n"
    (tmp_path / "robot.yaml").write_text(text)
    robot = load_robot(tmp_path / "robot.yaml")
    sweep = Sweep(robot, arm_motion(robot, 0.6, 0.2))
    ellipsoid = Ellipsoid(arm.nominal_parameters, 3.0 * root)
    expected = judge_robustness(sweep, parameter_set(robot.model, ellipsoid=ellipsoid)).worst[
        "joint_torque_nm"
    ]
    assert judge_robustness(sweep, stated_parameters(robot)).worst["joint_torque_nm"].value == pytest.approx(
        expected.value, abs=1e-9
    )
    np.savez(tmp_path / "u.npz", links=links[::-1], parameters=arm.nominal_parameters, covariance=covariance)
    with pytest.raises(RobotError, match="no uncertainty of this robot's links"):
        stated_parameters(load_robot(tmp_path / "robot.yaml"))
    np.savez(tmp_path / "u.npz", links=links, parameters=arm.nominal_parameters[1:], covariance=covariance)
    with pytest.raises(RobotError, match="holds no 60 parameters"):
        stated_parameters(load_robot(tmp_path / "robot.yaml"))


def test_what_is_uncertain_makes_no_other_robot_of_it(arm: Robot, tmp_path: Path) -> None:
    text = portable_description(arm)
    for name, more in (("a", ""), ("b", "uncertainty: {mass: 0.2, payload: {link: tool0, mass: 2.0}}\n")):
        (tmp_path / f"{name}.yaml").write_text(text + more)
    assert load_robot(tmp_path / "a.yaml").hash == load_robot(tmp_path / "b.yaml").hash
    for link, said in (("world", "does not move"), ("hand", "no link 'hand'")):
        (tmp_path / "c.yaml").write_text(text + f"uncertainty: {{payload: {{link: {link}, mass: 1.0}}}}\n")
        with pytest.raises(RobotError, match=said):
            load_robot(tmp_path / "c.yaml")
