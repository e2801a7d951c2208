"""Recordings of a robot that stands on its feet: pose, IMU and flags of contact in columns of a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import excite
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import UnclearError
from excite.errors import LogError
from tests.conversion.test_habits import table
from tests.quadruped import LEGS, write_quadruped

pytestmark = pytest.mark.usefixtures("unexamined")

_G = 9.80665
_JOINTS = [f"{leg}_{joint}" for leg in LEGS for joint in ("roll", "pitch", "knee")]
# How programs call position, quaternion, gyroscope, accelerometer and a foot's flag.
_PLAIN = (
    "base_pos_{}",
    "base_quat_{}",
    "imu_gyro_{}",
    "imu_accel_{}",
    "contact_{}",
)
_ISAAC = ("root_pos_w[{n}]", "root_quat_w[{n}]", "gyro_{}", "accelerometer_{}", "foot_contact_{n}")
_ODOM = (
    "odom.pose.position.{}",
    "odom.pose.orientation.{}",
    "imu.angular_velocity.{}",
    "imu.linear_acceleration.{}",
    "{}_in_contact",
)
_SHORT = ("trunk_p{}", "trunk_q{}", "imu_g{}", "imu_a{}", "stance_{}")


def _stood() -> dict[str, np.ndarray]:
    """A trunk that sways over its feet, of which the first is lifted once."""
    time = 0.004 * np.arange(900)
    turn = Rotation.from_euler(
        "xyz", np.column_stack([0.1 * np.sin(3.0 * time), 0.08 * np.sin(2.0 * time), 0.0 * time])
    )
    lifted = (time > 1.0) & (time < 2.0)
    rate = np.gradient(turn.as_rotvec(), time, axis=0)
    return {
        "time": time,
        "q": 0.3 * np.sin(np.outer(time, 1.0 + 0.1 * np.arange(12))) + np.tile([0.0, 0.7, -1.4], 4),
        "tau": 8.0 * np.sin(np.outer(time, 1.3 + 0.07 * np.arange(12))),
        "place": np.column_stack([0.02 * np.sin(time), 0.01 * np.cos(time), 0.3 + 0.01 * np.sin(2.0 * time)]),
        "turn": turn.as_quat(),
        "gyro": rate,
        "accel": turn.inv().apply([0.0, 0.0, _G]),
        "flags": np.column_stack([np.where(lifted & (k == 0), 0.0, 1.0) for k in range(4)]),
    }


def _file(path: Path, data: dict[str, np.ndarray], names: tuple[str, ...], gravity: float = 1.0) -> Path:
    place, turn, gyro, accel, flag = names
    columns = {"t": data["time"]} | {f"pos_{j}": data["q"][:, k] for k, j in enumerate(_JOINTS)}
    columns |= {f"eff_{j}": data["tau"][:, k] for k, j in enumerate(_JOINTS) if "tau" in data}
    # A commanded pose and the base's speed are there too, as in many logs, and are neither.
    columns |= {f"des_base_pos_{axis}": data["place"][:, k] + 0.1 for k, axis in enumerate("xyz")}
    columns |= {f"base_lin_vel_{axis}": data["gyro"][:, k] for k, axis in enumerate("xyz")}
    columns |= {place.format(axis, n=k): data["place"][:, k] for k, axis in enumerate("xyz") if place}
    order = [3, 0, 1, 2]
    columns |= {turn.format(axis, n=k): data["turn"][:, order[k]] for k, axis in enumerate("wxyz") if turn}
    columns |= {gyro.format(axis, n=k): data["gyro"][:, k] for k, axis in enumerate("xyz") if gyro}
    columns |= {
        accel.format(axis, n=k): data["accel"][:, k] / gravity for k, axis in enumerate("xyz") if accel
    }
    columns |= {flag.format(leg, n=k): data["flags"][:, k] for k, leg in enumerate(LEGS) if flag}
    return table(path, columns)


@pytest.fixture(scope="module")
def toy(tmp_path_factory) -> Path:
    return write_quadruped(tmp_path_factory.mktemp("toy"))


@pytest.mark.parametrize("names", [_PLAIN, _ISAAC, _ODOM, _SHORT], ids=["plain", "isaac", "odom", "short"])
def test_pose_imu_and_contacts_are_known_by_their_names(names, toy, tmp_path):
    data = _stood()
    found = excite.convert([_file(tmp_path / "a.csv", data, names)], toy, tmp_path / "log", _WHOLE)
    header, trial = found.log.header, found.log.trials[0]
    assert header.base == "floating"
    assert [foot.name for foot in header.feet] == list(LEGS)
    np.testing.assert_allclose(trial.base[:, :3], data["place"], atol=1e-6)
    np.testing.assert_allclose(trial.base[:, 3:], data["turn"], atol=1e-5)
    np.testing.assert_allclose(trial.imu, np.column_stack([data["gyro"], data["accel"]]), atol=1e-4)
    np.testing.assert_array_equal(np.column_stack([trial.contacts[leg] for leg in LEGS]), data["flags"])


@pytest.mark.parametrize("gravity", [_G, _G / 1000.0])
def test_an_accelerometer_in_parts_of_gravity(gravity, toy, tmp_path):
    data = _stood()
    found = excite.convert([_file(tmp_path / "a.csv", data, _PLAIN, gravity)], toy, tmp_path / "log", _WHOLE)
    np.testing.assert_allclose(found.log.trials[0].imu[:, 3:], data["accel"], rtol=1e-4, atol=1e-3)


def test_an_imu_and_contacts_do_without_a_pose(toy, tmp_path):
    file = _file(tmp_path / "a.csv", _stood(), ("", "", *_PLAIN[2:]))
    found = excite.convert([file], toy, tmp_path / "log", _WHOLE)
    assert found.log.header.base == "floating"
    assert found.log.trials[0].base is None


def test_a_pose_alone_says_not_whether_a_robot_stands(toy, tmp_path):
    """Taken for one that hangs, a standing quadruped of 127 kg was said to weigh 1416 kg."""
    file = _file(tmp_path / "a.csv", _stood(), (*_PLAIN[:4], ""))
    with pytest.raises(UnclearError, match=r"which of its feet FL, FR, RL, RR carry .*contact\.FL: \"NAME\""):
        excite.convert([file], toy, tmp_path / "log", _WHOLE)
    hung = Map.model_validate({**_WHOLE.model_dump(by_alias=True), "log": {"base": "suspended"}})
    assert excite.convert([file], toy, tmp_path / "log", hung).log.header.base == "suspended"


def test_an_imu_without_contacts_and_torques_is_asked_for_them(toy, tmp_path):
    data = _stood()
    del data["tau"]
    file = _file(tmp_path / "a.csv", data, ("", "", *_PLAIN[2:4], ""))
    with pytest.raises(UnclearError, match=r"base: held.*contact\.FL: \"NAME\".*1 where a foot carries"):
        excite.convert([file], toy, tmp_path / "log", _WHOLE)


def test_a_map_that_names_no_foot_is_told_those_that_there_are(toy, tmp_path):
    file = _file(tmp_path / "a.csv", _stood(), _PLAIN)
    stated = Map(columns={"contact.front": "contact_FL"})
    with pytest.raises(
        UnclearError, match=r"contact\.front is of no foot of toy, whose feet are FL, FR, RL, RR"
    ):
        excite.convert([file], toy, tmp_path / "log", stated)


_WHOLE = Map.model_validate({"trials": {"split": "none", "validation": ["none"]}})


def test_the_map_beside_the_log_repeats_it(toy, tmp_path):
    file = _file(tmp_path / "a.csv", _stood(), _PLAIN, _G)
    first = excite.convert([file], toy, tmp_path / "log")
    again = excite.convert([file], toy, tmp_path / "again", first.folder / "map.yaml")
    assert again.log.header.base == "floating"
    for name in ("base", "imu", "q", "tau"):
        one, other = (getattr(found.log.trials[0], name) for found in (first, again))
        np.testing.assert_array_equal(one, other)


def test_contact_flags_beside_contact_wrenches_are_kept(tmp_path):
    """A log was written that could not be read: its flags were of feet that its header did not have."""
    robot = excite.load_robot("g1")
    feet, time = ("left_foot", "right_foot"), 0.005 * np.arange(400)
    columns = {"t": time} | {f"q_{name}": 0.1 * np.sin(time + k) for k, name in enumerate(robot.joint_names)}
    columns |= {f"base_pos_{axis}": 0.0 * time + (0.8 if axis == "z" else 0.0) for axis in "xyz"}
    columns |= {f"base_quat_{axis}": 0.0 * time + (axis == "w") for axis in "wxyz"}
    names = {
        f"wrench.{foot}.{axis}": f"{foot}_{axis}"
        for foot in feet
        for axis in ("fx", "fy", "fz", "tx", "ty", "tz")
    }
    columns |= {column: 0.0 * time + (160.0 if column.endswith("fz") else 0.0) for column in names.values()}
    columns |= {f"contact_{foot}": 0.0 * time + 1.0 for foot in feet}
    stated = Map.model_validate({**_WHOLE.model_dump(by_alias=True), "columns": names})
    found = excite.convert([table(tmp_path / "a.csv", columns)], "g1", tmp_path / "log", stated)
    assert {sensor.name for sensor in found.log.header.sensors} == set(feet)
    assert set(found.log.trials[0].contacts) == set(feet)


def _walked(toy: Path) -> dict[str, np.ndarray]:
    """The same trunk on three feet at a time, which bear it by pinocchio's Jacobians, whatever the joints do."""
    robot, data = excite.load_robot(toy), _stood()
    time, model = data["time"], excite.load_robot(toy).model
    lifted = (time / 0.3).astype(int) % 4
    rate, feet = data["gyro"], [model.getFrameId(f"{leg}_shank") for leg in LEGS]
    made = model.createData()
    q = np.hstack([data["place"] * 0.0, data["turn"], data["q"]])
    v, a = (np.hstack([np.zeros((len(time), 3)), *parts]) for parts in _motion(rate, data["q"], time))
    data["share"], data["tau"] = np.ones((len(time), 4)), np.zeros_like(data["q"])
    tips = [foot.centre for foot in robot.feet]
    for k in range(len(time)):
        forces = pin.rnea(model, made, q[k], v[k], a[k])
        pin.computeJointJacobians(model, made, q[k])
        pin.updateFramePlacements(model, made)
        maps = []
        for leg, (frame, tip) in enumerate(zip(feet, tips, strict=True)):
            if leg != lifted[k]:
                down = made.oMf[frame].rotation @ tip - [0.0, 0.0, 0.02]
                jacobian = pin.getFrameJacobian(model, made, frame, pin.LOCAL_WORLD_ALIGNED)
                maps.append((jacobian[:3] - pin.skew(down) @ jacobian[3:]).T)
        carried = np.linalg.lstsq(np.hstack(maps)[:6], forces[:6], rcond=None)[0]
        data["tau"][k] = (forces - np.hstack(maps) @ carried)[6:]
        data["share"][k] = (
            np.insert(np.linalg.norm(carried.reshape(3, 3), axis=1), lifted[k], 0.0) / robot.mass / _G
        )
    return data | {"flags": 1.0 * (data["share"] > 0.0)}


