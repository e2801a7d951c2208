"""Message types that robots' drivers and controllers log, each written by rosbags from its published definition."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import excite
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import UnclearError
from excite.conversion.sources.bag import Topics
from excite.conversion.sources.messages import is_of_rows
from excite.formats.bags import open_bag
from tests.conversion import messages, written
from tests.conversion.written import JOINTS

pytestmark = pytest.mark.usefixtures("readers_here", "unexamined")

# Motors of Unitree's quadrupeds in the order of the models' joints, whose first leg is the left one.
SDK_ORDER = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
H1_ORDER = {"left_hip_yaw_joint": 7, "right_hip_roll_joint": 0, "torso_joint": 6, "left_elbow_joint": 19}
WRENCH = "geometry_msgs/msg/WrenchStamped"
WHOLE = {"trials": {"validation": ["none"], "split": "none"}}
HELD = Map.model_validate(WHOLE | {"log": {"base": "held"}})


@pytest.fixture(scope="module")
def types() -> Any:
    return messages.store()


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written.arm_urdf(tmp_path_factory.mktemp("arm") / "arm.urdf")


def swing(joints: int, n: int = 120, middle: Any = 0.0) -> dict[str, np.ndarray]:
    """A motion of many joints at 100 Hz, about a middle that no joint rests at exactly."""
    rng = np.random.default_rng(7)
    time, w, phase = np.arange(n) / 100.0, rng.uniform(0.5, 4.0, joints), rng.uniform(0.0, 6.0, joints)
    angle = np.outer(time, w) + phase
    q, v = middle + 0.2 * np.sin(angle), 0.2 * w * np.cos(angle)
    return {"time": time, "q": q, "v": v, "tau": 3.0 * np.sin(2.0 * angle), "q_cmd": q + 0.01 * v}


def chain(folder: Path, names: list[str]) -> Path:
    """A machine of joints in a row under these names."""
    text = ['<robot name="chain"><link name="link0"/>']
    for k, name in enumerate(names):
        text.append(
            f'<link name="link{k + 1}"><inertial><origin xyz="0.05 0 0"/><mass value="0.5"/>'
            '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="revolute"><parent link="link{k}"/><child link="link{k + 1}"/>'
            '<origin xyz="0.1 0 0"/><axis xyz="0 1 0"/>'
            '<limit lower="-3" upper="3" effort="50" velocity="20"/></joint>'
        )
    (folder / "chain.urdf").write_text("".join([*text, "</robot>"]))
    return folder / "chain.urdf"


def forget_definitions(bag: Path) -> None:
    """Take the types' definitions out of a bag, as recorders before ROS 2 Iron left them out."""
    (file,) = bag.glob("*.db3")
    with sqlite3.connect(file) as database:
        database.execute("DELETE FROM message_definitions")


@pytest.mark.parametrize("bare", [False, True])
def test_a_quadrupeds_low_state(bare, types, tmp_path):
    data = swing(12, middle=np.array([0.0, 0.8, -1.6] * 4))
    bag = messages.bag(
        tmp_path / "bag",
        types,
        {
            "/lowstate": ("unitree_go/msg/LowState", messages.low_states(types, "go", data, SDK_ORDER)),
            "/lowcmd": ("unitree_go/msg/LowCmd", messages.low_commands(types, "go", data, SDK_ORDER)),
        },
        version=8 if bare else 9,
        mcap=not bare,
    )
    if bare:
        forget_definitions(bag)
    log = excite.convert([bag], "go2", tmp_path / "log", HELD).log
    trial = log.trials[0]
    assert log.header.joints == excite.load_robot("go2").joint_names
    for channel in ("q", "v", "tau", "q_cmd"):
        np.testing.assert_allclose(getattr(trial, channel), data[channel], atol=1e-6)
    assert log.header.controller["kp"] == dict.fromkeys(log.header.joints, 60.0)
    assert log.header.controller["kd"]["FL_calf_joint"] == 1.5


def test_a_humanoids_low_state(types, tmp_path):
    robot = excite.load_robot("g1")
    data = swing(29, n=60)
    states = messages.low_states(types, "hg", data, list(range(29)))
    bag = messages.bag(tmp_path / "bag", types, {"/lowstate": ("unitree_hg/msg/LowState", states)})
    mapping = Map.model_validate(WHOLE | {"log": {"base": "held", "torque": "none"}})
    log = excite.convert([bag], "g1", tmp_path / "log", mapping).log
    assert log.header.joints == robot.joint_names
    np.testing.assert_allclose(log.trials[0].q, data["q"], atol=1e-6)


