"""Stäubli TX40 with a coupled wrist, as published with FIGAROH: motors' positions and torques at 5 kHz.

Nguyen, Sabbah, Bonnet, Lamiraux: FIGAROH, examples/staubli_TX40.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from excite.identification.judgement import ChannelFit
from excite.identification.problem import build_problem
from excite.identification.regression import condense_problem, iterate_weights
from excite.identification.statistics import base_statistics
from excite.logs.columns import read_columns
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, LogHeader
from excite.logs.robot import nominal_robot
from excite.logs.signals.coupling import coupling_matrix, joint_positions
from excite.rows.settings import ProblemSettings

TX40_JOINTS = tuple(f"joint_{i}" for i in range(1, 7))
GEAR_RATIOS = np.array([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
"""Turns of each motor per turn of its own joint."""
COUPLING = {"joint_6": {"joint_5": 1.0}}
"""Motor 6 turns by the sum of joints 5 and 6."""
ZEROS = np.array([0.0, -0.5 * np.pi, 0.5 * np.pi, 0.0, 0.0, 0.0])
"""Joint positions of the model where the controller's are zero, as the recording's authors state them [rad]."""


# Kinematics pass the 100 Hz of the recording's authors; rows the 20 Hz that their decimation by a hundred leaves.
SETTINGS = ProblemSettings(cutoff_hz=20.0, kinematics_cutoff_hz=100.0)

# What least squares by hand leaves of each torque's deviation at most, and the rank of its rows, on 7.4 s.
LARGEST_PERCENT = 13.0
RANK = 61


def tx40_log(data_dir: Path, folder: Path, split_s: float | None = None, *, coupled: bool = True) -> Log:
    """The 6 s of the recording as a log: joints' positions, motors' torques through their own gears.

    Args:
        data_dir: folder of the recordings.
        folder: where the log goes.
        split_s: what comes before trains and the rest judges [s]; None trains on all.
        coupled: whether the log says that the wrist is coupled.
    """
    source = data_dir / "staubli_tx40_figaroh"
    with np.load(source / "tx40_run.npz") as archive:
        time, motor, torque = (archive[name] for name in ("t_s", "motor_pos_rad", "torque_motor_side"))
    q = joint_positions(motor / GEAR_RATIOS, coupling_matrix(TX40_JOINTS, COUPLING)) + ZEROS
    columns = {"time": time}
    columns |= {f"q.{joint}": q[:, i] for i, joint in enumerate(TX40_JOINTS)}
    columns |= {f"tau.{joint}": GEAR_RATIOS[i] * torque[:, i] for i, joint in enumerate(TX40_JOINTS)}
    entries = [{"file": "first.parquet", "role": "identification"}]
    parts = [slice(None)]
    if split_s is not None:
        entries.append({"file": "rest.parquet", "role": "validation"})
        border = int(np.searchsorted(time, split_s))
        parts = [slice(None, border), slice(border, None)]
    header = {
        "schema": "excite.log/1",
        "robot": "tx40.urdf",
        "base": "fixed",
        "rate_hz": 5000,
        "joints": TX40_JOINTS,
        "torque": "motor_side",
        "coupling": COUPLING if coupled else {},
        "trials": entries,
    }
    checked = LogHeader.model_validate(header)
    trials = [
        read_columns(
            {name: values[part] for name, values in columns.items()}, entry, checked, folder / entry.file
        )
        for entry, part in zip(checked.trials, parts, strict=True)
    ]
    log = Log(checked, tuple(trials), robot_text=(source / "tx40_mdh_modified.urdf").read_text())
    return load_log(save_log(log, folder / "tx40"))


def percent_left(fits: Mapping[str, ChannelFit]) -> list[float]:
    """Root mean square of what is left of each torque, in percent of its deviation, both filtered alike."""
    return [100.0 * fit.rmse / fit.std for fit in fits.values()]


@dataclass(frozen=True)
class DriveParameter:
    """A parameter of the drives as its authors count it, published, and found here with a 95 % interval [SI]."""

    what: str
    published: float
    value: float
    half_width: float


def drive_parameters(data_dir: Path, log: Log) -> tuple[DriveParameter, ...]:
    """Friction and rotor inertia beside the published ones.

    There the wrist's motor 6 adds ``fvm6``, ``fsm6`` and ``Iam6`` to torques 5 and 6 at the other one's motion, and
    own terms of joints 5 and 6 contain its share; here it acts on the sum of both joints' motions.
    Rotor inertias of joints 1 and 2 go with those of the links.
    """
    published = yaml.safe_load((data_dir / "staubli_tx40_figaroh" / "T40X_config.yaml").read_text())
    stated = published["identification"]["robot_params"][0]
    rows = iterate_weights(condense_problem(build_problem(nominal_robot(log), log, SETTINGS)))
    statistics = base_statistics(rows)
    names = statistics.base.labels
    quantile = statistics.half_width() / statistics.std
    found = []

    def add(what: str, value: float | str, *terms: str) -> None:
        weights = np.array([float(name in terms) for name in names])
        assert weights.sum() == len(terms), what
        std = float(np.sqrt(weights @ statistics.covariance @ weights))
        half = std * float(quantile[weights > 0.0].max())
        # YAML 1.1 takes 8.05e0, without a sign, for text.
        found.append(DriveParameter(what, float(value), float(weights @ statistics.estimate), half))

    for number, joint in enumerate(TX40_JOINTS, start=1):
        # What the other motor adds to this joint's own terms.
        shared = {5: "joint_6", 6: "joint_6"}.get(number)
        own = f"joint_{{}}({joint})" if number == 6 else f"{{}}({joint})"
        for key, term, unit in (("fv", "viscous", "N·m·s/rad"), ("Ia", "armature", "kg·m²")):
            if key == "Ia" and number < 3:
                continue
            terms = [own.format(term)] + ([f"{term}({shared})"] if shared else [])
            add(f"{key}{number} [{unit}]", stated[key][number - 1], *terms)
        add(f"fs{number} [N·m]", stated["fs"][number - 1], own.format("coulomb"))
    for key, term, unit in (
        ("fvm6", "viscous", "N·m·s/rad"),
        ("fsm6", "coulomb", "N·m"),
        ("Iam6", "armature", "kg·m²"),
    ):
        add(f"{key} [{unit}]", stated[key], f"{term}(joint_6)")
    return tuple(found)
