"""Recordings of one motion in every format, each written by the format's own library."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

import excite
from excite.conversion.convert import Conversion
from excite.conversion.explicit_mapping import Map

# A recording is one trial, all of it to identify from.
_IN_ONE = {"trials": {"validation": ["none"], "split": "none"}}
WHOLE = Map.model_validate(_IN_ONE)
JOINTS = ("shoulder", "elbow", "wrist")
RATE = 100.0


def whole(source: Path, arm: Path, folder: Path, **stated: object) -> Conversion:
    """The conversion of a recording that is kept in one piece."""
    return excite.convert([source], arm, folder / "log", Map.model_validate(_IN_ONE | stated))


def arm_urdf(path: Path) -> Path:
    """An arm of three joints that turn about alternating axes."""
    links = ["base", "upper", "fore", "hand"]
    text = ['<robot name="arm">']
    text += [
        f'<link name="{link}"><inertial><origin xyz="0.1 0 0"/><mass value="{4 - k}"/>'
        f'<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for k, link in enumerate(links)
    ]
    for k, joint in enumerate(JOINTS):
        axis = "0 1 0" if k % 2 == 0 else "0 0 1"
        text.append(
            f'<joint name="{joint}" type="revolute"><parent link="{links[k]}"/><child link="{links[k + 1]}"/>'
            f'<origin xyz="0.3 0 0"/><axis xyz="{axis}"/>'
            f'<limit lower="-2.5" upper="2.5" effort="60" velocity="4"/></joint>'
        )
    path.write_text("\n".join([*text, "</robot>"]))
    return path


def motion(n: int = 600, seed: int = 0) -> dict[str, np.ndarray]:
    """``time`` ``(n,)``, ``q``, ``v``, ``tau``, ``q_cmd`` ``(n, 3)``; torques of no particular machine."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) / RATE
    q, v, a = (np.zeros((n, 3)) for _ in range(3))
    for k in range(3):
        for w in rng.uniform(0.5, 5.0, 4):
            phase = rng.uniform(0.0, 6.0)
            q[:, k] += 0.3 * np.sin(w * time + phase)
            v[:, k] += 0.3 * w * np.cos(w * time + phase)
            a[:, k] -= 0.3 * w * w * np.sin(w * time + phase)
    tau = np.array([8.0, 4.0, 1.0]) * np.cos(q) + 0.2 * a + 0.5 * np.sign(v)
    return {"time": time, "q": q, "v": v, "tau": tau, "q_cmd": q + 0.01 * v}


