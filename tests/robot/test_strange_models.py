"""Model files that are no robot yet: parts, leftovers, robots that lie flat, tables above them, ties to nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

import excite
from excite.errors import RobotError
from excite.robot.init_robot.files import write_scaffold
from excite.robot.shapes.collision import collision_shapes
from tests.robot.small import ARM

pytestmark = pytest.mark.usefixtures("readers_here")
XACRO = '<robot name="small" xmlns:xacro="http://www.ros.org/wiki/xacro">'
BODY = '<body name="a"><joint name="j" axis="0 1 0"/><geom type="sphere" size=".1"/></body>'


@pytest.mark.parametrize(
    "leftover",
    [
        '<xacro:include filename="$(find nowhere)/x.xacro"/>',
        '<xacro:gripper prefix="x"/>',
        '<xacro:if value="${foo}"><link name="never"/></xacro:if>',
        '<xacro:macro name="m" params="a"><link name="${a}"/></xacro:macro><xacro:insert_block name="b"/>',
    ],
)
@pytest.mark.parametrize("head", [XACRO, '<robot name="small">'], ids=["declared", "not declared"])
def test_xacro_left_over_in_a_urdf_means_nothing(head: str, leftover: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.replace('<robot name="small">', head + leftover), encoding="utf-8")
    assert excite.load_robot(path).joint_names == ("shoulder", "elbow")


def test_a_xacro_file_that_cannot_be_expanded_is_refused(tmp_path: Path) -> None:
    """So is a URDF with values that are to be evaluated."""
    text = ARM.replace('<robot name="small">', XACRO + '<xacro:gripper prefix="x"/>')
    for name, content in (("arm.xacro", text), ("arm.urdf", text.replace('upper="1.5"', 'upper="${end}"'))):
        (tmp_path / name).write_text(content, encoding="utf-8")
        with pytest.raises(RobotError, match="xacro cannot expand it"):
            excite.load_robot(tmp_path / name)


@pytest.mark.parametrize(
    "text",
    [
        f"<mujocoinclude>{BODY}</mujocoinclude>",
        "<mujoco><asset/><default/></mujoco>",
        f"<mujoco>{BODY}</mujoco>",
        '<mujoco><actuator><position joint="j"/></actuator></mujoco>',
        f"<worldbody>{BODY}</worldbody>",
        BODY,
    ],
)
def test_a_part_of_a_mujoco_model_is_called_one(text: str, tmp_path: Path) -> None:
    path = tmp_path / "part.xml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RobotError, match=r"a part of a MuJoCo model.*give the file that includes it"):
        excite.load_robot(path)


def flat(leg: str) -> str:
    """A trunk with four limbs stretched out level, as pybullet's Minitaur has its legs."""
    inertial = '<inertial><mass value="{}"/><inertia ixx=".01" ixy="0" ixz="0" iyy=".01" iyz="0" izz=".01"/></inertial>'
    box = '<collision><origin xyz="{}"/><geometry><box size="{}"/></geometry></collision>'
    parts = [f'<link name="trunk">{inertial.format(4)}{box.format("0 0 0", "0.4 0.2 0.1")}</link>']
    for n, (x, y) in enumerate([(0.2, 0.15), (0.2, -0.15), (-0.2, 0.15), (-0.2, -0.15)]):
        above, at = "trunk", f"{x} {y} 0"
        for part in ("upper", "lower"):
            name = f"{leg}{n}_{part}"
            shape = box.format(f"{0.5 * x} 0 0", "0.18 0.03 0.03")
            parts.append(f'<link name="{name}">{inertial.format(0.2)}{shape}</link>')
            parts.append(
                f'<joint name="{name}_joint" type="revolute"><parent link="{above}"/><child link="{name}"/>'
                f'<origin xyz="{at}"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="5" effort="9"/></joint>'
            )
            above, at = name, f"{x} 0 0"
    return f'<robot name="flat">{"".join(parts)}</robot>'


@pytest.mark.parametrize(("leg", "base"), [("leg", "held"), ("knee", "held"), ("arm", "fixed")])
def test_a_robot_whose_legs_lie_flat_is_held(leg: str, base: str, tmp_path: Path) -> None:
    path = tmp_path / "flat.urdf"
    path.write_text(flat(leg), encoding="utf-8")
    assert excite.load_robot(path).description.base == base


def described(tmp_path: Path, **blocks: object) -> Path:
    """The arm's first description with blocks of it changed."""
    (tmp_path / "arm.urdf").write_text(ARM, encoding="utf-8")
    file = write_scaffold(tmp_path / "arm.urdf", tmp_path).description
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    for name, block in blocks.items():
        content[name] = {**content.get(name, {}), **block} if isinstance(block, dict) else block
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file


def test_a_table_above_the_robot_is_refused(tmp_path: Path) -> None:
    robot = excite.load_robot(described(tmp_path, collision={"table_height": 5.0}))
    with pytest.raises(RobotError, match=r"is 5 m, above all joints at rest \(the highest at 0\.5 m\)"):
        collision_shapes(robot)


@pytest.mark.parametrize("factor", [0.0, 1e-300])
def test_a_coupling_by_next_to_nothing_is_refused(factor: float, tmp_path: Path) -> None:
    coupling = {
        "name": "c",
        "joints": {"elbow": factor, "shoulder": -1.0},
        "passive": ["elbow"],
        "source": "t",
    }
    with pytest.raises(RobotError, match=f"the factor of elbow is {factor}"):
        excite.load_robot(described(tmp_path, couplings=[coupling]))


@pytest.mark.parametrize(
    ("ends", "remedy"),
    [
        ([1.0, -1.0], r"exchange them: elbow: \[-1, 1\]"),
        ([1.0, 1.0], r"hold it still: locked_joints: \{elbow: 1\}"),
        ([1.0, 1.04], "make limits.position.margin smaller"),
    ],
)
def test_limits_without_range_say_what_to_do(ends: list[float], remedy: str, tmp_path: Path) -> None:
    position = {"joints": {"elbow": ends}, "margin": 0.03, "source": "test"}
    with pytest.raises(RobotError, match=remedy):
        excite.load_robot(described(tmp_path, limits={"position": position}))
