"""Limits of joints that stand elsewhere than in ``<limit>``: the tighter one holds, and it is said whose it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import excite
from excite.errors import RobotError
from excite.robot.init_robot.source import Source
from excite.robot.robot import Robot
from tests.robot.small import ARM, ELBOW_LIMIT
from tests.safety.motions import joint_motion, smooth

pytestmark = pytest.mark.usefixtures("readers_here")

MARGIN = 0.03
CONTROL = (
    '<ros2_control name="arm" type="system"><joint name="elbow"><command_interface name="position">'
    '<param name="min">-0.5</param><param name="max">3.0</param></command_interface>'
    '<command_interface name="velocity"><param name="min">-0.7</param><param name="max">0.7</param></command_interface>'
    '<command_interface name="acceleration"><param name="min">-4</param><param name="max">4</param></command_interface>'
    '<command_interface name="effort"><param name="min">-90</param><param name="max">90</param></command_interface>'
    "</joint></ros2_control></robot>"
)


def arm(path: Path, text: str, source: Source | None = None) -> Robot:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return excite.load_robot(path, source)


def elbow(robot: Robot) -> tuple[float, float]:
    """Range of the elbow, the margin given back [rad]."""
    limits = robot.limits
    return float(limits.position_lower[1] - MARGIN), float(limits.position_upper[1] + MARGIN)


def said(robot: Robot) -> str:
    return "\n".join(str(one) for one in robot.description.assumed)


@pytest.mark.parametrize(
    ("soft", "left"),
    [
        ('soft_lower_limit="-1.0" soft_upper_limit="0.5"', (-1.0, 0.5)),
        ('soft_lower_limit="-3.0" soft_upper_limit="0.5"', (-2.0, 0.5)),
        ('soft_lower_limit="-3.0" soft_upper_limit="3.0"', (-2.0, 2.0)),
        ('soft_lower_limit="0" soft_upper_limit="0"', (-2.0, 2.0)),
        ('soft_upper_limit="0.5"', (-2.0, 0.5)),
        ('soft_lower_limit="-0.5"', (-0.5, 2.0)),
        ("", (-2.0, 2.0)),
    ],
)
def test_soft_limits_of_a_safety_controller(soft: str, left: tuple[float, float], tmp_path: Path) -> None:
    text = ARM.replace(ELBOW_LIMIT, f'{ELBOW_LIMIT}<safety_controller k_velocity="10" {soft}/>')
    robot = arm(tmp_path / "arm.urdf", text)
    assert elbow(robot) == pytest.approx(left)
    assert ("limits of <safety_controller>: position of elbow" in said(robot)) == (left != (-2.0, 2.0))


def test_soft_limits_that_leave_nothing_are_refused(tmp_path: Path) -> None:
    soft = '<safety_controller soft_lower_limit="4" soft_upper_limit="5"/>'
    with pytest.raises(RobotError, match="nothing in common with 4 … 5 of <safety_controller>"):
        arm(tmp_path / "arm.urdf", ARM.replace(ELBOW_LIMIT, ELBOW_LIMIT + soft))


def test_limits_of_commands_of_ros2_control(tmp_path: Path) -> None:
    robot = arm(tmp_path / "arm.urdf", ARM.replace("</robot>", CONTROL))
    assert elbow(robot) == pytest.approx((-0.5, 2.0))
    assert robot.limits.velocity[1] == 0.7 and robot.limits.acceleration[1] == 4.0
    # 20 N·m of <limit> are less than 90.
    assert robot.limits.torque[1] == 20.0
    assert "limits of <ros2_control>: position of elbow; velocity of elbow" in said(robot)


@pytest.mark.parametrize(("end", "value", "left"), [("min", -0.5, (-0.5, 2.0)), ("max", 0.5, (-2.0, 0.5))])
@pytest.mark.parametrize("form", ["command", "file"])
def test_one_end_alone_is_a_limit(
    form: str, end: str, value: float, left: tuple[float, float], tmp_path: Path
) -> None:
    text, file = ARM, tmp_path / "limits.yaml"
    if form == "command":
        other = {"min": '<param name="max">3.0</param>', "max": '<param name="min">-0.5</param>'}[end]
        stated = CONTROL.replace(other, "").replace(">3.0<", f">{value}<")
        text = ARM.replace("</robot>", stated)
    file.write_text(f"joint_limits: {{elbow: {{{end}_position: {value}}}}}")
    robot = arm(tmp_path / "arm.urdf", text, Source(limits=file) if form == "file" else None)
    assert elbow(robot) == pytest.approx(left)


@pytest.mark.parametrize(
    ("stated", "left"), [("max_position: 0.5", (0.5 - 2 * np.pi, 0.5)), ("min_position: -4.0", (-4.0, np.pi))]
)
def test_one_end_of_a_joint_that_turns_without_end(
    stated: str, left: tuple[float, float], tmp_path: Path
) -> None:
    file = tmp_path / "limits.yaml"
    file.write_text(f"joint_limits: {{elbow: {{{stated}}}}}")
    text = ARM.replace('<joint name="elbow" type="revolute">', '<joint name="elbow" type="continuous">')
    text = text.replace(ELBOW_LIMIT, '<limit velocity="3.0" effort="20"/>')
    assert elbow(arm(tmp_path / "arm.urdf", text, Source(limits=file))) == pytest.approx(left)


def test_a_joint_that_robot_yaml_states_keeps_what_it_states(tmp_path: Path) -> None:
    arm(tmp_path / "arm.urdf", ARM.replace("</robot>", CONTROL))
    written = excite.write_scaffold(tmp_path / "arm.urdf", tmp_path).description
    text = written.read_text(encoding="utf-8")
    written.write_text(text.replace("position: {margin", "position: {joints: {elbow: [-1.5, 1.5]}, margin"))
    robot = excite.load_robot(written)
    assert elbow(robot) == pytest.approx((-1.5, 1.5))
    assert "position of elbow" not in said(robot)


LIMITS = """joint_limits:
  shoulder:
    has_velocity_limits: true
    max_velocity: 0.4
    has_acceleration_limits: true
    max_acceleration: 1.25
    has_jerk_limits: true
    max_jerk: 6.0
  elbow:
    has_velocity_limits: false
    max_velocity: 0.1
    has_position_limits: true
    min_position: !degrees -45
    max_position: !degrees 400
    max_effort: 9.0
  finger:
    max_velocity: 0.2