def test_motors_that_a_humanoid_does_not_have_count_for_nothing(types, tmp_path):
    """The G1 with 23 joints leaves out numbers of its larger twin."""
    numbers = [*range(13), *range(15, 20), *range(22, 27)]
    names = [f"joint_{chr(97 + k)}" for k in range(23)]
    data = swing(23, n=60)
    bag = messages.bag(
        tmp_path / "bag",
        types,
        {
            "/lowstate": ("unitree_hg/msg/LowState", messages.low_states(types, "hg", data, numbers)),
            "/lowcmd": ("unitree_hg/msg/LowCmd", messages.low_commands(types, "hg", data, numbers)),
        },
    )
    mapping = Map.model_validate(WHOLE | {"log": {"torque": "none"}})
    trial = excite.convert([bag], chain(tmp_path, names), tmp_path / "log", mapping).log.trials[0]
    np.testing.assert_allclose(trial.q, data["q"], atol=1e-6)
    np.testing.assert_allclose(trial.q_cmd, data["q_cmd"], atol=1e-6)


def test_the_first_humanoid_counts_its_motors_in_its_own_order(types, tmp_path):
    """H1 speaks the quadrupeds' language with twenty motors, one of which it does not have."""
    data = swing(4, n=60)
    motors = list(H1_ORDER.values())
    bag = messages.bag(
        tmp_path / "bag",
        types,
        {"/lowstate": ("unitree_go/msg/LowState", messages.low_states(types, "go", data, motors))},
    )
    mapping = Map.model_validate(WHOLE | {"log": {"torque": "none"}})
    robot = chain(tmp_path, list(H1_ORDER))
    log = excite.convert([bag], robot, tmp_path / "log", mapping).log
    assert log.header.joints == tuple(H1_ORDER)
    np.testing.assert_allclose(log.trials[0].q, data["q"], atol=1e-6)


def test_linkages_that_stand_as_motors_are_asked_for(types, tmp_path):
    data = swing(29, n=60)
    states = messages.low_states(types, "hg", data, list(range(29)), mode_pr=1)
    bag = messages.bag(tmp_path / "bag", types, {"/lowstate": ("unitree_hg/msg/LowState", states)})
    mapping = WHOLE | {"log": {"base": "held", "torque": "none"}}
    with pytest.raises(UnclearError, match="mode_pr") as error:
        excite.convert([bag], "g1", tmp_path / "log", Map.model_validate(mapping))
    ignored = [f"*.motor_{k}" for k in (4, 5, 10, 11, 13, 14)]
    assert all(mark in str(error.value) for mark in ignored)
    log = excite.convert([bag], "g1", tmp_path / "log", Map.model_validate(mapping | {"ignore": ignored})).log
    kept = [k for k in range(29) if k not in (4, 5, 10, 11, 13, 14)]
    assert log.header.joints == tuple(excite.load_robot("g1").joint_names[k] for k in kept)
    np.testing.assert_allclose(log.trials[0].q, data["q"][:, kept], atol=1e-6)


def geared_g1(folder: Path) -> Path:
    """The G1 with pairs of motors behind its ankles and waist, as differentials."""
    robot = excite.load_robot("g1_no_ft")
    content = yaml.safe_load(robot.source.read_text())
    blocks = []
    for name, link, pitch, roll in (
        ("left_ankle", "left_knee_link", "left_ankle_pitch_joint", "left_ankle_roll_joint"),
        ("right_ankle", "right_knee_link", "right_ankle_pitch_joint", "right_ankle_roll_joint"),
        ("waist", "waist_yaw_link", "waist_roll_joint", "waist_pitch_joint"),
    ):
        motors = [
            {"name": f"{name}_{letter}", "link": link, "ratios": {pitch: 1.0, roll: sign}}
            | {"position": [-1.5, 1.5], "velocity": 20.0, "torque": 50.0}
            for letter, sign in (("A", 1.0), ("B", -1.0))
        ]
        blocks.append({"name": name, "joints": [pitch, roll], "motors": motors, "source": "test"})
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(content | {"transmissions": blocks}))
    return path


