"""From recordings of a person to a log folder that identification reads as it does a robot's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from excite.errors import InputError
from excite.human.body import Body
from excite.human.plates.force_plates import PlateReading
from excite.human.posture.joint_angles import base_pose, joint_angles
from excite.human.posture.trial_poses import TrialPoses
from excite.human.segments import JOINT_NAMES
from excite.human.urdf import URDF_FILE, urdf_text
from excite.logs.header_blocks import Role, SensorHeader, TrialHeader
from excite.logs.log import Log, LogHeader, Trial
from excite.logs.signals.butterworth import settling_samples
from excite.rows.settings import ProblemSettings

_GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True, eq=False)
class MeasuredTrial:
    """A trial ready for the log.

    Attributes:
        name: of the trial.
        poses: postures of all frames.
        readings: plates at the same times.
        frames: which frames the plates carry.
        rate_hz: of the frames [Hz].
    """

    name: str
    poses: TrialPoses
    readings: tuple[PlateReading, ...]
    frames: slice
    rate_hz: float


def human_log(body: Body, trials: Sequence[MeasuredTrial], hold_out: float, cutoff_hz: float | None) -> Log:
    """The log of a person's trials.

    Of several trials the last one validates; a single one is cut in two, whose files overlap by what filters take
    away at either end, so that no row is used twice.

    Args:
        body: the person.
        trials: measured trials.
        hold_out: share of a single trial's time that validates, 0 for none.
        cutoff_hz: low-pass that markers and forces went through.

    Raises:
        InputError: rates differ, or the share is none.
    """
    if not 0.0 <= hold_out < 1.0:
        raise InputError(f"is {hold_out}", field="hold_out", remedy="choose a share of 0 to 0.9")
    rate = trials[0].rate_hz
    for trial in trials:
        if abs(trial.rate_hz / rate - 1.0) > 1e-3:
            raise InputError(
                f"runs at {trial.rate_hz:g} Hz, the first trial at {rate:g} Hz",
                source=trial.name,
                field="rate",
                remedy="make logs of each",
            )
    names = _sensor_names(trials)
    sensors: list[SensorHeader] = []
    parts: list[tuple[dict[str, Any], Role]] = []
    for number, trial in enumerate(trials):
        for reading in trial.readings:
            if all(names[number, reading.name] != sensor.name for sensor in sensors):
                sensors.append(_sensor_header(names[number, reading.name], reading))
    for number, trial in enumerate(trials):
        edge = settling_samples(rate, cutoff_hz) // 2 if cutoff_hz is not None else 0
        whole = _trial_channels(trial, number, names, [sensor.name for sensor in sensors], edge)
        if len(trials) > 1 or hold_out == 0.0:
            parts.append((whole, "validation" if number and number == len(trials) - 1 else "identification"))
        else:
            first, second = _cut_trial(whole, rate, hold_out, cutoff_hz)
            parts += [(first, "identification"), (second, "validation")]
    logged, headers = [], []
    for number, (part, role) in enumerate(parts):
        file = f"trial_{number:02d}.parquet"
        headers.append(TrialHeader(file=file, role=role))
        logged.append(Trial(**part, name=Path(file).stem, role=role))
    header = LogHeader.model_validate(
        {
            "schema": "excite.log/1",
            "robot": URDF_FILE,
            "base": "floating",
            "gravity": _GRAVITY,
            "rate_hz": round(rate, 6),
            "lowpass_hz": cutoff_hz,
            "posture": "computed",
            "joints": JOINT_NAMES,
            "torque": "none",
            "base_link": "pelvis",
            "wrench": "on_robot_in_sensor_frame",
            "sensors": sensors,
            "modelled": ("rigid_body",),
            "trials": headers,
        }
    )
    return Log(header=header, trials=tuple(logged), robot_text=urdf_text(body))


def _sensor_names(trials: Sequence[MeasuredTrial]) -> dict[tuple[int, str], str]:
    """One name for each plate that stands at one place; the same name elsewhere gets the trial's number."""
    places: dict[str, np.ndarray] = {}
    names = {}
    for number, trial in enumerate(trials):
        for reading in trial.readings:
            name = reading.name
            if name in places and np.abs(places[name] - reading.center).max() > 1e-6:
                name = f"{reading.name}_trial_{number}"
            places.setdefault(name, reading.center)
            names[number, reading.name] = name
    return names


def _sensor_header(name: str, reading: PlateReading) -> SensorHeader:
    x, y, z = (float(value) for value in reading.center)
    return SensorHeader(name=name, kind="force_plate", parent="world", xyz=(x, y, z), foot=reading.foot)


def _trial_channels(
    trial: MeasuredTrial,
    number: int,
    names: dict[tuple[int, str], str],
    sensors: list[str],
    edge: int,
) -> dict[str, Any]:
    """Channels of a trial; ``edge`` frames that the filter's transient reaches are left out at either end."""
    pose = trial.poses.pose
    n = len(pose)
    wrenches = {name: np.zeros((n, 6)) for name in sensors}
    for reading in trial.readings:
        wrenches[names[number, reading.name]] = reading.wrench
    span = slice(max(trial.frames.start, edge), min(trial.frames.stop, n - edge))
    return {
        "time": np.arange(n)[span] / trial.rate_hz + trial.poses.time[0],
        "q": joint_angles(pose)[span],
        "base": base_pose(pose)[span],
        "wrenches": {name: values[span] for name, values in wrenches.items()},
    }


def _cut_trial(
    whole: dict[str, Any], rate: float, hold_out: float, cutoff_hz: float | None
) -> tuple[dict[str, Any], dict[str, Any]]:
    filters = ProblemSettings().filters(floating=True, lowpass_hz=cutoff_hz)
    margin = settling_samples(rate, filters.kinematics_cutoff_hz) + settling_samples(rate, filters.cutoff_hz)
    n = len(whole["time"])
    middle = margin + round((1.0 - hold_out) * (n - 2 * margin))
    if n < 3 * margin:
        margin, middle = 0, round((1.0 - hold_out) * n)
    return _part_of(whole, slice(0, middle + margin)), _part_of(whole, slice(middle - margin, n))


def _part_of(whole: dict[str, Any], span: slice) -> dict[str, Any]:
    return {
        "time": whole["time"][span],
        "q": whole["q"][span],
        "base": whole["base"][span],
        "wrenches": {name: values[span] for name, values in whole["wrenches"].items()},
    }
