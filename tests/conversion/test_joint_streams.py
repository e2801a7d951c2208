"""A topic for each joint: together they are one recording of the machine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import excite
from tests.conversion import messages, written
from tests.conversion.written import JOINTS, WHOLE

pytestmark = pytest.mark.usefixtures("unexamined", "readers_here")

DATA = written.motion(200)


def numbers(folder: Path) -> list[Path]:
    """Plain numbers, ``std_msgs/Float64``, on topics that are called after the joint and what it is."""
    types = messages.store()
    number = types.types["std_msgs/msg/Float64"]
    topics = {
        f"/{joint}/{word}": (
            "std_msgs/msg/Float64",
            [(100.0 + t, number(data=float(x))) for t, x in zip(DATA["time"], DATA[c][:, k], strict=True)],
        )
        for k, joint in enumerate(JOINTS)
        for word, c in (("position", "q"), ("torque", "tau"))
    }
    return [messages.bag(folder / "bag", types, topics)]


def joint_states(folder: Path) -> list[Path]:
    """A state for each drive, in a namespace of its own."""
    types = messages.store()
    state = types.types["sensor_msgs/msg/JointState"]
    topics = {}
    for k, joint in enumerate(JOINTS):
        said = []
        for i, t in enumerate(DATA["time"]):
            values = {
                c: np.array([DATA[d][i, k]])
                for c, d in (("position", "q"), ("velocity", "v"), ("effort", "tau"))
            }
            said.append((100.0 + t, state(header=written.stamp(types, 100.0 + t), name=[joint], **values)))
        topics[f"/{joint}/state"] = ("sensor_msgs/msg/JointState", said)
    return [messages.bag(folder / "bag", types, topics)]


@pytest.mark.parametrize("write", [numbers, joint_states])
def test_streams_of_single_joints_are_one_recording(write, tmp_path):
    arm = written.arm_urdf(tmp_path / "arm.urdf")
    found = excite.convert(write(tmp_path), arm, tmp_path / "log", WHOLE)
    (trial,) = found.log.trials
    assert found.log.header.joints == JOINTS
    rows = np.searchsorted(DATA["time"], trial.time - trial.time[0] + 1e-6) - 1
    assert len(rows) > 190
    np.testing.assert_allclose(trial.q, DATA["q"][rows], atol=1e-5)
    np.testing.assert_allclose(trial.tau, DATA["tau"][rows], atol=1e-5)


def test_trials_that_are_called_after_a_joint_stay_trials(tmp_path):
    arm = written.arm_urdf(tmp_path / "arm.urdf")
    names = ["time", *(f"q_{joint}" for joint in JOINTS), *(f"tau_{joint}" for joint in JOINTS)]
    for seed, joint in enumerate(JOINTS):
        data = written.motion(200, seed)
        table = np.column_stack([data["time"], data["q"], data["tau"]])
        np.savetxt(tmp_path / f"{joint}.csv", table, delimiter=",", header=",".join(names), comments="")
    sources = [tmp_path / f"{joint}.csv" for joint in JOINTS]
    found = excite.convert(sources, arm, tmp_path / "log", WHOLE)
    assert len(found.log.trials) == 3
