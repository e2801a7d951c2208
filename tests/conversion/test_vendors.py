"""Exports of vendors' drivers and of simulators, and this toolkit's own, with all that stands beside what is needed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import excite
from excite.robot.catalogue import data_folder
from tests.conversion import written
from tests.conversion.test_messages import swing
from tests.conversion.written import JOINTS, WHOLE

pytestmark = pytest.mark.usefixtures("readers_here", "unexamined")

UR_POSE = np.array([0.0, -1.2, 1.5, -1.5, -1.5, 0.0])
PANDA_POSE = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.8, 0.5])


def save(file: Path, columns: dict[str, np.ndarray], separator: str) -> Path:
    rows = np.column_stack(list(columns.values()))
    np.savetxt(file, rows, delimiter=separator, header=separator.join(columns), comments="", fmt="%.9g")
    return file


def test_recorded_rtde_fields(tmp_path):
    """All that the RTDE client's ``record.py`` writes of a UR; amperes are the only measured effort."""
    data = swing(6, n=400, middle=UR_POSE)
    still = np.zeros((400, 6))
    fields = {
        "target_q": data["q_cmd"], "target_qd": data["v"], "target_qdd": np.gradient(data["v"], 0.01, axis=0),
        "target_current": data["tau"] / 9.0, "target_moment": data["tau"], "actual_q": data["q"],
        "actual_qd": data["v"], "actual_current": data["tau"] / 10.0, "joint_control_output": data["tau"] / 11.0,
        "actual_TCP_pose": data["q"], "actual_TCP_speed": data["v"], "actual_TCP_force": data["tau"],
        "joint_temperatures": 30.0 + still, "actual_joint_voltage": 48.0 + 0.1 * np.sin(data["q"]),
        "joint_mode": 253.0 + still,
    }  # fmt: skip
    columns = {"timestamp": 1000.0 + data["time"]}
    columns |= {f"{name}_{k}": values[:, k] for name, values in fields.items() for k in range(6)}
    columns |= {"robot_mode": still[:, 0] + 7.0, "output_int_register_0": np.arange(400.0)}
    log = excite.convert([save(tmp_path / "ur.csv", columns, " ")], "ur10", tmp_path / "log", WHOLE).log
    assert log.header.torque == "current"
    trial = log.trials[0]
    expected = {"q": "actual_q", "v": "actual_qd", "current": "actual_current", "q_cmd": "target_q",
                "tau_cmd": "target_moment"}  # fmt: skip
    for attribute, name in expected.items():
        np.testing.assert_allclose(getattr(trial, attribute), fields[name], atol=1e-6)


def test_a_franka_state_as_a_table(tmp_path):
    """Fields of libfranka's RobotState, times in ms; external torques are no joint torques."""
    data = swing(7, n=400, middle=PANDA_POSE)
    fields = {
        "q": data["q"], "q_d": data["q_cmd"], "dq": data["v"], "dq_d": data["v"], "tau_J": data["tau"],
        "tau_J_d": 0.9 * data["tau"], "dtau_J": np.gradient(data["tau"], 0.01, axis=0),
        "tau_ext_hat_filtered": 0.1 * data["tau"], "K_F_ext_hat_K": np.zeros((400, 6)),
        "O_T_EE": np.tile(np.eye(4).ravel(), (400, 1)),
    }  # fmt: skip
    columns = {"time": 1000.0 * data["time"]}
    columns |= {f"{n}[{k}]": values[:, k] for n, values in fields.items() for k in range(values.shape[1])}
    found = excite.convert([save(tmp_path / "franka.csv", columns, ",")], "panda", tmp_path / "log", WHOLE)
    trial = found.log.trials[0]
    assert found.columns["time"] == ("time", 1e-3)
    for attribute, name in {"q": "q", "v": "dq", "tau": "tau_J", "q_cmd": "q_d"}.items():
        np.testing.assert_allclose(getattr(trial, attribute), fields[name], atol=1e-6)


def simulated() -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names and rows of MuJoCo's sensors of an arm, and its full physics states."""
    import mujoco

    inner = "".join(
        f'<body pos="0.3 0 0"><joint name="{joint}" axis="{"0 0 1" if k % 2 else "0 1 0"}" armature="0.1"/>'
        '<geom size=".05" mass="1" pos=".1 0 0"/>'
        for k, joint in enumerate(JOINTS)
    )
    drives = "".join(f'<position name="a_{joint}" joint="{joint}" kp="50" kv="5"/>' for joint in JOINTS)
    kinds = (("jointpos", "joint", ""), ("jointvel", "joint", ""), ("actuatorfrc", "actuator", "a_"))
    sensors = "".join(
        f'<{kind} name="{kind}_{joint}" {where}="{prefix}{joint}"/>'
        for kind, where, prefix in kinds
        for joint in JOINTS
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="0.01" integrator="implicitfast"/><worldbody>{inner}{"</body>" * 3}</worldbody>'
        f"<actuator>{drives}</actuator><sensor>{sensors}</sensor></mujoco>"
    )
    data, whole = mujoco.MjData(model), mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, whole))
    rows, states = [], []
    for target in written.motion()["q"]:
        data.ctrl[:] = target
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        mujoco.mj_getState(model, data, state, whole)
        rows.append(data.sensordata.copy())
        states.append(state.copy())
    return [model.sensor(i).name for i in range(model.nsensor)], np.array(rows), np.array(states)


