"""A motion, a plan, a log or a diagnosis, moving: a page of it, alone or served to browsers until it is interrupted."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.atomic import write_text
from excite.diagnosis.answer.answer import Diagnosis
from excite.documents.document import model_of, read_document
from excite.documents.plan import PlanDocument
from excite.errors import InputError
from excite.export.export import robot_beside
from excite.logs.columns import BASE_POSE
from excite.logs.files import load_log
from excite.logs.log import Trial
from excite.logs.robot import nominal_robot, robot_for_log
from excite.motion.collection import load_motions, motion_paths
from excite.motion.files import load_motion, motion_robot
from excite.motion.motion import Motion
from excite.motion.readers.registry import is_motion
from excite.report.comparisons import Record, ReportData, load_report_data, read_record
from excite.report.html import html_paragraph, live_replay
from excite.report.page import html_page
from excite.report.replay.scene import TrialFrames, robot_scene, trial_frames
from excite.report.replay.tracks import motion_tracks, pack_table
from excite.robot.load import load_robot
from excite.robot.robot import Robot

# Ports that are tried from the one that was asked for.
_PORTS = 100
_HOW = (
    "Drag the picture to look from elsewhere. One cursor runs over all plots: a click takes the robot there, a drag "
    "along a plot zooms, a double click shows all of it again."
)


@dataclass(frozen=True, eq=False)
class Clip:
    """One motion or trial.

    Attributes:
        title: for reading.
        content: what the page's replay shows: time, configurations, a ghost, signals of each joint.
    """

    title: str
    content: dict[str, Any] = field(repr=False)


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


def page_text(thing: Thing) -> str:
    """The page, which needs neither a server's help nor a network."""
    tracks = {clip.title: clip.content for clip in thing.clips}
    still = html_paragraph(
        "Open this page in a browser that runs scripts and draws WebGL to see it move.", "lead"
    )
    shown = live_replay("view", robot_scene(thing.robot), tracks, still)
    title = thing.robot.description.title
    body = (
        f"<header><p>{escape(thing.title)}</p><h1>{escape(title)}</h1></header>"
        f'<main><section id="moving">{html_paragraph(_HOW, "lead moving")}{shown}</section></main>'
    )
    return html_page(thing.title, body)


def record_page(thing: Thing, path: Path) -> Path:
    """Write the page to an HTML file, which appears only when complete."""
    return write_text(Path(path), page_text(thing))


def serve(thing: Thing, port: int, ready: Callable[[str], None], *, seconds: float | None = None) -> None:
    """Serve the page to browsers of this machine.

    Args:
        thing: what is watched.
        port: where; the next free one where it is taken.
        ready: told the address once it is served.
        seconds: how long; None until it is interrupted.

    Raises:
        InputError: no port from there on is free.
    """
    page = page_text(thing).encode("utf-8")

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(page)))
            self.end_headers()
            self.wfile.write(page)

        def log_message(self, format: str, *args: Any) -> None:
            """Requests are nothing that a person is told."""

    server = _open_server(port, Handler)
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        ready(f"http://127.0.0.1:{server.server_port}")
        ends = None if seconds is None else time.monotonic() + seconds
        while ends is None or time.monotonic() < ends:
            time.sleep(0.1)
    finally:
        server.shutdown()
        server.server_close()


def _open_server(port: int, handler: type[BaseHTTPRequestHandler]) -> ThreadingHTTPServer:
    for one in range(port, min(port + _PORTS, 65536)):
        try:
            return ThreadingHTTPServer(("127.0.0.1", one), handler)
        except OSError:
            continue
    raise InputError(f"no port from {port} on is free", field="--port", remedy="name another")


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
    return Clip(f"{motion.name} · {motion.duration:.1f} s", motion_tracks(robot, motion).to_json())


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
    signals = []
    for title, unit, values in (("torque", "N·m", trial.tau), ("current", "A", trial.current)):
        if values is not None:
            columns = _joint_columns(record.robot, frames, trial.time, joints, values)
            signals.append({"title": title, "unit": unit, "label": "measured", "values": columns})
    return _build_clip(f"{trial.name} · {trial.role}", frames, signals)


def _joint_columns(
    robot: Robot, frames: TrialFrames, time: Array, names: tuple[str, ...], values: Array
) -> dict[str, Any]:
    """Signals ``(n, n_names)`` at the frames, a column a joint of the robot; NaN of joints that have none."""
    found = np.full((len(frames.time), robot.n_joints), np.nan)
    for i, name in enumerate(names):
        if name in robot.joint_names:
            found[:, robot.joint_index(name)] = np.interp(frames.time, time - time[0], values[:, i])
    return pack_table(found)


def _read_diagnosis(folder: Path, robot: str | None) -> Thing:
    document = read_document(
        folder / "diagnosis.json", model_of(Diagnosis), remedy="write it again with excite diagnose"
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
    clips = list(_simulated_clips(record, data, bool(document["effects"])))
    if not clips:
        clips = [_of_trial(record, record.trial(data.gap.trial if data.gap else ""))]
    return Thing(f"{folder.name}: {document['sentence'] or document['verdict']}", record.robot, tuple(clips))


def _residual_signals(robot: Robot, data: ReportData, frames: TrialFrames) -> Iterator[dict[str, Any]]:
    """What the model leaves of each joint's torque in the same trial, before and after the effects."""
    gap = data.gap
    if gap is None or gap.trial != frames.name or not set(gap.channels) & set(robot.joint_names):
        return
    left = (gap.measured - gap.nominal, gap.measured - gap.identified)
    before, after = (_joint_columns(robot, frames, gap.time, gap.channels, one) for one in left)
    title = "torque, measured less modelled"
    yield {
        **{"title": title, "unit": "N·m", "label": "as it was", "values": before},
        **{"other": after, "otherLabel": "with the effects"},
    }


def _simulated_clips(record: Record, data: ReportData, closed: bool) -> Iterator[Clip]:
    path = data.path
    if path is None or not set(path.joints) - set(BASE_POSE) <= set(record.robot.joint_names):
        return
    models = {"the simulator as it was": path.nominal}
    if closed:
        models["the simulator with the effects"] = path.identified
    for name, positions in models.items():
        frames = trial_frames(
            record.robot, path.trial, path.time, path.measured, path.joints, ghost=(name, positions)
        )
        signals = list(_residual_signals(record.robot, data, frames))
        yield _build_clip(f"{path.trial} · {name}", frames, signals)


def _build_clip(title: str, frames: TrialFrames, signals: list[dict[str, Any]]) -> Clip:
    content = frames.to_json()
    return Clip(title, {**content, "signals": [*content["signals"], *signals]})