@pytest.mark.parametrize("mode", [0, 1], ids=["joints", "motors"])
def test_linkages_of_a_robot_that_has_them_are_read_in_either_mode(types, tmp_path, mode):
    """Motors A and B of mode 1 under their own names, joints of mode 0 under theirs; nothing is asked."""
    data = swing(29, n=60)
    states = messages.low_states(types, "hg", data, list(range(29)), mode_pr=mode)
    bag = messages.bag(tmp_path / "bag", types, {"/lowstate": ("unitree_hg/msg/LowState", states)})
    mapping = Map.model_validate(WHOLE | {"log": {"base": "held", "torque": "none"}})
    log = excite.convert([bag], geared_g1(tmp_path), tmp_path / "log", mapping).log
    serial = list(excite.load_robot("g1_no_ft").joint_names)
    for k, name in ((4, "left_ankle"), (10, "right_ankle"), (13, "waist")) if mode else ():
        serial[k : k + 2] = [f"{name}_A", f"{name}_B"]
    assert list(log.header.joints) == serial
    np.testing.assert_allclose(log.trials[0].q, data["q"], atol=1e-6)


def test_messages_that_stood_in_a_queue_are_at_the_robots_own_times(types, tmp_path):
    data = swing(12, middle=np.array([0.0, 0.8, -1.6] * 4))
    late = 0.03 * np.random.default_rng(2).random(len(data["time"]))
    states = (
        (time + delay, message)
        for (time, message), delay in zip(
            messages.low_states(types, "go", data, SDK_ORDER), late, strict=True
        )
    )
    bag = messages.bag(tmp_path / "bag", types, {"/lowstate": ("unitree_go/msg/LowState", states)})
    found = excite.convert([bag], "go2", tmp_path / "log", HELD)
    time = found.log.trials[0].time
    np.testing.assert_allclose(time - time[0], data["time"], atol=1e-6)
    assert any("late" in note and "ticks" in note for note in found.notes)


def test_a_free_base_without_a_pose_is_asked_for_with_its_ways(types, tmp_path):
    states = messages.low_states(types, "hg", swing(29, n=60), list(range(29)))
    bag = messages.bag(tmp_path / "bag", types, {"/lowstate": ("unitree_hg/msg/LowState", states)})
    with pytest.raises(UnclearError) as error:
        excite.convert([bag], "g1", tmp_path / "log")
    assert "base: held" in str(error.value) and "imu: {link: pelvis}" in str(error.value)
    hanging = {"base": "suspended", "base_link": "pelvis", "imu": {"link": "pelvis"}, "torque": "none"}
    log = excite.convert([bag], "g1", tmp_path / "log", Map.model_validate(WHOLE | {"log": hanging})).log
    np.testing.assert_allclose(log.trials[0].imu[0], [0.1, 0.2, 0.3, 0.0, 0.5, 9.8], atol=1e-6)


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("bare", [False, True])
def test_the_controllers_state(bare, old, arm, tmp_path):
    """Both layouts, and both from bags that do not bring their definition."""
    kind = "control_msgs/msg/JointTrajectoryControllerState"
    older = {"control_msgs__JointTrajectoryControllerState": messages.OLD_CONTROLLER_STATE} if old else {}
    types, data = messages.store(**older), written.motion()
    wanted, actual = ("desired", "actual") if old else ("reference", "feedback")

    def states() -> Iterator[tuple[float, Any]]:
        for i, time in enumerate(data["time"]):
            reference = messages.filled(types, messages.POINT, positions=data["q_cmd"][i])
            feedback = messages.filled(
                types, messages.POINT, positions=data["q"][i], velocities=data["v"][i], effort=data["tau"][i]
            )
            yield (
                100.0 + time,
                messages.filled(
                    types,
                    kind,
                    header=messages.header(types, 100.0 + time),
                    joint_names=list(JOINTS),
                    **{wanted: reference, actual: feedback},
                ),
            )

    bag = messages.bag(tmp_path / "bag", types, {"/jtc/state": (kind, states())}, version=8, mcap=not bare)
    if bare:
        forget_definitions(bag)
    trial = excite.convert([bag], arm, tmp_path / "log", Map.model_validate(WHOLE)).log.trials[0]
    for channel in ("q", "v", "tau", "q_cmd"):
        np.testing.assert_allclose(getattr(trial, channel), data[channel], atol=1e-9)