"""


def check_limits(robot: Robot, source: str) -> None:
    limits = robot.limits
    assert elbow(robot) == pytest.approx((-np.pi / 4.0, 2.0))
    assert limits.velocity.tolist() == [0.4, 3.0]
    assert limits.torque.tolist() == [50.0, 9.0]
    assert limits.acceleration[0] == 1.25
    assert limits.jerk[0] == 6.0
    assert source in said(robot)


def test_joint_limits_of_moveit_found_in_the_package(tmp_path: Path) -> None:
    package = tmp_path / "arm_description"
    (package / "config").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>arm_description</name></package>")
    (package / "config" / "joint_limits.yaml").write_text(LIMITS)
    check_limits(
        arm(package / "urdf" / "deep" / "arm.urdf", ARM), "limits of arm_description/config/joint_limits.yaml"
    )


def test_joint_limits_of_moveit_found_beside_the_package(tmp_path: Path) -> None:
    package, beside = tmp_path / "arm_description", tmp_path / "arm_moveit_config" / "config"
    beside.mkdir(parents=True)
    package.mkdir()
    (package / "package.xml").write_text("<package><name>arm_description</name></package>")
    (beside / "joint_limits.yaml").write_text(LIMITS)
    check_limits(arm(package / "urdf" / "arm.urdf", ARM), "arm_moveit_config/config/joint_limits.yaml")


@pytest.mark.parametrize(
    "around", ["robot_description_planning", "/**: {ros__parameters", "node: {ros__parameters"]
)
def test_joint_limits_of_ros_parameters_beside_a_model(around: str, tmp_path: Path) -> None:
    """Names of nodes stand around them; a range may be a soft one, and an acceleration that of braking."""
    limits = (
        "{elbow: {has_soft_limits: true, soft_lower_limit: -0.4, soft_upper_limit: 0.3, k_position: 10.0, "
        "max_deceleration: -1.5, max_acceleration: 2.0}}"
    )
    closed = "}" * around.count("{")
    (tmp_path / "joint_limits.yaml").write_text(f"{around}: {{joint_limits: {limits}}}{closed}\n")
    robot = arm(tmp_path / "arm.urdf", ARM)
    assert elbow(robot) == pytest.approx((-0.4, 0.3))
    assert robot.limits.acceleration[1] == 1.5
    assert "joint_limits.yaml" in said(robot)


def test_joint_limits_that_are_given_hold_for_a_model_and_for_a_robot_yaml(tmp_path: Path) -> None:
    file = tmp_path / "slow.yaml"
    file.write_text(LIMITS)
    robot = arm(tmp_path / "arm.urdf", ARM, Source(limits=file))
    check_limits(robot, "limits of slow.yaml")
    described = excite.write_scaffold(tmp_path / "arm.urdf", tmp_path).description
    check_limits(excite.load_robot(described, Source(limits=file)), "limits of slow.yaml")
    assert excite.load_robot(described).limits.velocity.tolist() == [2.0, 3.0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("joint_limits: {other: {max_velocity: 1.0}}", "names no joint of the robot; the model has shoulder"),
        ("limits: {}", "has no mapping joint_limits"),
        (
            "joint_limits: {elbow: {lower: -0.5, upper: 0.5}}",
            "elbow.lower: is no limit; write one of min_position",
        ),
        ("joint_limits: {elbow: {max_velocity: fast}}", "is 'fast', no number"),
        (
            "by_position: [{joint: wrist, quantity: torque, at: [0, 1], limit: [1, 2]}]",
            "no joint 'wrist' in the model",
        ),
        (
            "by_position: [{joint: elbow, quantity: torque, at: [0, 1], limit: [1]}]",
            "limit has to have 2 values",
        ),
        ("by_position: {elbow: 1.0}", "is no list of tables"),
        (
            "joint_limits: {elbow: {min_position: 1.0, max_position: -1.0}}",
            "min_position 1 is not below max_position -1; exchange",
        ),
    ],
)
def test_a_file_that_is_none_is_refused(text: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "limits.yaml"
    file.write_text(text)
    with pytest.raises(RobotError, match=said):
        arm(tmp_path / "arm.urdf", ARM, Source(limits=file))


def test_limits_by_position_hold_for_a_model_and_for_a_robot_yaml(tmp_path: Path) -> None:
    """Slow near the end: the elbow's velocity there is judged by the table, elsewhere by its own 3 rad/s."""
    file = tmp_path / "slow.yaml"
    table = "{joint: elbow, quantity: velocity, at: [0.1, 0.11], limit: [3.0, 0.05]}"
    file.write_text(f"by_position: [{table}]")
    model = tmp_path / "arm.urdf"
    model.write_text(ARM, encoding="utf-8")
    described = excite.write_scaffold(model, tmp_path).description
    limited = excite.write_scaffold(model, tmp_path / "limited", source=Source(limits=file)).description
    time = np.linspace(0.0, 4.0, 801)
    there_and_back = (smooth(time / 2.0) - smooth((time - 2.0) / 2.0))[:, None]
    for path, source in ((model, Source(limits=file)), (described, Source(limits=file)), (limited, None)):
        robot = excite.load_robot(path, source)
        assert "limits of slow.yaml: velocity by position of elbow" in said(robot)
        for height, safe in ((0.1, True), (0.2, False)):
            motion = joint_motion(robot, time, there_and_back * [0.0, height])
            assert excite.check(robot, [motion]).safe == safe, (path, height)


