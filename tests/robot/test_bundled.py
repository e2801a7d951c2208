"""Every bundled robot: it loads, weighs what it should, stands, and its numbers have sources."""

from __future__ import annotations

import pickle
import runpy

import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.spatial import ConvexHull

from excite.errors import RobotError, UnknownNameError
from excite.robot.catalogue import bundled_robots, data_folder, find_robot
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_model, collision_shapes
from excite.robot.shapes.shape import shape_points

MASSES = {
    "g1": 33.341,
    "g1_no_ft": 33.341,
    "g1_suspended": 33.341,
    "go2": 16.085,
    "hrp2like": 58.0,
    "human": 74.712,
    "iiwa14": 20.670,
    "jaco2": 4.766,
    "panda": 16.822,
    "so101": 0.485,
    "talos": 90.272,
    "ur10": 28.7,
}
"""Sums of the masses in the URDFs and tables [kg]; of arms without the link that is bolted down."""

JOINTS = {
    "g1": 29,
    "g1_no_ft": 29,
    "g1_suspended": 29,
    "go2": 12,
    "hrp2like": 30,
    "human": 36,
    "iiwa14": 7,
    "jaco2": 7,
    "panda": 7,
    "so101": 6,
    "talos": 30,
    "ur10": 6,
}


@pytest.fixture(scope="module", params=bundled_robots())
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


def test_the_promised_robots_are_there() -> None:
    assert set(bundled_robots()) >= set(MASSES)


def test_mass_and_joints(robot: Robot) -> None:
    assert robot.mass == pytest.approx(MASSES[robot.name], abs=1e-3)
    assert robot.n_joints == JOINTS[robot.name]
    assert robot.model.nv == robot.n_base_v + robot.n_joints
    assert len(robot.segments) == robot.model.njoints - 1


def test_pseudo_inertias_are_consistent(robot: Robot) -> None:
    for segment in robot.segments:
        inertia = robot.model.inertias[segment.joint]
        if inertia.mass == 0.0:
            assert segment.link in robot.description.model.acknowledged
            continue
        moments = np.linalg.eigvalsh(inertia.inertia)
        assert moments[0] > 0.0
        assert moments[0] + moments[1] >= moments[2] * (1.0 - 1e-6)


def test_rest_posture_is_inside_the_limits_and_free_of_collision(robot: Robot) -> None:
    q = robot.rest[robot.n_base_q :]
    assert (q >= robot.limits.position_lower).all() and (q <= robot.limits.position_upper).all()
    geometry = collision_model(robot)
    data, geometry_data = robot.model.createData(), geometry.createData()
    pin.computeDistances(robot.model, data, geometry, geometry_data, robot.rest)
    nearest = min(result.min_distance for result in geometry_data.distanceResults)
    assert nearest >= robot.description.collision.margin


def test_random_postures_do_collide(robot: Robot) -> None:
    """The geometry and the pairs are not empty of meaning: arms and legs can be driven into each other."""
    geometry = collision_model(robot)
    data, geometry_data = robot.model.createData(), geometry.createData()
    rng = np.random.default_rng(0)
    lower, upper = robot.limits.position_lower, robot.limits.position_upper
    hits = 0
    for _ in range(300):
        q = robot.rest.copy()
        q[robot.n_base_q :] = rng.uniform(lower, upper)
        hits += pin.computeCollisions(robot.model, data, geometry, geometry_data, q, True)
    assert hits < 300
    if robot.name != "iiwa14":  # the ranges of its table keep it clear of itself and the table's centre
        assert hits > 0


def test_statics_stay_within_torque_limits(robot: Robot) -> None:
    gravity = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), robot.rest)
    if robot.floating:  # legs carry the ground's force; arms and trunk hang on the base
        carriers = [robot.model.names[j] for foot in robot.feet for j in robot.model.supports[foot.joint]]
        held = [i for i, name in enumerate(robot.joint_names) if name not in carriers]
    else:
        held = list(range(robot.n_joints))
    assert (np.abs(gravity[robot.n_base_v :])[held] < robot.limits.torque[held]).all()


