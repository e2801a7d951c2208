"""Recordings of real machines: where they are, how their columns read, and which part judges."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from excite.robot.catalogue import example_robot_data

Array = npt.NDArray[np.float64]
DATA = Path(os.environ.get("EXCITE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))

# One axis: 95 kg, force per volt as published (Janot, Gautier and Brunot, 2019).
_EMPS = """<robot name="emps"><link name="frame"/><link name="carriage"><inertial><mass value="95.1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axis" type="prismatic"><parent link="frame"/><child link="carriage"/><axis xyz="1 0 0"/>
<limit lower="-0.05" upper="0.3" effort="352" velocity="0.5"/></joint></robot>"""
_NEWTON_PER_VOLT = 35.15065188248547


@dataclass(frozen=True)
class Recording:
    """One recording at a fixed rate.

    Attributes:
        q: positions [rad, m], ``(n_samples, n_joints)``.
        tau: torques on the motion's side, as in the equation of motion [N·m, N], ``(n_samples, n_joints)``.
    """

    q: Array
    tau: Array


@dataclass(frozen=True)
class Machine:
    """A real machine.

    Attributes:
        name: of the machine.
        half: A or B; what is set by looking at one half is reported on the other.
        folder: of the recordings, in the data.
        model: file of the robot in the folder, or of example-robot-data; none: the one axis.
        joints: in the order of the columns.
        rate_hz: of the recordings.
        read: the recordings, from the folder; the last third of each judges.
        cutoff_hz: of the low-pass before least squares by hand [Hz].
        gravity: in the base's frame [m/s²].
        torque: side of the measured torques.
    """

    name: str
    half: str
    folder: str
    model: str
    joints: tuple[str, ...]
    rate_hz: float
    read: Callable[[Path], list[Recording]]
    cutoff_hz: float = 5.0
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    torque: str = "motor_side"

    @property
    def source(self) -> Path:
        """Folder of the recordings."""
        return DATA / self.folder

    def urdf(self, folder: Path) -> str:
        """Text of the robot's file, which stands in a folder of recordings or in a package."""
        if not self.model:
            return _EMPS
        kind, _, name = self.model.rpartition(":")
        return ((example_robot_data() if kind else folder) / name).read_text()


def _columns(path: Path) -> dict[str, Array]:
    with path.open() as file:
        names = next(csv.reader(file))
        values = np.loadtxt(file, delimiter=",", ndmin=2)
    return {name.strip(): values[:, k] for k, name in enumerate(names)}


def _table(
    files: tuple[str, ...],
    q: str,
    tau: str,
    numbers: range,
    rate_hz: float,
    folder: Path,
    *,
    scale: tuple[float, ...] | float = 1.0,
    time: str | None = None,
) -> list[Recording]:
    """Recordings from tables with a column a joint, by their numbers, put on even times."""
    made = []
    for name in files:
        columns = _columns(folder / name)
        angles = np.column_stack([columns[q.format(n)] for n in numbers])
        torques = np.column_stack([columns[tau.format(n)] for n in numbers]) * np.asarray(scale)
        if time is not None:
            t, first = np.unique(columns[time], return_index=True)
            even = np.arange(t[0], t[-1], 1.0 / rate_hz)
            angles, torques = (
                np.column_stack([np.interp(even, t, c) for c in x[first].T]) for x in (angles, torques)
            )
        made.append(Recording(angles, torques))
    return made


def _tiago(folder: Path) -> list[Recording]:
    """Arm joints 1 to 4; rows and torque per ampere as the authors have them."""
    q, i = (_columns(folder / f"tiago_{what}.csv") for what in ("position", "effort"))
    scale = 100.0 * np.array([0.136, 0.136, -0.087, -0.087])
    angles, currents = (
        np.column_stack([table[f"- arm_{n}_joint_{what}"] for n in range(1, 5)])[921:6791]
        for table, what in ((q, "position"), (i, "effort"))
    )
    return [Recording(angles, currents * scale)]


def _rokae(folder: Path) -> list[Recording]:
    q, tau = (np.loadtxt(folder / f"excit_{what}_record.txt") for what in ("ang", "torque"))
    return [Recording(q, tau)]


def _lwr(folder: Path) -> list[Recording]:
    runs = [np.load(folder / f"measurements_{k}.npz") for k in (1, 3)]
    return [Recording(run["positions"], run["torques"]) for run in runs]