def ros2_store():
    """A typestore with what rosbags lacks: the controller's state and Unitree's messages."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = get_types_from_msg(
        "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint reference\n"
        "trajectory_msgs/JointTrajectoryPoint feedback\ntrajectory_msgs/JointTrajectoryPoint error\n"
        "trajectory_msgs/JointTrajectoryPoint output",
        "control_msgs/msg/JointTrajectoryControllerState",
    )
    types |= get_types_from_msg(
        "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\nint16 temperature",
        "unitree_hg/msg/IMUState",
    )
    types |= get_types_from_msg(
        "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nint16[2] temperature\nfloat32 vol\n"
        "uint32[2] sensor\nuint32 motorstate\nuint32[4] reserve",
        "unitree_hg/msg/MotorState",
    )
    types |= get_types_from_msg(
        "uint32[2] version\nuint8 mode_pr\nuint8 mode_machine\nuint32 tick\nunitree_hg/IMUState imu_state\n"
        "unitree_hg/MotorState[35] motor_state\nuint8[40] wireless_remote\nuint32[4] reserve\nuint32 crc",
        "unitree_hg/msg/LowState",
    )
    store.register(types)
    return store


def stamp(store, seconds: float):
    """A header at a time [s]."""
    time = store.types["builtin_interfaces/msg/Time"](sec=int(seconds), nanosec=round((seconds % 1.0) * 1e9))
    return store.types["std_msgs/msg/Header"](stamp=time, frame_id="base")


def joint_states(store, data: dict[str, np.ndarray], rng: np.random.Generator, *, effort: bool = True):
    """Times [s] and JointState messages, names in another order in each."""
    for i, time in enumerate(data["time"]):
        order = rng.permutation(3)
        yield (
            100.0 + time,
            store.types["sensor_msgs/msg/JointState"](
                header=stamp(store, 100.0 + time),
                name=[JOINTS[k] for k in order],
                position=data["q"][i, order],
                velocity=data["v"][i, order],
                effort=data["tau"][i, order] if effort else np.zeros(0),
            ),
        )


def ros2_bag(path: Path, data: dict[str, np.ndarray], *, mcap: bool) -> Path:
    """A ROS 2 bag with joint states and a topic that nobody reads."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    store = ros2_store()
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    rng = np.random.default_rng(1)
    with Writer(path, version=9, storage_plugin=plugin) as bag:
        topic = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        other = bag.add_connection("/rosout", "std_msgs/msg/String", typestore=store)
        for time, message in joint_states(store, data, rng):
            bag.write(topic, round(time * 1e9), store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
        word = store.types["std_msgs/msg/String"](data="hello")
        bag.write(other, round(100.0e9), store.serialize_cdr(word, "std_msgs/msg/String"))
    return path


def ros1_bag(path: Path, data: dict[str, np.ndarray]) -> Path:
    """A ROS 1 bag with joint states."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    rng = np.random.default_rng(1)
    with Writer(path) as bag:
        topic = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for i, time in enumerate(data["time"]):
            order = rng.permutation(3)
            now = store.types["builtin_interfaces/msg/Time"](
                sec=100 + int(time), nanosec=round((time % 1.0) * 1e9)
            )
            message = store.types["sensor_msgs/msg/JointState"](
                header=store.types["std_msgs/msg/Header"](seq=i, stamp=now, frame_id=""),
                name=[JOINTS[k] for k in order],
                position=data["q"][i, order],
                velocity=data["v"][i, order],
                effort=data["tau"][i, order],
            )
            bag.write(
                topic,
                round((100.0 + time) * 1e9),
                store.serialize_ros1(message, "sensor_msgs/msg/JointState"),
            )
    return path


def lerobot(path: Path, data: dict[str, np.ndarray], *, version: str) -> Path:
    """A LeRobot data set with two episodes, in radians."""
    n = len(data["time"])
    half = n // 2
    names = [f"{joint}.pos" for joint in JOINTS]
    (path / "meta").mkdir(parents=True)
    info = {
        "codebase_version": version,
        "fps": RATE,
        "features": {
            "observation.state": {"dtype": "float32", "shape": [3], "names": names},
            "action": {"dtype": "float32", "shape": [3], "names": names},
        },
    }
    (path / "meta" / "info.json").write_text(json.dumps(info))
    index = np.repeat([0, 1], [half, n - half])
    frame = np.concatenate([np.arange(half), np.arange(n - half)])
    table = pa.table(
        {
            "observation.state": pa.array(data["q"].astype(np.float32).tolist()),
            "action": pa.array(data["q_cmd"].astype(np.float32).tolist()),
            "timestamp": frame / RATE,
            "frame_index": frame,
            "episode_index": index,
        }
    )
    if version == "v3.0":
        (path / "data" / "chunk-000").mkdir(parents=True)
        pyarrow.parquet.write_table(table, path / "data" / "chunk-000" / "file-000.parquet")
    else:
        (path / "data" / "chunk-000").mkdir(parents=True)
        for episode in (0, 1):
            part = table.filter(pa.array(index == episode))
            pyarrow.parquet.write_table(part, path / "data" / "chunk-000" / f"episode_{episode:06d}.parquet")
    return path


def torch_file(path: Path, arrays: dict[str, np.ndarray]) -> Path:
    """A ``.pt`` as torch writes it: a pickle of opcodes that name storages, and their bytes, in an archive."""
    kinds = {"<f4": "FloatStorage", "<f8": "DoubleStorage"}
    out = b"\x80\x02}(" if arrays else b"\x80\x02}"

    def text(word: str) -> bytes:
        raw = word.encode()
        return b"X" + len(raw).to_bytes(4, "little") + raw

    def number(value: int) -> bytes:
        return b"J" + value.to_bytes(4, "little", signed=True)

    for key, (name, array) in enumerate(arrays.items()):
        sizes = b"(" + b"".join(number(n) for n in array.shape) + b"t"
        steps = b"(" + b"".join(number(s // array.itemsize) for s in array.strides) + b"t"
        storage = b"ctorch\n" + kinds[array.dtype.str].encode() + b"\n"
        pid = b"(" + text("storage") + storage + text(str(key)) + text("cpu") + number(array.size) + b"tQ"
        out += text(name) + b"ctorch._utils\n_rebuild_tensor_v2\n(" + pid + number(0) + sizes + steps
        out += b"\x89" + b"ccollections\nOrderedDict\n)R" + b"tR"
    out += b"u." if arrays else b"."
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("archive/data.pkl", out)
        for key, array in enumerate(arrays.values()):
            archive.writestr(f"archive/data/{key}", np.ascontiguousarray(array).tobytes())
    return path
