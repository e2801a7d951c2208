"""Links whose geometry is missing: boxes in their place, and verdicts that say so."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import excite
from excite.robot.catalogue import example_robot_data
from excite.robot.robot import Robot
from excite.robot.shapes.collision import TABLE, PairSearch, collision_shapes, watched_model
from excite.robot.shapes.stand_ins import links_without_shape
from excite.safety.repairs.collisions import CollisionProbe
from tests.robot.small import ARM
from tests.safety.motions import joint_motion, smooth

DENSITY = 1000.0  # of water, and about that of robots [kg/m³]
MESH = '<geometry><mesh filename="gone.stl"/></geometry>'
BASE = (
    '<link name="world"><inertial><origin xyz="0 0 0.05"/><mass value="8"/><inertia ixx="0.02" ixy="0" ixz="0" '
    f'iyy="0.02" iyz="0" izz="0.03"/></inertial><collision>{MESH}</collision></link>'
)


def without_meshes(tmp_path: Path, robot: str, urdf: str, *names: str) -> Path:
    """A copy of a robot of example-robot-data without the meshes in whose names one of these stands."""
    copy = tmp_path / robot
    shutil.copytree(example_robot_data() / robot, copy)
    file = copy / urdf
    text = file.read_text(encoding="utf-8").replace("package://example-robot-data/robots/", "../../")
    file.write_text(text, encoding="utf-8")
    for mesh in [one for one in copy.rglob("*") if one.suffix.lower() in {".stl", ".dae", ".obj"}]:
        if any(name in mesh.name for name in names):
            mesh.unlink()
    return file


def masses(robot: Robot) -> dict[str, float]:
    """Mass of each link as its URDF states it."""
    found = {}
    for link in ElementTree.fromstring(robot.urdf).findall("link"):
        mass = link.find("inertial/mass")
        found[link.get("name", "")] = 0.0 if mass is None else float(mass.get("value", "0"))
    return found


def own_shapes(robot: Robot) -> dict[str, list[tuple[float, ...]]]:
    """Sizes or corners of the shapes of each link."""
    found: dict[str, list[tuple[float, ...]]] = {}
    for shape in collision_shapes(robot):
        corners = () if shape.vertices is None else tuple(shape.vertices.ravel().tolist())
        found.setdefault(shape.link, []).append((*shape.size, *corners))
    return found


@pytest.fixture(scope="module")
def handless(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A G1 whose hands' meshes are not there."""
    folder = tmp_path_factory.mktemp("handless")
    urdf = "urdf/g1_29dof_with_hand_rev_1_0.urdf"
    return excite.load_robot(without_meshes(folder, "g1_description", urdf, "hand"))


@pytest.fixture(scope="module")
def complete() -> Robot:
    """The same with all its meshes."""
    return excite.load_robot(example_robot_data() / "g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf")


def test_only_links_whose_meshes_are_missing_get_boxes(handless: Robot, complete: Robot) -> None:
    whole = own_shapes(complete)
    found, stand_ins = own_shapes(handless), set(handless.description.collision.stand_ins)
    assert stand_ins and all("hand" in link for link in stand_ins)
    kept = set(whole) - stand_ins - {TABLE}
    assert len(kept) > 20
    assert {link: found[link] for link in kept} == {link: whole[link] for link in kept}
    assert handless.floating, "its feet are known"


def test_a_box_is_as_large_as_its_body(handless: Robot) -> None:
    weights = masses(handless)
    boxes = [shape for shape in handless.description.collision.shapes]
    assert {shape.link for shape in boxes} == set(handless.description.collision.stand_ins)
    for shape in boxes:
        assert np.prod(shape.size) >= weights[shape.link] / DENSITY


def test_a_fixed_root_gets_a_box_and_a_limb_does_not_pass_through_it(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.replace('<link name="world"/>', BASE).replace("-1.5", "-3.1").replace("1.5", "3.1"))
    robot = excite.load_robot(path)
    (box,) = robot.description.collision.shapes
    assert box.link == "world" and np.prod(box.size) >= 8.0 / DENSITY
    assert not robot.floating
    assert ("world", "lower") not in robot.description.collision.ignored_pairs
    # The forearm bent back beside the upper arm, and both bent down to the base.
    probe = CollisionProbe(robot)
    reached = [np.array([shoulder, 2.0]) for shoulder in np.linspace(0.0, 3.0, 31)]
    assert any(probe.collides(q) for q in reached)