def _tx40(folder: Path) -> list[Recording]:
    """Joint angles and torques by the coupling of the wrist, every tenth sample."""
    run = np.load(folder / "tx40_run.npz")
    red = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
    red[5, 4] = 32.0
    q, tau = run["motor_pos_rad"] @ np.linalg.inv(red).T, run["torque_motor_side"] @ red
    # Means of ten samples stand for the low-pass that thinning needs.
    n = len(q) // 10 * 10
    return [Recording(q[:n].reshape(-1, 10, 6).mean(axis=1), tau[:n].reshape(-1, 10, 6).mean(axis=1))]


def _numbered(pattern: str, n: int, first: int = 1) -> tuple[str, ...]:
    return tuple(pattern.format(k) for k in range(first, first + n))


_UR = tuple(
    f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
)
_UR_GAINS = (14.87, 13.26, 11.13, 10.62, 11.03, 11.47)
_UR_RUNS = ("identification/ur-20_02_12-40sec_12harm.csv", "identification/ur-20_02_12-50sec_12harm.csv")
_AIR_RUNS = ("vali_ga_N12T25.csv", "vali_opt.csv", "vali_ptrnSrch_N7T25QR-5.csv")


def _in_rad(files: tuple[str, ...], n: int, rate_hz: float) -> Callable[[Path], list[Recording]]:
    """Reader of tables of ``qN_rad`` and ``tauN_Nm``."""
    return partial(_table, files, "q{}_rad", "tau{}_Nm", range(1, n + 1), rate_hz, time="t_s")


_EMPS_FORCE = partial(
    _table, ("emps_train_t0_16s.csv",), "qm_meas_m", "vir_V", range(1), 1000.0, scale=_NEWTON_PER_VOLT
)
_UR_CURRENT = partial(_table, _UR_RUNS, "q{}_rad", "i{}_A", range(1, 7), 100.0, scale=_UR_GAINS, time="t_s")
_AR5_RUN = partial(_table, ("dynamics_identification_data_real.csv",), "q{}", "tau{}", range(7), 50.0)
# Torques are reactions.
_LBR_RUN = partial(_table, ("measurements.csv",), "q_{}", "tau_{}", range(7), 100.0, scale=-1.0)
_PANDA = "example:panda_description/urdf/panda.urdf"
_TIAGO = "example:tiago_description/robots/tiago.urdf"
_AR5_JOINTS = _numbered("AR5-5_07R-W4C4A2_joint_{}", 7)
_PANDA_RUN = _in_rad(("panda_exciting_traj1_t0_14s.csv",), 7, 1000.0)
_AIR_RUN = _in_rad(_AIR_RUNS, 6, 200.0)

MACHINES = (
    Machine("emps", "A", "emps_ballscrew_axis", "", ("axis",), 1000.0, _EMPS_FORCE, 20.0),
    Machine(
        "panda",
        "B",
        "franka_panda_gaz2019",
        _PANDA,
        _numbered("panda_joint{}", 7),
        1000.0,
        _PANDA_RUN,
        torque="link_side",
    ),
    Machine("ur10e", "A", "ur10e_dynamic_calibration", "ur10e.urdf", _UR, 100.0, _UR_CURRENT),
    Machine(
        "lwr", "B", "kuka_lwr4_flobaroid", "kuka_lwr4.urdf", _numbered("lwr_{}_joint", 7, 0), 200.0, _lwr
    ),
    Machine("tiago", "A", "tiago_arm_figaroh", _TIAGO, _numbered("arm_{}_joint", 4), 100.0, _tiago),
    Machine("airbot", "B", "airbot_play_multi_traj", "play.urdf", _numbered("joint{}", 6), 200.0, _AIR_RUN),
    Machine("xmate", "A", "rokae_xmate3pro", "rokae_xmate3pro.urdf", _numbered("joint{}", 7), 998.0, _rokae),
    Machine("ar5", "B", "rokae_ar5", "ar5.urdf", _AR5_JOINTS, 50.0, _AR5_RUN, gravity=(9.81, 0.0, 0.0)),
    Machine("lbr_med", "A", "kuka_lbr_med", "lbr_med.urdf", _numbered("A{}", 7), 100.0, _LBR_RUN),
    Machine(
        "tx40",
        "B",
        "staubli_tx40_figaroh",
        "tx40_mdh_modified.urdf",
        _numbered("joint_{}", 6),
        500.0,
        _tx40,
        20.0,
    ),
)