def _motion(rate: np.ndarray, q: np.ndarray, time: np.ndarray) -> tuple[tuple[np.ndarray, ...], ...]:
    speed = np.gradient(q, time, axis=0)
    return (rate, speed), (np.gradient(rate, time, axis=0), np.gradient(speed, time, axis=0))


_BARE = ("", "", "gyro_{}", "acc_{}", "")


@pytest.fixture(scope="module")
def walked(toy) -> dict[str, np.ndarray]:
    return _walked(toy)


def test_torques_tell_which_feet_carry(walked, toy, tmp_path):
    """Unitree's humanoids log no flags, and its quadrupeds' readings of feet are in no unit."""
    found = excite.convert([_file(tmp_path / "a.csv", walked, _BARE)], toy, tmp_path / "log", _WHOLE)
    assert found.log.header.base == "floating"
    assert any("the legs' torques press" in because for _, _, because in found.guesses)
    (trial,) = found.log.trials
    told = np.column_stack([trial.contacts[leg] for leg in LEGS])
    changes = np.abs(np.diff(walked["flags"], axis=0, prepend=1.0)).max(axis=1)
    sure = (walked["share"] > 0.15) | (walked["share"] == 0.0)
    sure &= (np.convolve(changes, np.ones(25), "same") == 0.0)[:, None]
    assert (told == walked["flags"])[sure].mean() > 0.98
    again = excite.convert([tmp_path / "a.csv"], toy, tmp_path / "again", found.folder / "map.yaml")
    np.testing.assert_array_equal(again.log.trials[0].contacts["FL"][:600], trial.contacts["FL"][:600])


