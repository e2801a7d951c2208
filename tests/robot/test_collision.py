"""Collision shapes against the URDF's exact meshes, and the pairs that matter."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.spatial import ConvexHull

import excite
from excite.errors import RobotError
from excite.robot.catalogue import data_folder, example_robot_data
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.robot.shapes.collision import (
    TABLE,
    PairSearch,
    collision_model,
    collision_shapes,
    com_boxes,
    review_pairs,
    shape_pairs,
)
from excite.robot.shapes.mesh_files import read_meshes
from excite.robot.shapes.shape import shape_bounds, shape_points


def edited(name: str, folder: Path, **collision: object) -> Path:
    """A copy of a bundled arm's description with another collision block."""
    content = yaml.safe_load((data_folder("robots") / name / "robot.yaml").read_text())
    content["collision"].update(collision)
    if content["model"].get("package") is None:
        content["model"]["path"] = str(data_folder("robots") / name / content["model"]["path"])
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_hulls_are_never_farther_apart_than_the_meshes(ur10: Robot) -> None:
    """Distances from pinocchio's own reading of the URDF bound ours from above."""
    folder = example_robot_data()
    urdf = folder / ur10.description.model.path
    exact = pin.buildGeomFromUrdf(
        ur10.model, str(urdf), pin.GeometryType.COLLISION, package_dirs=[str(folder.parent.parent)]
    )
    ours = collision_model(ur10)
    names = [geometry.name for geometry in exact.geometryObjects]
    compared = []
    for pair in ours.collisionPairs:
        first, second = (ours.geometryObjects[i].name for i in (pair.first, pair.second))
        if first in names and second in names:
            exact.addCollisionPair(pin.CollisionPair(names.index(first), names.index(second)))
            compared.append((first, second))
    assert len(compared) > 5
    data, exact_data, our_data = ur10.model.createData(), exact.createData(), ours.createData()
    rng = np.random.default_rng(1)
    for _ in range(20):
        q = rng.uniform(ur10.limits.position_lower, ur10.limits.position_upper)
        pin.computeDistances(ur10.model, data, exact, exact_data, q)
        pin.computeDistances(ur10.model, data, ours, our_data, q)
        found = {
            (ours.geometryObjects[p.first].name, ours.geometryObjects[p.second].name): r.min_distance
            for p, r in zip(ours.collisionPairs, our_data.distanceResults, strict=True)
        }
        for pair, result in zip(compared, exact_data.distanceResults, strict=True):
            if result.min_distance > 0.0:
                assert found[pair] <= result.min_distance + 1e-6


@pytest.mark.parametrize("mesh", ["hip_y", "knee", "ankle_X"])
def test_shapes_of_talos_legs_hold_the_meshes_and_no_more(mesh: str) -> None:
    """Every corner of the mesh is inside; nothing sticks out of the mesh's exact hull by more than 1 mm."""
    link = {"hip_y": "leg_right_3_link", "knee": "leg_right_4_link", "ankle_X": "leg_right_6_link"}[mesh]
    path = example_robot_data() / f"talos_data/meshes/v2/{mesh}_collision.stl"
    points = read_meshes([path])[path]
    exact = ConvexHull(points * [1, -1, 1])
    (shape,) = (s for s in collision_shapes(load_robot("talos")) if s.link == link)
    planes = ConvexHull(shape.vertices).equations
    assert (exact.points @ planes[:, :3].T + planes[:, 3]).max() < 1e-6
    assert (shape.vertices @ exact.equations[:, :3].T + exact.equations[:, 3]).max() < 1e-3


def test_more_corners_bring_talos_thighs_apart(tmp_path: Path) -> None:
    """The exact meshes are 11.9 mm apart at rest; the margin of 5 mm leaves nothing to spend on coarse hulls."""

    def gap(**collision: object) -> float:
        robot = load_robot(edited("talos", tmp_path, **collision))
        geometry = collision_model(robot)
        names = [geometry.geometryObjects[k].name for k in range(len(geometry.geometryObjects))]
        pair = pin.CollisionPair(names.index("leg_left_3_link_0"), names.index("leg_right_3_link_0"))
        data, state = robot.model.createData(), geometry.createData()
        pin.updateGeometryPlacements(robot.model, data, geometry, state, robot.rest)
        return float(pin.computeDistance(geometry, state, geometry.findCollisionPair(pair)).min_distance)

    assert gap(hull_corners=96) < gap() - 0.002
    assert gap() == pytest.approx(0.0119, abs=2e-4)