def test_standing_robot_is_balanced(robot: Robot) -> None:
    if not robot.feet:
        pytest.skip("bolted down, or hanging")
    data = robot.model.createData()
    centre = pin.centerOfMass(robot.model, data, robot.rest)
    corners = []
    for foot in robot.feet:
        pose = data.oMi[foot.joint]
        corners += [pose.act(corner) for corner in foot.sole]
        up = pose.rotation @ foot.placement.rotation[:, 2]
        np.testing.assert_allclose(up, [0.0, 0.0, 1.0], atol=1e-6)
    corners = np.array(corners)
    np.testing.assert_allclose(corners[:, 2], 0.0, atol=1e-6)
    sides = ConvexHull(corners[:, :2]).equations
    margins = -(sides[:, :2] @ centre[:2] + sides[:, 2])
    assert margins.min() > 0.05


def test_mirrored_links_have_about_the_same_mass(robot: Robot) -> None:
    if not robot.floating:
        pytest.skip("an arm has no mirror image")
    # All but the trunk of a robot on four feet.
    least = len(robot.segments) - 1 if len(robot.feet) == 4 else 24
    assert sum(segment.pair is not None for segment in robot.segments) >= least
    masses = robot.nominal_parameters[::10]
    for index, segment in enumerate(robot.segments):
        if segment.pair is not None:
            assert robot.segments[segment.pair].pair == index
            assert masses[segment.pair] == pytest.approx(masses[index], rel=0.01)


def test_wrench_sensors_measure_a_foot_each(robot: Robot) -> None:
    if robot.floating and not robot.measures_contacts:
        assert robot.description.sensors.joint_torque is not None
        assert robot.description.sensors.imu is not None
        return
    assert {sensor.foot for sensor in robot.sensors} == {foot.name for foot in robot.feet}
    for sensor in robot.sensors:
        if sensor.kind == "foot_ft":
            assert sensor.excludes == (sensor.joint - 1,)
        else:
            foot, data = robot.foot(sensor.foot), robot.model.createData()
            pin.forwardKinematics(robot.model, data, robot.rest)
            sole = data.oMi[foot.joint].act(foot.placement).translation
            np.testing.assert_allclose(sensor.placement.translation, sole, atol=0.02)


def test_every_block_with_numbers_has_a_source(robot: Robot) -> None:
    content = yaml.safe_load(robot.source.read_text(encoding="utf-8"))
    blocks = [content["model"], content["posture"], content["sensors"], content["collision"]]
    blocks += [*content["limits"].values(), *content.get("drives", {}).values(), *content.get("feet", [])]
    blocks += [content["controller"]["kp"], content["controller"]["kd"]]
    assert all(len(block["source"]) > 3 for block in blocks)


def test_pickling_and_hash(robot: Robot) -> None:
    again = pickle.loads(pickle.dumps(robot))  # noqa: S301 - our own bytes
    assert again.hash == robot.hash == load_robot(robot.name).hash
    np.testing.assert_array_equal(again.nominal_parameters, robot.nominal_parameters)
    assert collision_model(again) is collision_model(robot)
    assert len({load_robot(name).hash for name in ("ur10", "iiwa14", "panda")}) == 3


def test_unknown_robot_lists_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown robot 'hrp2'.*g1.*talos"):
        find_robot("hrp2")


def test_a_folder_is_the_robot_that_is_described_in_it(tmp_path) -> None:
    with pytest.raises(RobotError, match=r"is a folder without a robot\.yaml; name the URDF"):
        find_robot(tmp_path)
    (tmp_path / "robot.yaml").write_text("")
    assert find_robot(tmp_path) == tmp_path / "robot.yaml"