def sensors_by_name(file: Path, names: list[str], rows: np.ndarray, states: np.ndarray) -> Path:
    np.savez(file.with_suffix(".npz"), time=states[:, 0], **dict(zip(names, rows.T, strict=True)))
    return file.with_suffix(".npz")


def sensors_in_a_row(file: Path, names: list[str], rows: np.ndarray, states: np.ndarray) -> Path:
    np.savez(file.with_suffix(".npz"), time=states[:, 0], sensordata=rows)
    return file.with_suffix(".npz")


def full_states(file: Path, names: list[str], rows: np.ndarray, states: np.ndarray) -> Path:
    np.save(file.with_suffix(".npy"), states)
    return file.with_suffix(".npy")


def joint_by_joint(channel: str, name: str, first: int) -> dict[str, str]:
    return {f"{channel}.{joint}": f"{name}[{first + k}]" for k, joint in enumerate(JOINTS)}


# Columns without names are asked about; by form, what a map says of them.
NAMELESS = {
    sensors_in_a_row: {"time": "time"}
    | joint_by_joint("q", "sensordata", 0)
    | joint_by_joint("v", "sensordata", 3)
    | joint_by_joint("tau", "sensordata", 6),
    full_states: {"time": "run[0]"} | joint_by_joint("q", "run", 1) | joint_by_joint("v", "run", 4),
}


@pytest.mark.parametrize("write", [sensors_by_name, sensors_in_a_row, full_states])
def test_what_mujoco_measures(write: Callable[..., Path], tmp_path):
    names, rows, states = simulated()
    source, urdf = write(tmp_path / "run", names, rows, states), written.arm_urdf(tmp_path / "arm.urdf")
    stated = WHOLE
    if write in NAMELESS:
        with pytest.raises(excite.ExciteError, match="no columns of joint positions"):
            excite.convert([source], urdf, tmp_path / "log", WHOLE)
        stated = WHOLE.model_copy(update={"columns": NAMELESS[write]})
    trial = excite.convert([source], urdf, tmp_path / "log", stated).log.trials[0]
    np.testing.assert_allclose(trial.time - trial.time[0], states[:, 0] - states[0, 0], atol=1e-9)
    np.testing.assert_allclose(trial.q, states[:, 1:4], atol=1e-9)
    np.testing.assert_allclose(trial.v, states[:, 4:7], atol=1e-9)
    if write is not full_states:
        np.testing.assert_allclose(trial.tau, rows[:, 6:], atol=1e-9)


@pytest.mark.parametrize("form", ["csv", "npz", "ros2"])
def test_our_own_exports(form, tmp_path):
    robot = excite.load_robot("ur10")
    file = sorted((data_folder("motion_library") / "ur10").rglob("*.parquet"))[0]
    motion = excite.load_motion(file, robot)
    excite.export_motions([file], form, out=tmp_path / "out")
    trial = excite.convert([tmp_path / "out"], "ur10", tmp_path / "log", WHOLE).log.trials[0]
    at = np.interp(trial.time - trial.time[0], motion.time - motion.time[0], motion.joint_positions()[:, 1])
    np.testing.assert_allclose(trial.q[:, 1], at, atol=1e-6)


def test_what_kuka_records_as_measured(tmp_path):
    """Sunrise's DataRecorder: Msr is what was measured, Cmd was asked for, two columns are one clock."""
    data = swing(7, n=400, middle=PANDA_POSE)
    ns = np.round(1e9 * data["time"]).astype(int)
    columns = {"ZeitInSec": 1.6e8 + ns // 10**9, "ZeitInNanoSec": ns % 10**9}
    fields = {"QMsr": "q", "QCmd": "q_cmd", "TauMsr": "tau", "TauExtMsr": "v"}
    for field, name in fields.items():
        columns |= {f"axis{field}_LBR_iiwa_7_R800_1_A{k + 1}": data[name][:, k] for k in range(7)}
    file = save(tmp_path / "run.log", columns, " ")
    trial = excite.convert([file], "panda", tmp_path / "log", WHOLE).log.trials[0]
    for attribute in ("q", "q_cmd", "tau"):
        np.testing.assert_allclose(getattr(trial, attribute), data[attribute], atol=1e-6)


HUGE = (
    b"\x93NUMPY\x01\x00F\x00"
    + b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 7), }".ljust(69)
    + b"\n"
)


@pytest.mark.parametrize("content", [HUGE, b"junk"])
def test_an_array_that_promises_too_much_is_one_line(content, tmp_path):
    (tmp_path / "run.npy").write_bytes(content)
    with pytest.raises(excite.ExciteError, match="cannot be read as a numpy array"):
        excite.convert([tmp_path / "run.npy"], "ur10", tmp_path / "log")