def test_pairs_leave_out_neighbours_and_ignored_links(g1: Robot) -> None:
    ignored = {frozenset(pair) for pair in g1.description.collision.ignored_pairs}
    shapes = collision_shapes(g1)
    parents = list(g1.model.parents)
    pairs = [(shapes[p.first], shapes[p.second]) for p in collision_model(g1).collisionPairs]
    for one, other in pairs:
        assert one.joint != other.joint
        assert parents[one.joint] != other.joint and parents[other.joint] != one.joint
        assert frozenset((one.link, other.link)) not in ignored
    links = {frozenset((one.link, other.link)) for one, other in pairs}
    assert frozenset(("left_rubber_hand", "right_rubber_hand")) in links
    assert frozenset(("left_ankle_roll_link", "right_ankle_roll_link")) in links
    assert frozenset(("left_rubber_hand", "left_knee_link")) in links


def test_crossed_legs_are_found(g1: Robot) -> None:
    q = g1.rest.copy()
    for joint, angle in {"left_hip_roll_joint": -0.3, "right_hip_roll_joint": 0.3}.items():
        q[7 + g1.joint_index(joint)] = angle
    geometry = collision_model(g1)
    assert pin.computeCollisions(g1.model, g1.model.createData(), geometry, geometry.createData(), q, True)


def test_table_below_an_arm(ur10: Robot) -> None:
    table = next(shape for shape in collision_shapes(ur10) if shape.link == TABLE)
    assert table.joint == 0
    assert shape_points(table)[:, 2].max() == pytest.approx(0.0)
    geometry = collision_model(ur10)
    q = np.array([0.0, 0.6, 0.0, 0.0, 0.0, 0.0])  # the whole arm pitched down
    assert pin.computeCollisions(
        ur10.model, ur10.model.createData(), geometry, geometry.createData(), q, True
    )


def test_urdf_geometry_and_authored_shapes_add_up(tmp_path: Path) -> None:
    ball = {"link": "tool0", "kind": "sphere", "size": [0.05], "xyz": [0.0, 0.0, 0.1]}
    robot = load_robot(edited("ur10", tmp_path, shapes=[ball]))
    assert [shape.kind for shape in collision_shapes(robot) if shape.link == "tool0"] == ["sphere"]
    assert len(collision_shapes(robot)) == len(collision_shapes(load_robot("ur10"))) + 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"ignored_pairs": [["forearm", "base_link"]]},
            r"collision.ignored_pairs: no shape on link 'forearm'",
        ),
        ({"geometry": "authored"}, r"collision.geometry: no geometry of kind 'authored'"),
        (
            {"shapes": [{"link": "hand", "kind": "sphere", "size": [0.1]}]},
            r"collision.shapes: no link 'hand'",
        ),
        ({"shapes": [{"link": "tool0", "kind": "box", "size": [0.1]}]}, r"box on tool0 has 1 sizes; give 3"),
    ],
)
def test_bad_collision_block(change: dict[str, object], message: str, tmp_path: Path) -> None:
    robot = load_robot(edited("ur10", tmp_path, **{"ignored_pairs": [], **change}))
    with pytest.raises(RobotError, match=message):
        collision_model(robot)


def test_hulls_of_too_few_corners_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"hull_corners.*32.*got 8"):
        load_robot(edited("talos", tmp_path, hull_corners=8))


def test_missing_mesh_is_named(tmp_path: Path) -> None:
    urdf = example_robot_data() / "ur_description/urdf/ur10_joint_limited_robot.urdf"
    (tmp_path / "lost.urdf").write_text(urdf.read_text().replace("forearm.stl", "gone.stl"))
    content = yaml.safe_load((data_folder("robots") / "ur10/robot.yaml").read_text())
    content["model"] = {"path": "lost.urdf", "source": "test"}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(content))
    robot = load_robot(tmp_path)
    with pytest.raises(RobotError, match=r"\.stl: no such file"):
        collision_model(robot)