def test_limits_that_who_described_a_robot_chose_are_assumed() -> None:
    found = {one.what: one.value for one in excite.load_robot("ur10").description.assumed}
    assert found["jerk limits"].startswith("160 rad/s³") and "acceleration limits" in found
    assert "jerk limits" not in {one.what for one in excite.load_robot("panda").description.assumed}
    time = np.linspace(0.0, 1.0, 201)
    robot = excite.load_robot("ur10")
    still = joint_motion(robot, time, np.tile(robot.rest, (201, 1)))
    assert "jerk limits" in excite.check(robot, [still]).summary().splitlines()[-1]


def test_jerk_limits_that_a_file_states_are_not_assumed(tmp_path: Path) -> None:
    file = tmp_path / "limits.yaml"
    file.write_text("joint_limits: {shoulder: {max_jerk: 5.0}, elbow: {max_jerk: 6.0}}")
    robot = arm(tmp_path / "arm.urdf", ARM, Source(limits=file))
    assert robot.limits.jerk.tolist() == [5.0, 6.0]
    assert "jerk limits" not in {one.what for one in robot.description.assumed}


def test_a_joint_without_position_limits_has_an_assumed_one(tmp_path: Path) -> None:
    text = ARM.replace('<joint name="elbow" type="revolute">', '<joint name="elbow" type="continuous">')
    text = text.replace(ELBOW_LIMIT, '<limit velocity="3.0" effort="20"/>')
    robot = arm(tmp_path / "arm.urdf", text)
    assert "position limits of joints that turn without end: half a turn either way: elbow" in said(robot)