def test_a_verdict_says_under_what_it_holds(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    text = ARM.replace('<origin xyz="0 0 0.1"', '<origin xyz="0 0 0"')
    path.write_text(text.replace('<geometry><box size="0.06 0.06 0.25"/></geometry>', MESH))
    robot = excite.load_robot(path)
    time = np.linspace(0.0, 4.0, 801)
    there_and_back = (smooth(time / 2.0) - smooth((time - 2.0) / 2.0))[:, None]
    motion = joint_motion(robot, time, robot.rest + there_and_back * [0.0, 0.2])
    report = excite.check(robot, [motion])
    assert report.safe
    said = "safe, as far as boxes stand for the missing geometry of lower"
    assert said in report.summary()
    assert report.to_json()["motions"][0]["as_far_as"] == [said.removeprefix("safe, as far as ")]
    settings = {"controller": "arm_controller"}
    goal = excite.export_motion(motion, robot, "ros2-yaml", tmp_path / "goal", settings=settings)
    assert f"found {said.replace('safe', 'safe by the independent check')};" in goal.read_text(
        encoding="utf-8"
    )
    stated = {"as_far_as": [said.removeprefix("safe, as far as ")]}
    assert json.dumps(stated).strip("{}") in goal.read_text(encoding="utf-8"), "a program reads it too"


def test_a_link_of_weight_without_shape_stands_in_the_verdict() -> None:
    go2 = excite.load_robot("go2")
    shaped = {shape.link for shape in collision_shapes(go2)}
    bare = links_without_shape(go2)
    # A rotor in its housing is where that is; hips without any shape are not.
    assert "FL_hip" in bare and "FL_hip" not in shaped
    assert "FL_calf_rotor" not in shaped and "FL_calf_rotor" not in bare
    assert not links_without_shape(excite.load_robot("ur10"))


def test_what_rests_near_each_other_does_not_pass_through(complete: Robot) -> None:
    """The upper arm of a G1 rests beside its trunk, nearer than the margin."""
    robot = complete
    near = {pair.links: pair.distance for pair in robot.description.collision.near_pairs}
    pair = ("torso_link", "left_shoulder_yaw_link")
    assert near[pair] == 0.0
    search, probe = PairSearch(robot), CollisionProbe(robot)
    column = search.pairs.index(pair)
    assert not probe.collides(robot.rest)
    arm = [i for i, name in enumerate(robot.joint_names) if name.startswith("left_shoulder")]
    rng, deep = np.random.default_rng(0), 0
    low, high = robot.limits.position_lower, robot.limits.position_upper
    for _ in range(60):
        joints = robot.rest[robot.n_base_q :].copy()
        joints[arm] = rng.uniform(low[arm], high[arm])
        q = search.whole_posture(joints)
        if search.link_distances(q)[column] < -0.02:
            deep += 1
            assert probe.collides(q)
    assert deep > 3
    geometry, kept = watched_model(robot)
    margin = robot.description.collision.margin
    assert len(kept) == len(geometry.collisionPairs) and (kept < margin).sum() >= len(near)


CAMERA = (
    '<link name="camera"><collision><geometry><box size="0.03 0.03 0.03"/></geometry></collision></link>'
    '<joint name="clamp" type="fixed"><parent link="world"/><child link="camera"/><origin xyz="0.5 0 0"/></joint>'
)


@pytest.mark.parametrize(
    ("base", "at", "said"),
    [
        (f'<link name="world"><visual>{MESH}</visual></link>', "0 0 0.4", "boxes stand for"),
        (f'<link name="world"><visual>{MESH}</visual></link>{CAMERA}', "0 0 0.4", "boxes stand for"),
        ('<link name="world"/>', "0 0 0.4", "nothing touches"),
        (f'<link name="world"><visual>{MESH}</visual></link>', "0 0 0", "nothing touches"),
        ('<link name="world"/>', "0 0 0", ""),
        (
            '<link name="world"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>',
            "0 0 0.4",
            "",
        ),
    ],
)
def test_a_root_without_mass_is_a_link_too(tmp_path: Path, base: str, at: str, said: str) -> None:
    path = tmp_path / "arm.urdf"
    text = ARM.replace('<link name="world"/>', base).replace('<origin xyz="0 0 0.1"', f'<origin xyz="{at}"')
    path.write_text(text, encoding="utf-8")
    robot = excite.load_robot(path)
    boxes = {shape.link for shape in robot.description.collision.shapes}
    assert boxes == ({"world"} if said.startswith("boxes") else set())
    time = np.linspace(0.0, 4.0, 801)
    there_and_back = (smooth(time / 2.0) - smooth((time - 2.0) / 2.0))[:, None]
    report = excite.check(robot, [joint_motion(robot, time, robot.rest + there_and_back * [0.0, 0.2])])
    (verdict,) = report.to_json()["motions"]
    assert report.safe and [said in one and "world" in one for one in verdict["as_far_as"]] == [True] * bool(
        said
    )
