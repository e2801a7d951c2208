"""What can be viewed, whatever it is: a motion, a plan, a log, a diagnosis, a trial of people."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.documents.diagnosis import Diagnosis
from excite.documents.document import read_document
from excite.documents.plan import PlanDocument
from excite.errors import InputError
from excite.export.resolve_robot import robot_beside
from excite.logs.columns import BASE_POSE
from excite.logs.files import load_log
from excite.logs.log import Trial
from excite.logs.robot import nominal_robot, robot_for_log
from excite.motion.collection import load_motions, motion_paths
from excite.motion.files import load_motion, motion_robot
from excite.motion.motion import Motion
from excite.motion.readers.registry import is_motion
from excite.report.comparisons import Record, ReportData, load_report_data, read_record
from excite.report.replay.scene import TrialFrames, trial_frames
from excite.report.replay.tracks import motion_tracks
from excite.robot.load import load_robot
from excite.robot.robot import Robot

# What is watched: configurations over time, and what belongs to each joint.


@dataclass(frozen=True, eq=False)
class Curve:
    """Signals of one joint.

    Attributes:
        title: with the unit.
        time: ``(n,)`` [s].
        lines: by what they are, ``(n,)`` each.
    """

    title: str
    time: Array
    lines: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Clip:
    """One motion or trial.

    Attributes:
        title: for reading.
        time: ``(n,)`` [s], from zero.
        q: configurations, ``(n, nq)``.
        ghost: what the other robot is, and its configurations, ``(n, nq)``; None without one.
        curves: by joint, what is shown of it when it is clicked: its residuals where there are any.
        content: the same as a page's replay has it.
    """

    title: str
    time: Array
    q: Array
    ghost: tuple[str, Array] | None
    curves: Mapping[str, tuple[Curve, ...]]
    content: dict[str, Any] = field(repr=False)


# Reads what is to be watched, whatever it is: a motion, a plan, a log, a diagnosis.


@dataclass(frozen=True, eq=False)
class Thing:
    """What is to be watched.

    Attributes:
        title: for reading.
        robot: that moves.
        clips: its motions or trials, at least one.
    """

    title: str
    robot: Robot
    clips: tuple[Clip, ...]


def read_thing(path: Path, robot: str | None = None) -> Thing:
    """Read a motion file, a folder of motions, a plan's folder, a log folder, or a diagnosis' folder or document.

    Args:
        path: of it.
        robot: the robot, where the files do not say or it lies elsewhere.

    Raises:
        InputError: nothing of the kind is there, or it does not say whose it is.
        RobotError: the robot's model is malformed.
    """
    path = Path(path)
    if path.name == "diagnosis.json" or (path / "diagnosis.json").exists():
        return _read_diagnosis(path if path.is_dir() else path.parent, robot)
    if path.name == "log.yaml" or (path / "log.yaml").exists():
        return _read_log(path if path.is_dir() else path.parent, robot)
    if path.name == "plan.json" or (path / "plan.json").exists():
        return _read_plan(path if path.is_dir() else path.parent, robot)
    if not os.path.lexists(path):
        raise InputError(
            "is not there", source=path, remedy="give a motion, or the folder of a plan, log or diagnosis"
        )
    return _read_motions(path, robot)


def _read_motions(path: Path, robot: str | None) -> Thing:
    if path.is_dir() and not is_motion(path) and not _holds_motions(path):
        raise InputError(
            "holds no motion, plan, log or diagnosis",
            source=path,
            remedy="give a folder that excite plan, export, simulate, convert or diagnose wrote with --out",
        )
    name = robot or _robot_name(path)
    if not name:
        raise InputError(
            "does not say which robot it is for", source=path, remedy="name it with --robot ROBOT"
        )
    loaded = load_robot(name)
    motions = load_motions([path], loaded)
    return Thing(path.name, loaded, tuple(_of_motion(loaded, motion) for motion in motions))


def _robot_name(path: Path) -> str:
    """The robot that motions are for, if all say the same: bundled, or kept beside their plan; empty for none."""
    names = {robot_beside(file, motion_robot(file)) for file in motion_paths([path])}
    return names.pop() if len(names) == 1 else ""


def _holds_motions(folder: Path) -> bool:
    """Whether there are files of motions in a folder, or in ``motions/`` in it."""
    try:
        return bool(motion_paths([folder]))
    except InputError:
        return False


def _read_plan(folder: Path, robot: str | None) -> Thing:
    plan = read_document(folder / "plan.json", PlanDocument, remedy="write it again with excite plan")
    loaded = load_robot(robot or (str(folder / plan.robot_file) if plan.robot_file else plan.robot))
    motions = [load_motion(folder / entry.motion, loaded) for entry in plan.selected]
    if not motions:
        raise InputError(
            "holds no chosen motion", source=folder / "plan.json", remedy="plan with more candidates"
        )
    return Thing(
        f"{folder.name}: plan of {plan.robot}", loaded, tuple(_of_motion(loaded, m) for m in motions)
    )


def _of_motion(robot: Robot, motion: Motion) -> Clip:
    shown = motion_tracks(robot, motion)
    time = shown.motion.time - shown.motion.time[0]
    q, v = shown.motion.joint_positions(), shown.motion.joint_velocities()
    curves = {
        name: (
            Curve("position [rad]", time, {"position": q[:, i]}),
            Curve("velocity [rad/s]", time, {"velocity": v[:, i]}),
            Curve("torque [N·m]", time, {"torque": shown.torque[:, i]}),
        )
        for i, name in enumerate(robot.joint_names)
    }
    return Clip(
        f"{motion.name} · {motion.duration:.1f} s", time, shown.motion.q, None, curves, shown.to_json()
    )


def _read_log(folder: Path, robot: str | None) -> Thing:
    log = load_log(folder)
    loaded = nominal_robot(log) if robot is None else robot_for_log(robot, folder)
    record = Record(loaded, log)
    return Thing(
        f"{folder.name}: log of {loaded.name}", loaded, tuple(_of_trial(record, t) for t in log.trials)
    )


def _of_trial(record: Record, trial: Trial) -> Clip:
    joints = tuple(record.log.header.joints)
    ghost = None if trial.q_cmd is None else ("commanded", trial.q_cmd)
    frames = trial_frames(record.robot, trial.name, trial.time, trial.q, joints, base=trial.base, ghost=ghost)
    curves = dict(_of_joints(joints, trial))
    return _build_clip(f"{trial.name} · {trial.role}", frames, curves)


def _of_joints(joints: tuple[str, ...], trial: Trial) -> Iterator[tuple[str, tuple[Curve, ...]]]:
    """What was recorded of each joint, its tracking error first."""
    time = trial.time - trial.time[0]
    for i, name in enumerate(joints):
        curves = []
        if trial.q_cmd is not None:
            error = trial.q[:, i] - trial.q_cmd[:, i]
            curves.append(Curve("measured less commanded [rad]", time, {"error": error}))
        curves.append(Curve("position [rad]", time, {"measured": trial.q[:, i]}))
        if trial.tau is not None:
            curves.append(Curve("torque [N·m]", time, {"measured": trial.tau[:, i]}))
        elif trial.current is not None:
            curves.append(Curve("current [A]", time, {"measured": trial.current[:, i]}))
        yield name, tuple(curves)


def _read_diagnosis(folder: Path, robot: str | None) -> Thing:
    document = read_document(
        folder / "diagnosis.json", Diagnosis, remedy="write it again with excite diagnose"
    ).content()
    if robot is not None:
        document["robot_file"] = (
            os.path.relpath(robot, folder) if os.path.exists(robot) else document["robot_file"]
        )
    record = read_record(folder, document)
    if not isinstance(record, Record):
        why = record or "it names no log; write it again with excite diagnose LOG --out DIR"
        raise InputError(f"shows no robot: {why}", source=folder / "diagnosis.json")
    data = (
        load_report_data(folder / "report_data.npz")
        if (folder / "report_data.npz").exists()
        else ReportData()
    )
    curves = dict(_residual_curves(data))
    clips = list(_simulated_clips(record, data, bool(document["effects"]), curves))
    if not clips:
        trial = record.trial(data.gap.trial if data.gap else "")
        clip = _of_trial(record, trial)
        clips = [Clip(clip.title, clip.time, clip.q, clip.ghost, {**clip.curves, **curves}, clip.content)]
    return Thing(f"{folder.name}: {document['sentence'] or document['verdict']}", record.robot, tuple(clips))


def _residual_curves(data: ReportData) -> Iterator[tuple[str, tuple[Curve, ...]]]:
    """By joint, what the model leaves of its reading, before and after the effects."""
    gap = data.gap
    if gap is None:
        return
    for i, name in enumerate(gap.channels):
        unit, measured = gap.units[i], gap.measured[:, i]
        time = gap.time - gap.time[0]
        left = {
            "as it was": measured - gap.nominal[:, i],
            "with the effects": measured - gap.identified[:, i],
        }
        both = {"measured": measured, "model": gap.nominal[:, i]}
        title = f"measured less modelled [{unit}], trial {gap.trial}"
        yield name, (Curve(title, time, left), Curve(f"reading [{unit}]", time, both))


def _simulated_clips(
    record: Record, data: ReportData, closed: bool, curves: dict[str, Any]
) -> Iterator[Clip]:
    path = data.path
    if path is None or not set(path.joints) - set(BASE_POSE) <= set(record.robot.joint_names):
        return
    models = {"the simulator as it was": path.nominal}
    if closed:
        models["the simulator with the effects"] = path.identified
    time = path.time - path.time[0]
    for name, positions in models.items():
        frames = trial_frames(
            record.robot, path.trial, path.time, path.measured, path.joints, ghost=(name, positions)
        )
        apart = {
            joint: (
                *curves.get(joint, ()),
                Curve(
                    f"{name} less measured [rad]", time, {"difference": positions[:, i] - path.measured[:, i]}
                ),
            )
            for i, joint in enumerate(path.joints)
            if joint not in BASE_POSE
        }
        yield _build_clip(f"{path.trial} · {name}", frames, apart)


def _build_clip(title: str, frames: TrialFrames, curves: dict[str, tuple[Curve, ...]]) -> Clip:
    return Clip(title, np.asarray(frames.time), frames.q, frames.ghost, curves, frames.to_json())
