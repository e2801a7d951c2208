"""A bag of two gigabytes: how much memory its conversion takes."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

from excite.logs.files import load_log
from tests.benchmarks.table import Row
from tests.benchmarks.tree_memory import TreeMemory
from tests.conversion import written

# Joint states take a fifth of the bytes of a recording with a camera, all of one without.
GIGABYTES, MOST_GB, SHARE = 2.0, 1.0, 0.2
_IMAGE = 1_000_000


def write_bag(path: Path, gigabytes: float, share: float = SHARE) -> int:
    """An MCAP with joint states, ``share`` of its bytes, beside images; the number of joint states."""
    store = written.ros2_store()
    kind = "sensor_msgs/msg/JointState"
    text, _ = store.generate_msgdef(kind, ros_version=2)
    data = written.motion(1000)
    rng = np.random.default_rng(0)
    states = [bytes(store.serialize_cdr(m, kind)) for _, m in written.joint_states(store, data, rng)]
    count = int(share * gigabytes * 1e9 / len(states[0]))
    pictures = int((1.0 - share) * gigabytes * 1e9 / _IMAGE)
    every = count // pictures if pictures else count + 1
    with path.open("wb") as stream:
        bag = Writer(stream, compression=CompressionType.NONE)
        bag.start("ros2", "drawn")
        schema = bag.register_schema(kind, "ros2msg", text.encode())
        image = bag.register_schema("sensor_msgs/msg/Image", "ros2msg", b"uint8[] data")
        topic = bag.register_channel("/joint_states", "cdr", schema)
        camera = bag.register_channel("/camera", "cdr", image)
        picture = rng.bytes(_IMAGE)
        for k in range(count):
            # The header's stamp, seconds and nanoseconds, stands behind four bytes of encapsulation.
            now = 100_000_000_000 + 2_000_000 * k
            body = states[k % 1000]
            stamp = (now // 10**9).to_bytes(4, "little") + (now % 10**9).to_bytes(4, "little")
            bag.add_message(topic, now, body[:4] + stamp + body[12:], now)
            if (k + 1) % max(every, 1) == 0:
                bag.add_message(camera, now, picture, now)
        bag.finish()
    return count


def converted(bag: Path, robot: Path, out: Path) -> tuple[int, float]:
    """Rows of the log that comes of it, and the memory of the process and its children at its peak [GB]."""
    arguments = [
        sys.executable,
        "-m",
        "excite",
        "convert",
        str(bag),
        "--robot",
        str(robot),
        "--out",
        str(out),
    ]
    (out.parent / "map.yaml").write_text("trials: {split: none}\n")
    arguments += ["--map", str(out.parent / "map.yaml"), "--json"]
    with subprocess.Popen(arguments, stdout=subprocess.DEVNULL, text=True) as process:
        memory = TreeMemory(process)
        memory.join()
    if process.returncode != 0:
        raise SystemExit(f"the conversion ended with {process.returncode}")
    return sum(trial.n_samples for trial in load_log(out).trials), memory.peak_gb


def rows() -> list[Row]:
    """Memory of the conversion of a bag with a camera in it."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "day.mcap"
        count = write_bag(bag, GIGABYTES)
        robot = written.arm_urdf(Path(folder) / "arm.urdf")
        start = time.perf_counter()
        kept, most = converted(bag, robot, Path(folder) / "log")
        seconds = time.perf_counter() - start
    what = f"conversion of a bag of {GIGABYTES:g} GB, {count} joint states"
    return [
        Row.at_most(f"{what}: memory", most, MOST_GB, "GB"),
        Row(f"{what}: rows of the log", "", f"{kept}, means of {count / kept:.2g}", None),
        Row(f"{what}: time", "", f"{seconds:.0f} s", None),
    ]