def test_interfaces_of_joints_by_name(types, arm, tmp_path):
    kind, data = "control_msgs/msg/DynamicJointState", written.motion()

    def states() -> Iterator[tuple[float, Any]]:
        for i, time in enumerate(data["time"]):
            values = [
                messages.filled(
                    types,
                    "control_msgs/msg/InterfaceValue",
                    interface_names=["effort", "temperature", "position", "velocity"],
                    values=np.array([data["tau"][i, k], 40.0, data["q"][i, k], data["v"][i, k]]),
                )
                for k in range(3)
            ]
            stamp = messages.header(types, 100.0 + time)
            yield (
                100.0 + time,
                messages.filled(types, kind, header=stamp, joint_names=list(JOINTS), interface_values=values),
            )

    bag = messages.bag(tmp_path / "bag", types, {"/dynamic_joint_states": (kind, states())})
    trial = excite.convert([bag], arm, tmp_path / "log", Map.model_validate(WHOLE)).log.trials[0]
    for channel in ("q", "v", "tau"):
        np.testing.assert_allclose(getattr(trial, channel), data[channel], atol=1e-9)


def test_a_type_that_nothing_is_known_of_is_read_by_its_definition(types, tmp_path):
    kind, data = (
        "franka_msgs/msg/FrankaState",
        swing(7, n=300, middle=np.array([0, -0.5, 0, -2.0, 0, 1.8, 0.5])),
    )

    def states() -> Iterator[tuple[float, Any]]:
        for i, time in enumerate(data["time"]):
            yield (
                100.0 + time,
                messages.filled(
                    types,
                    kind,
                    header=messages.header(types, 100.0 + time),
                    q=data["q"][i],
                    dq=data["v"][i],
                    tau_J=data["tau"][i],
                    q_d=data["q_cmd"][i],
                    tau_ext_hat_filtered=0.1 * data["tau"][i],
                ),
            )

    bag = messages.bag(tmp_path / "bag", types, {"/franka/state": (kind, states())})
    trial = excite.convert([bag], "panda", tmp_path / "log", Map.model_validate(WHOLE)).log.trials[0]
    for channel in ("q", "v", "tau", "q_cmd"):
        np.testing.assert_allclose(getattr(trial, channel), data[channel], atol=1e-9)