MJCF = """<mujoco><compiler angle="radian"/><worldbody>
<body name="upper" pos="0 0 .1"><inertial mass="1" pos="0 0 .1" diaginertia=".01 .01 .005"/>
<joint name="shoulder" axis="0 1 0" range="-2 2" actuatorfrcrange="{joint}"/>
<geom type="capsule" size=".03 .1" pos="0 0 .1"/>
<body name="lower" pos="0 0 .3"><inertial mass="1" pos="0 0 .1" diaginertia=".01 .01 .005"/>
<joint name="elbow" axis="0 1 0" range="-2 2"/><geom type="capsule" size=".03 .1" pos="0 0 .1"/>
</body></body></worldbody>
<actuator><motor joint="shoulder" gear="2" forcerange="{motor}"/>
<position joint="elbow" kp="100" ctrlrange="-1 2.5" forcerange="-30 40"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("joint", "motor", "torque"),
    [("-12 12", "-50 50", 12.0), ("-120 120", "-50 50", 100.0), ("-10 60", "-50 50", 10.0)],
)
def test_forces_of_a_mujoco_model_are_the_tighter_ones(
    joint: str, motor: str, torque: float, tmp_path: Path
) -> None:
    robot = arm(tmp_path / "arm.xml", MJCF.format(joint=joint, motor=motor))
    assert robot.limits.torque.tolist() == [torque, 30.0]
    # What a position servo may be told ends where its commands do.
    assert elbow(robot) == pytest.approx((-1.0, 2.0))


def test_a_motion_of_a_joint_whose_limits_are_equal_is_told_that_it_is_held(tmp_path: Path) -> None:
    still = ELBOW_LIMIT.replace('lower="-2.0"', 'lower="0.5"').replace('upper="2.0"', 'upper="0.5"')
    assert still != ELBOW_LIMIT
    robot = arm(tmp_path / "arm.urdf", ARM.replace(ELBOW_LIMIT, still))
    rows = "\n".join(f"{0.01 * k},0,0" for k in range(20))
    (tmp_path / "rest.csv").write_text(f"time,q.shoulder,q.elbow\n{rows}\n")
    with pytest.raises(excite.ExciteError, match="holds this joint still; leave its columns out") as told:
        excite.check(robot, [tmp_path / "rest.csv"])
    assert "q.elbow" in str(told.value)