@pytest.mark.parametrize("name", ["g1", "panda", "iiwa14"])
def test_ignored_pairs_in_the_file_are_what_the_search_finds(name: str) -> None:
    robot = load_robot(name)
    found = review_pairs(robot, np.random.default_rng(0))
    assert set(found.ignored) == set(robot.description.collision.ignored_pairs)
    assert found.rest_collisions == ()


def test_pairs_that_never_meet_indeed_do_not(ur10: Robot) -> None:
    shapes = collision_shapes(ur10)
    never = set(review_pairs(ur10, np.random.default_rng(0)).never)
    assert never
    geometry = collision_model(ur10).copy()
    geometry.removeAllCollisionPairs()
    for first, second in shape_pairs(ur10, shapes):
        if (shapes[first].link, shapes[second].link) in never:
            geometry.addCollisionPair(pin.CollisionPair(first, second))
    data, geometry_data, rng = ur10.model.createData(), geometry.createData(), np.random.default_rng(7)
    for _ in range(300):
        q = rng.uniform(ur10.limits.position_lower, ur10.limits.position_upper)
        assert not pin.computeCollisions(ur10.model, data, geometry, geometry_data, q, True)


@pytest.mark.parametrize("name", ["g1", "human", "iiwa14"])
def test_com_boxes_hold_geometry_and_nominal_com(name: str) -> None:
    robot = load_robot(name)
    boxes = com_boxes(robot)
    assert boxes.shape == (len(robot.segments), 2, 3)
    parameters = robot.nominal_parameters.reshape(-1, 10)
    for box, segment, phi in zip(boxes, robot.segments, parameters, strict=True):
        assert (box[1] > box[0]).all() and (box[1] - box[0]).max() < 0.6
        if phi[0] > 0.0:
            assert (box[0] <= phi[1:4] / phi[0]).all() and (phi[1:4] / phi[0] <= box[1]).all()
        for shape in collision_shapes(robot):
            if shape.joint == segment.joint and shape.vertices is not None:
                points = shape_points(shape)
                assert (points > box[0]).all() and (points < box[1]).all()


def test_bounds_of_primitives_match_points_on_their_surface(tmp_path: Path) -> None:
    kinds = [("sphere", [0.1]), ("capsule", [0.05, 0.3]), ("box", [0.1, 0.2, 0.3])]
    shapes = [
        {"link": "tool0", "kind": kind, "size": size, "xyz": [0.1, 0.0, 0.2], "rpy": [0.3, 0.5, -0.7]}
        for kind, size in kinds
    ]
    directions = np.random.default_rng(0).normal(size=(40_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    signs = np.sign(directions)
    surfaces = {
        "sphere": 0.1 * directions,
        "capsule": 0.05 * directions + signs[:, 2:] * [0.0, 0.0, 0.15],
        "box": signs * [0.05, 0.1, 0.15],
    }
    found = [
        s for s in collision_shapes(load_robot(edited("ur10", tmp_path, shapes=shapes))) if s.link == "tool0"
    ]
    assert [shape.kind for shape in found] == [kind for kind, _ in kinds]
    for shape in found:
        points = surfaces[shape.kind] @ shape.placement.rotation.T + shape.placement.translation
        lower, upper = shape_bounds(shape)
        np.testing.assert_allclose(lower, points.min(axis=0), atol=2e-4)
        np.testing.assert_allclose(upper, points.max(axis=0), atol=2e-4)


def test_what_distances_are_does_not_depend_on_what_was_asked_before(g1: Robot) -> None:
    rng = np.random.default_rng(5)
    q = np.tile(g1.rest, (20, 1))
    q[:, 7:] = rng.uniform(g1.limits.position_lower, g1.limits.position_upper, (20, g1.n_joints))
    there, back = PairSearch(g1), PairSearch(g1)
    first = [there.link_distances(row) for row in q]
    second = [back.link_distances(row) for row in q[::-1]][::-1]
    np.testing.assert_array_equal(first, second)


def test_nobody_makes_data_of_geometry_that_remember() -> None:
    """Data that coal makes begin each search where the last one ended: only geometry_data takes that away."""
    sources = Path(excite.__file__).parent.rglob("*.py")
    made = [
        path.name for path in sources if re.search(r"geometry\.createData\(|GeometryData\(", path.read_text())
    ]
    assert made == ["collision.py"]