def test_torques_of_a_robot_that_hangs_carry_nothing(walked, toy, tmp_path):
    hung = walked | {"tau": 0.1 * np.sign(walked["tau"])}
    file = _file(tmp_path / "a.csv", hung, _BARE)
    with pytest.raises(LogError, match=r"no foot of toy carries.*log: \{base: held\}.*base: suspended"):
        excite.convert([file], toy, tmp_path / "log", _WHOLE)
    for base in ({"base": "held"}, {"base": "suspended", "base_link": "trunk"}):
        stated = Map.model_validate({**_WHOLE.model_dump(by_alias=True), "log": base})
        assert excite.convert([file], toy, tmp_path / "log", stated).log.header.base == base["base"]


_SWAPPED = ("FR", "FL", "RR", "RL")
_OF_LEG = ("roll", "pitch", "knee")


@pytest.mark.parametrize(
    ("order", "flags"),
    [
        ([f"{leg}_{joint}" for leg in _SWAPPED for joint in _OF_LEG], ""),
        ([f"{leg}_{joint}" for leg in _SWAPPED for joint in _OF_LEG], "contact_{}"),
        ([f"{leg}_{joint}" for joint in _OF_LEG for leg in LEGS], ""),
        ([f"{leg}_{joint}" for joint in _OF_LEG for leg in _SWAPPED], "contact_{}"),
        (_JOINTS, ""),
    ],
    ids=["sides", "sides, flags", "hips first", "both, flags", "the model's"],
)
def test_legs_that_are_only_counted_are_those_that_carry(order, flags, walked, toy, tmp_path):
    """A weak drive of the left side was named at the right one."""
    which = [_JOINTS.index(joint) for joint in order]
    counted = walked | {name: walked[name][:, which] for name in ("q", "tau")}
    columns = {"t": counted["time"]} | {f"{n}_{k}": counted[n][:, k] for n in ("q", "tau") for k in range(12)}
    for name, key in (("gyro", "gyro"), ("acc", "accel")):
        columns |= {f"{name}_{axis}": counted[key][:, k] for k, axis in enumerate("xyz")}
    columns |= {flags.format(leg): counted["flags"][:, k] for k, leg in enumerate(LEGS) if flags}
    file, stated = table(tmp_path / "a.csv", columns), _WHOLE
    if order != _JOINTS:
        with pytest.raises(
            UnclearError, match=rf"counts? the legs from {order[0]}.*joints: \[{', '.join(order)}\]"
        ):
            excite.convert([file], toy, tmp_path / "log", stated)
        stated = Map.model_validate({**_WHOLE.model_dump(by_alias=True), "joints": order})
    found = excite.convert([file], toy, tmp_path / "log", stated)
    np.testing.assert_allclose(found.log.trials[0].q, walked["q"], atol=1e-5)