def test_messages_in_json(arm, tmp_path):
    from mcap.writer import Writer

    data = written.motion()
    with (tmp_path / "run.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("state", "jsonschema", b"{}")
        channel = writer.register_channel("/state", "json", schema)
        for i, time in enumerate(data["time"]):
            body = {"names": list(JOINTS)} | {
                word: data[c][i].tolist()
                for word, c in (("position", "q"), ("velocity", "v"), ("torque", "tau"))
            }
            now = round((100.0 + time) * 1e9)
            writer.add_message(channel, now, json.dumps(body).encode(), now)
        writer.finish()
    found = excite.convert([tmp_path / "run.mcap"], arm, tmp_path / "log", Map.model_validate(WHOLE))
    for channel in ("q", "v", "tau"):
        np.testing.assert_allclose(getattr(found.log.trials[0], channel), data[channel], atol=1e-9)


def standing(types: Any, data: dict[str, np.ndarray], feet: tuple[str, str]) -> dict[str, Any]:
    """Topics of a humanoid that stands: joints, odometry, IMU, and two ankle sensors."""
    names = excite.load_robot("g1").joint_names

    def of(kind: str, fill: Any) -> tuple[str, Iterator[tuple[float, Any]]]:
        def each() -> Iterator[tuple[float, Any]]:
            for i, time in enumerate(data["time"]):
                message = messages.filled(types, kind, header=messages.header(types, 100.0 + time))
                fill(message, i)
                yield 100.0 + time, message

        return kind, each()

    def joints(message: Any, i: int) -> None:
        message.name = list(names)
        message.position, message.velocity, message.effort = data["q"][i], data["v"][i], data["tau"][i]

    def odometry(message: Any, i: int) -> None:
        message.pose.pose.position.z = 0.75 + 1e-3 * i
        message.pose.pose.orientation.w = 1.0

    def inertial(message: Any, i: int) -> None:
        message.orientation.w, message.linear_acceleration.z = 1.0, 9.81

    def wrench(force: float) -> Any:
        def fill(message: Any, i: int) -> None:
            message.wrench.force.z, message.wrench.torque.x = force + i, 0.5

        return fill

    return {
        "/joint_states": of("sensor_msgs/msg/JointState", joints),
        "/odom": of("nav_msgs/msg/Odometry", odometry),
        "/imu/data": of("sensor_msgs/msg/Imu", inertial),
        f"/{feet[0]}/wrench": of("geometry_msgs/msg/WrenchStamped", wrench(150.0)),
        f"/{feet[1]}/wrench": of("geometry_msgs/msg/WrenchStamped", wrench(190.0)),
    }


def test_a_standing_robots_pose_and_wrenches(types, tmp_path):
    data = swing(29, n=60)
    bag = messages.bag(tmp_path / "bag", types, standing(types, data, ("ft_l", "ft_r")))
    log = excite.convert([bag], "g1", tmp_path / "log", Map.model_validate(WHOLE)).log
    assert log.header.base == "floating" and log.header.base_link == "pelvis"
    assert [sensor.name for sensor in log.header.sensors] == ["left_foot", "right_foot"]
    trial = log.trials[0]
    np.testing.assert_allclose(trial.base[:, 2], 0.75 + 1e-3 * np.arange(60), atol=1e-9)
    np.testing.assert_allclose(trial.wrenches["left_foot"][:, 2], 150.0 + np.arange(60), atol=1e-9)
    np.testing.assert_allclose(trial.wrenches["right_foot"][:, 3], 0.5)
    assert any(guess.what == "wrench" for guess in log.header.guessed)


def test_wrenches_of_no_known_sensor_are_left_out_and_named(types, arm, tmp_path):
    """A wrist sensor of an arm is no contact that carries it."""
    data = written.motion()

    def wrenches() -> Iterator[tuple[float, Any]]:
        for time in data["time"]:
            stamp = messages.header(types, 100.0 + time)
            yield 100.0 + time, messages.filled(types, "geometry_msgs/msg/WrenchStamped", header=stamp)

    states = written.joint_states(types, data, np.random.default_rng(1))
    topics = {
        "/joint_states": ("sensor_msgs/msg/JointState", states),
        "/wrist": ("geometry_msgs/msg/WrenchStamped", wrenches()),
    }
    bag = messages.bag(tmp_path / "bag", types, topics)
    header = excite.convert([bag], arm, tmp_path / "log", Map.model_validate(WHOLE)).log.header
    assert any(guess.what == "wrench" and guess.source == "wrist" for guess in header.guessed)


def mixed_messages(types: Any) -> dict[str, tuple[str, list[tuple[float, Any]]]]:
    """Joints that change their order, efforts that are there at times, and rows with texts of several lengths."""
    rng = np.random.default_rng(3)
    kinds = {
        name: f"{kind}" for name, kind in (("/joints", "sensor_msgs/msg/JointState"), ("/wrench", WRENCH))
    }
    found: dict[str, tuple[str, list[tuple[float, Any]]]] = {
        topic: (kind, []) for topic, kind in kinds.items()
    }
    for k in range(1200):
        names = ["shoulder", "elbow", "wrist"][:: -1 if k % 100 > 90 else 1]
        at, efforts = 50.0 + 0.01 * k, 3 if k % 50 else 0
        numbers = {
            "position": rng.normal(size=3),
            "velocity": rng.normal(size=3),
            "effort": rng.normal(size=efforts),
        }
        state = messages.filled(
            types, kinds["/joints"], header=messages.header(types, at), name=names, **numbers
        )
        wrench = messages.filled(types, WRENCH, header=messages.header(types, at))
        wrench.wrench.force.x, wrench.wrench.torque.z = rng.normal(size=2)
        wrench.header.frame_id = "wrist" if k < 700 else "a longer one"
        found["/joints"][1].append((at, state))
        found["/wrench"][1].append((at, wrench))
    return found


def test_messages_that_are_read_together_hold_what_each_holds_alone(types: Any, tmp_path: Path) -> None:
    """As rosbags decodes each of them, in far fewer steps."""
    path, found = messages.bag(tmp_path / "run", types, mixed_messages(types)), {}
    for how, together in (("alone", lambda kind: False), ("together", is_of_rows)):
        topics, steps = Topics(), 0
        with open_bag(path) as bag:
            for message in bag.messages(lambda topic, kind: True, together=together):
                topics.add(*message)
                steps += 1
        found[how] = topics.recording(path, {}).streams
        assert steps == 2400 if how == "alone" else steps < 150
    for one, other in zip(found["alone"], found["together"], strict=True):
        assert [column.name for column in one.columns] == [column.name for column in other.columns]
        np.testing.assert_array_equal(one.time, other.time)
        for a, b in zip(one.columns, other.columns, strict=True):
            np.testing.assert_array_equal(a.values, b.values)
