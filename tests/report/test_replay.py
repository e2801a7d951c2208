"""What a page's replay holds is the motion: poses, balance, nearest bodies and margins, by pinocchio and the check."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.motion.collection import load_motions
from excite.motion.content import BASE_POSE
from excite.report.replay.scene import (
    CELLS,
    joint_tree,
    merge_corners,
    robot_scene,
    solid_triangles,
    trial_track,
    visible_bodies,
)
from excite.report.replay.tracks import (
    FRAMES_HZ,
    Tracks,
    motion_tracks,
    nearest_pairs,
    pack_table,
    packed_indices,
)
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_model, geometry_data
from excite.safety.check import check_motion
from excite.safety.checks.collision import Distances
from excite.safety.checks.sweep import Sweep
from tests.report.kinematics import poses
from tests.report.unpacked import unpack_table


@pytest.fixture(scope="module", params=["ur10", "g1"])
def watched(request) -> tuple[Robot, Tracks]:
    robot = load_robot(request.param)
    return robot, motion_tracks(robot, load_motions(request.param)[0])


def test_packed_numbers_are_those_that_were_packed():
    rng = np.random.default_rng(0)
    values = np.cumsum(rng.normal(size=(400, 3)), axis=0) * [1e-6, 1.0, 1e4]
    values[17, 1] = np.nan
    values = np.column_stack([values, np.full(400, 2.5)])
    again = unpack_table(json.loads(json.dumps(pack_table(values))))
    assert np.isnan(again[17, 1]) and np.isnan(again).sum() == 1
    error = np.nanmax(np.abs(again - values), axis=0)
    assert (error <= 0.51 * np.nanmax(values - np.nanmin(values, axis=0), axis=0) / 65534).all()
    numbers = rng.integers(0, 65535, (50, 2))
    np.testing.assert_array_equal(unpack_table(packed_indices(numbers)), numbers)


def test_poses_of_all_links_are_pinocchios(watched):
    robot, shown = watched
    page, tree = json.loads(json.dumps(shown.to_json())), json.loads(json.dumps(robot_scene(robot)))
    q, time = unpack_table(page["q"]), unpack_table(page["time"])[:, 0]
    motion = load_motions(robot.name)[0].resampled(robot, FRAMES_HZ)
    np.testing.assert_allclose(time, motion.time - motion.time[0], atol=1e-3)
    data = robot.model.createData()
    for row in range(0, len(q), 29):
        pin.forwardKinematics(robot.model, data, motion.q[row])
        for ours, theirs in zip(poses(tree, q[row]), data.oMi, strict=True):
            np.testing.assert_allclose(ours, theirs.homogeneous, atol=5e-4)


def test_joints_that_slide_or_lie_askew_are_pinocchios_too():
    pin.seed(5)
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Random(), "root")
    for kind in (
        pin.JointModelRevoluteUnaligned(np.array([1.0, 2.0, -3.0]) / np.sqrt(14.0)),
        pin.JointModelPY(),
        pin.JointModelPrismaticUnaligned(np.array([3.0, 0.0, 4.0]) / 5.0),
        pin.JointModelRX(),
    ):
        joint = model.addJoint(joint, kind, pin.SE3.Random(), kind.shortname())
    tree, data, q = joint_tree(model), model.createData(), pin.neutral(model)
    q = pin.integrate(model, q, np.linspace(0.3, 1.2, model.nv))
    pin.forwardKinematics(model, data, q)
    for ours, theirs in zip(poses({"joints": tree}, q), data.oMi, strict=True):
        np.testing.assert_allclose(ours, theirs.homogeneous, atol=1e-5)


def test_margins_over_time_come_down_to_those_of_the_check(watched):
    robot, shown = watched
    verdict = check_motion(robot, load_motions(robot.name)[0]).margins
    for margin in shown.margins:
        least, checked = float(np.nanmin(margin.values)), getattr(verdict, margin.name)
        room = float(np.nanmax(margin.values)) - least
        # The check looks between the frames too: it finds no more, and little less.
        assert checked - 1e-6 <= least <= checked + 0.1 * room + 2e-3, margin.name
    assert {m.name for m in shown.margins} >= {"joint_torque_nm", "self_collision_m"}
    assert ("zmp_m" in {m.name for m in shown.margins}) is bool(robot.feet)


def test_the_line_between_the_nearest_bodies_is_as_long_as_they_are_apart(watched):
    robot, shown = watched
    (margin,) = (m for m in shown.margins if m.name == "self_collision_m")
    data = robot.model.createData()
    for row in range(0, shown.motion.n_samples, 30):
        pin.forwardKinematics(robot.model, data, shown.motion.q[row])
        ends = [
            data.oMi[int(joint)].act(point)
            for joint, point in zip(
                shown.nearest.joints[row], shown.nearest.points[row].reshape(2, 3), strict=True
            )
        ]
        assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(margin.values[row], abs=1e-5)


def test_the_centre_of_mass_is_pinocchios(watched):
    robot, shown = watched
    com = unpack_table(shown.to_json()["com"])
    for row in (0, len(com) // 2, len(com) - 1):
        expected = pin.centerOfMass(robot.model, robot.model.createData(), shown.motion.q[row])
        np.testing.assert_allclose(com[row], expected, atol=1e-4)


def test_fewer_triangles_are_the_same_body():
    corners, triangles = solid_triangles("sphere", (0.5,))
    for _ in range(4):  # Finer and finer.
        middles = (corners[triangles] + corners[np.roll(triangles, -1, axis=1)]) / 2.0
        n = len(corners) + np.arange(3 * len(triangles)).reshape(-1, 3)
        corners = np.vstack([corners, middles.reshape(-1, 3)])
        a, b, c = triangles.T
        triangles = np.vstack(
            [
                np.column_stack(t)
                for t in ((a, n[:, 0], n[:, 2]), (n[:, 0], b, n[:, 1]), (n[:, 2], n[:, 1], c), n.T)
            ]
        )
    fewer, left = merge_corners(corners, triangles)
    assert len(left) < 0.5 * len(triangles) and left.max() < len(fewer)
    assert np.abs(np.ptp(fewer, axis=0) - np.ptp(corners, axis=0)).max() < 2.0 / CELLS
    assert _volume(fewer, left) == pytest.approx(_volume(corners, triangles), rel=0.05)


@pytest.mark.parametrize(
    ("kind", "size", "volume"),
    [
        ("box", (1.0, 2.0, 3.0), 6.0),
        ("cylinder", (0.5, 2.0), np.pi / 2),
        ("sphere", (0.5,), np.pi / 6),
        ("capsule", (0.5, 2.0), np.pi / 6 + np.pi / 2),
    ],
)
def test_solids_are_closed_and_face_outwards(kind, size, volume):
    corners, triangles = solid_triangles(kind, size)
    assert _volume(corners, triangles) == pytest.approx(volume, rel=0.15)
    edges = [(t[i], t[(i + 1) % 3]) for t in triangles.tolist() for i in range(3)]
    assert len(set(edges)) == len(edges) and {(b, a) for a, b in edges} == set(edges)
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0.0).all()


def _volume(corners, triangles) -> float:
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def test_a_robot_without_geometry_has_rods(ur10_bones):
    found = visible_bodies(ur10_bones)
    assert {body.joint for body in found} >= {2, 3}
    assert max(float(np.abs(body.corners).max()) for body in found) < 1.0


@pytest.fixture
def ur10_bones() -> Robot:
    robot = load_robot("ur10")
    # Another hash, so that its shapes are not those that are kept.
    urdf = robot.urdf.replace(".stl", ".gone").replace(".dae", ".gone")
    return replace(robot, urdf=urdf, hash="without meshes")


def test_a_trial_has_its_robot_and_its_ghost(g1):
    time = np.linspace(3.0, 5.0, 500)
    joints = g1.joint_names[3:7]
    measured = np.sin(time[:, None] * [1.0, 2.0, 3.0, 4.0]) * 0.1
    base = np.tile([0.0, 0, 0.8, 0, 0, 0, 1.0], (500, 1))
    base[:, 0] = time
    page = trial_track(g1, "one", time, measured, joints, base=base, ghost=("told", measured + 0.1))
    shown = unpack_table(page["time"])[:, 0]
    q, ghost = unpack_table(page["q"]), unpack_table(page["ghost"]["q"])
    assert q.shape == (61, g1.model.nq)
    np.testing.assert_allclose(
        q[:, 10:14], np.column_stack([np.interp(shown + 3, time, c) for c in measured.T]), atol=1e-5
    )
    np.testing.assert_allclose(ghost[:, 10:14] - q[:, 10:14], 0.1, atol=1e-5)
    np.testing.assert_allclose(q[:, 0], shown + 3.0, atol=5e-3)
    np.testing.assert_allclose(q[:, 14:], np.tile(g1.rest[14:], (61, 1)), atol=1e-9)


def test_a_ghost_has_a_base_of_its_own_where_that_was_simulated():
    g1 = load_robot("g1")
    names = (*BASE_POSE, *g1.joint_names[:2])
    time = np.arange(100) / 100.0
    measured = np.tile([0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0, 0.1, 0.2], (100, 1))
    half = 0.5 * 0.3 * time
    fallen = measured.copy()
    fallen[:, 2] -= 0.5 * time
    fallen[:, 4], fallen[:, 6] = np.sin(half), np.cos(half)
    page = trial_track(g1, "one", time, measured, names, ghost=("simulated", fallen))
    q, ghost = unpack_table(page["q"]), unpack_table(page["ghost"]["q"])
    shown = unpack_table(page["time"])[:, 0]
    np.testing.assert_allclose(q[:, :9], np.tile(measured[0], (len(q), 1)), atol=1e-6)
    np.testing.assert_allclose(ghost[:, 2], 0.8 - 0.5 * shown, atol=6e-3)
    np.testing.assert_allclose(2.0 * np.arcsin(ghost[:, 4]), 0.3 * shown, atol=4e-3)


@pytest.mark.parametrize("name", ["ur10", "g1", "go2"])
def test_the_nearest_pair_is_the_one_of_all_distances_and_few_are_computed(name, monkeypatch):
    robot, asked, compute = load_robot(name), [], pin.computeDistance
    motion = load_motions(name)[0].resampled(robot, FRAMES_HZ)
    sweep, geometry = Sweep(robot, motion, 1.0), collision_model(robot)
    times = sweep.fine.time[::3]
    data, theirs = robot.model.createData(), geometry_data(geometry)
    monkeypatch.setattr(pin, "computeDistance", lambda *given: asked.append(given) or compute(*given))
    for k, (pair, least) in enumerate(nearest_pairs(Distances(sweep), times)):
        pin.updateGeometryPlacements(robot.model, data, geometry, theirs, sweep.fine.q[3 * k])
        all_pairs = int(pin.computeDistances(geometry, theirs))
        assert least == pytest.approx(theirs.distanceResults[all_pairs].min_distance, abs=1e-6)
        assert theirs.distanceResults[pair].min_distance == pytest.approx(least, abs=1e-6)
    # Of 505 pairs of G1 balls leave some thirty, and where they were a moment ago fewer.
    assert len(asked) < 40 * len(times)
