"""The person's model: 34 joints, the same in pinocchio and in the room's own kinematics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.virtual_person import pose_of
from excite.errors import InputError
from excite.human.body import body_of, segment_box
from excite.human.markers.inverse_kinematics import MarkerModel, solve_poses
from excite.human.measure import robot_yaml, urdf_text
from excite.human.segments import (
    JOINT_NAMES,
    NAMES,
    SEGMENTS,
    Subject,
    base_pose,
    frame_turn,
    joint_angles,
    place_segments,
    point_jacobian,
)
from excite.robot.loading import load_robot

BODY = body_of(Subject(70.0, 1.82, "male"), table="dumas")


def postures(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    base = np.column_stack([rng.normal(size=(n, 3)), Rotation.random(n, random_state=seed).as_quat()])
    return base, rng.uniform(-1.2, 1.2, (n, 34))


def test_segments_and_joints_are_the_papers():
    kinds = [len(segment.axes) for segment in SEGMENTS]
    assert (len(SEGMENTS), kinds.count(3), kinds.count(1), sum(kinds)) == (15, 10, 4, 34)


def test_pinocchio_and_the_skeleton_agree(tmp_path):
    (tmp_path / "human.urdf").write_text(urdf_text(BODY))
    (tmp_path / "robot.yaml").write_text(robot_yaml(BODY, 200.0))
    robot = load_robot(tmp_path / "robot.yaml")
    assert robot.n_joints == 34 and robot.mass == pytest.approx(70.0)
    base, angles = postures(4)
    placed = place_segments(pose_of(base, angles), BODY.offsets)
    data = robot.model.createData()
    order = [7 + robot.joint_names.index(name) for name in JOINT_NAMES]
    for i in range(4):
        q = pin.neutral(robot.model)
        q[:7], q[order] = base[i], angles[i]
        pin.framesForwardKinematics(robot.model, data, q)
        for k, name in enumerate(NAMES):
            frame = data.oMf[robot.model.getFrameId(name)]
            assert frame.translation == pytest.approx(placed.origin[i, k], abs=1e-9)
            assert np.allclose(frame.rotation @ frame_turn(k), placed.rotation[i, k], atol=1e-9)
        center = pin.centerOfMass(robot.model, data, q)
        masses = np.array([b.mass for b in BODY.inertias])
        points = [placed.origin[i, k] + placed.rotation[i, k] @ b.lever for k, b in enumerate(BODY.inertias)]
        assert center == pytest.approx(masses @ np.array(points) / 70.0, abs=1e-9)


def test_angles_and_rotations_are_each_others_inverse():
    base, angles = postures(1, seed=3)
    pose = pose_of(base, angles)
    assert joint_angles(pose) == pytest.approx(angles, abs=1e-9)
    assert np.abs(base_pose(pose)) == pytest.approx(np.abs(base), abs=1e-9)


def test_jacobian_against_finite_differences():
    base, angles = postures(2, seed=1)
    pose = pose_of(base, angles)
    segment = np.array([2, 5, 14, 8])
    local = np.random.default_rng(0).normal(size=(4, 3)) * 0.1
    placed = place_segments(pose, BODY.offsets)
    exact = point_jacobian(placed, placed.locate_points(segment, local), segment)
    h = 1e-6
    for column in range(40):
        step = np.zeros((2, 40))
        step[:, column] = h
        ahead, behind = (
            place_segments(pose.take_step(sign * step), BODY.offsets).locate_points(segment, local)
            for sign in (1.0, -1.0)
        )
        assert exact[..., column] == pytest.approx((ahead - behind) / (2 * h), abs=1e-8)


@pytest.mark.parametrize(
    ("mass", "height", "sex", "says"),
    [(0.07, 1.8, "male", "kilograms"), (70, 182, "male", "centimetres"), (70, 1.8, "man", "male or female")],
)
def test_absurd_subjects_are_refused(mass, height, sex, says):
    with pytest.raises(InputError, match=says):
        Subject(mass, height, sex)


@pytest.mark.parametrize("robust", [False, True])
def test_no_step_from_the_posture_that_markers_ask_for_costs_less(robust):
    """Markers seen in part and a centimetre off, one of them far: the cost is flat there in all 40 directions."""
    rng = np.random.default_rng(2)
    base, angles = postures(3, seed=4)
    angles *= 0.5
    segment = np.arange(45) % 15
    model = MarkerModel(
        tuple(f"M{i}" for i in range(45)), segment, 0.1 * rng.normal(size=(45, 3)), BODY.offsets
    )
    true = pose_of(base, angles)
    points = model.predict_markers(true) + 0.01 * rng.normal(size=(3, 45, 3))
    points[0, :5], points[1, 7] = np.nan, points[1, 7] + 0.3
    found = solve_poses(model, points, true, steps=200, robust=robust).pose

    def cost(pose):
        return solve_poses(model, points, pose, steps=0, robust=robust).cost

    least, h = cost(found), 1e-3
    for column in range(40):
        ahead, behind = (cost(found.take_step(np.eye(40)[[column]] * sign * h)) for sign in (1.0, -1.0))
        slope, curvature = (ahead - behind) / (2.0 * h), (ahead + behind - 2.0 * least) / h**2
        # What Newton's step along it would gain is nothing against the cost.
        assert (curvature > 0.0).all() and (slope**2 / (2.0 * curvature) < 1e-4 * least).all(), column


@pytest.mark.parametrize("height", [1.55, 1.82])
def test_the_ankle_is_as_high_above_the_sole_as_in_winter(height: float) -> None:
    """3.9 % of stature (Winter 2009, figure 4.1), and the foot 15.2 % long."""
    body = body_of(Subject(70.0, height, "female"))
    foot = segment_box(body, NAMES.index("left_foot"))
    assert foot[0, 2] == pytest.approx(-0.039 * height)
    assert np.ptp(foot[:, 0]) == pytest.approx(0.152 * height)