def test_bare_urdf_points_at_init_robot(tmp_path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text("<robot/>")
    with pytest.raises(RobotError, match=r"init-robot .*arm\.urdf"):
        load_robot(path)


def test_iiwa_file_is_what_its_script_writes() -> None:
    folder = data_folder("robots") / "iiwa14"
    script = runpy.run_path(str(folder / "make_urdf.py"))
    assert script["urdf"]() == (folder / "iiwa14.urdf").read_text(encoding="utf-8")
    for link in range(7):
        printed, kept = script["printed"](link), script["consistent"](script["MOMENTS"][link])
        assert np.abs(printed - kept).max() <= 2.0e-4  # two units of the tables' last decimal


def test_jaco2_file_is_what_its_script_writes() -> None:
    folder = data_folder("robots") / "jaco2"
    script = runpy.run_path(str(folder / "make_urdf.py"))
    assert script["urdf"]() == (folder / "jaco2.urdf").read_text(encoding="utf-8")


def test_jaco2_points_up_at_its_upright_posture() -> None:
    """Table 1 of its article: shoulder 0.2755 m, elbow 0.6855 m, wrist 0.9966 m high, 9.8 mm aside."""
    robot = load_robot("jaco2")
    script = runpy.run_path(str(data_folder("robots") / "jaco2" / "make_urdf.py"))
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, np.array(script["UPRIGHT"]))
    joints = [data.oMi[joint].translation for joint in (2, 4, 6)]
    np.testing.assert_allclose(joints, [[0, 0, 0.2755], [0, 0, 0.6855], [0, -0.0098, 0.9966]], atol=1e-9)
    centres = np.array([data.oMi[i].act(robot.model.inertias[i].lever) for i in range(1, 8)])
    assert (np.diff(centres[:, 2]) > 0.08).all()  # link by link, as high as it stands
    assert np.abs(centres[:, :2]).max() < 0.015


def test_hrp2like_files_are_what_their_script_writes() -> None:
    folder = data_folder("robots") / "hrp2like"
    script = runpy.run_path(str(folder / "make_urdf.py"))
    assert script["urdf"]() == (folder / "hrp2like.urdf").read_text(encoding="utf-8")
    written = (folder / "robot.yaml").read_text(encoding="utf-8")
    assert all(f"    - {shape}\n" in written for shape in script["shapes"]())


def test_hrp2like_is_arranged_as_published() -> None:
    """Jovic et al. 2016, section IV: 1.54 m, 58 kg, 31 segments, base at the trunk; numbers as in Table II."""
    robot = load_robot("hrp2like")
    numbers = {int(segment.name[:2]): segment for segment in robot.segments}
    assert sorted(numbers) == list(range(1, 32))
    assert numbers[1].joint == 1 and robot.base_link == "chest"
    parents = {number: robot.model.parents[numbers[number].joint] for number in numbers}
    chains = {2: 1, 3: 2, 4: 3, 10: 3, 16: 1, 17: 16, 18: 1, 25: 1} | {n: n - 1 for n in (5, 9, 15, 24, 31)}
    assert all(parents[number] == numbers[parent].joint for number, parent in chains.items())
    for right in (*range(4, 10), *range(18, 25)):
        left = right + (6 if right < 10 else 7)
        assert robot.segments[numbers[right].pair] is numbers[left]
    straight = robot.rest.copy()
    straight[3:] = np.r_[0.0, 0.0, 0.0, 1.0, np.zeros(30)]
    shapes = [s for s in collision_shapes(robot) if s.link in ("head_pitch_link", "lleg_ankle_roll_link")]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, straight)
    heights = [data.oMi[shape.joint].act(point)[2] for shape in shapes for point in shape_points(shape)]
    assert max(heights) - min(heights) == pytest.approx(1.54, abs=0.005)


def test_iiwa_stands_upright_at_zero() -> None:
    """Table 2: elbow 0.42 m and wrist 0.82 m above the shoulder; link 7 of [37] weighs 0.3543 kg."""
    robot = load_robot("iiwa14")
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, np.zeros(7))
    heights = [data.oMi[joint].translation for joint in (2, 4, 6)]
    np.testing.assert_allclose(heights, [[0, 0, 0], [0, 0, 0.42], [0, 0, 0.82]], atol=1e-9)
    assert robot.nominal_parameters[60] == 0.3543
    np.testing.assert_allclose(robot.nominal_parameters[61:64], 0.3543 * np.array([-0.0347, -0.0232, 0.0714]))
