"""A motion, a plan, a log or a diagnosis, moving: a page of it, alone or served to browsers until it is interrupted."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

from excite.atomic import write_text
from excite.diagnosis.answer.answer import Diagnosis
from excite.documents.document import model_of, read_document
from excite.documents.plan import PlanDocument
from excite.errors import InputError
from excite.export.export import robot_beside
from excite.logs.files import load_log
from excite.logs.robot import nominal_robot, robot_for_log
from excite.motion.collection import load_motions, motion_paths
from excite.motion.files import load_motion, motion_robot
from excite.motion.motion import Motion
from excite.motion.readers.registry import is_motion
from excite.report.comparisons import Record, ReportData, load_report_data, read_record
from excite.report.html import html_paragraph, live_replay
from excite.report.page import html_page
from excite.report.replay.scene import robot_scene
from excite.report.replay.tracks import motion_tracks
from excite.report.sections.motions import HOW_TO_WATCH, motion_title, recorded_track, trial_tracks
from excite.robot.load import load_robot
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Thing:
    """What is to be watched.

    Attributes:
        title: for reading.
        robot: that moves.
        clips: its motions or trials by title, at least one: time, configurations, a ghost, signals of each joint.
    """

    title: str
    robot: Robot
    clips: Mapping[str, dict[str, Any]]


def page_text(thing: Thing) -> str:
    """The page, which needs neither a server's help nor a network."""
    still = html_paragraph(
        "Open this page in a browser that runs scripts and draws WebGL to see it move.", "lead"
    )
    shown = live_replay("view", robot_scene(thing.robot), thing.clips, still)
    title = thing.robot.description.title
    body = (
        f"<header><p>{escape(thing.title)}</p><h1>{escape(title)}</h1></header>"
        f'<main><section id="moving">{html_paragraph(HOW_TO_WATCH, "lead moving")}{shown}</section></main>'
    )
    return html_page(thing.title, body)


def record_page(thing: Thing, path: Path) -> Path:
    """Write the page to an HTML file, which appears only when complete."""
    return write_text(Path(path), page_text(thing))


def serve_page(
    thing: Thing, port: int, ready: Callable[[str], None], *, seconds: float | None = None
) -> None:
    """Serve the page to browsers of this machine.

    Args:
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
    # Ports that are tried from the one that was asked for.
    for one in range(port, min(port + 100, 65536)):
        try:
            return ThreadingHTTPServer(("127.0.0.1", one), handler)
        except OSError:
            continue
    raise InputError(f"no port from {port} on is free", field="--port", remedy="name another")


def read_thing(path: Path, robot: str | None = None) -> Thing:
    """Read a motion file, a folder of motions, a plan's folder, a log folder, or a diagnosis' folder or document.

    Args:
        robot: the robot, where the files do not say or it lies elsewhere.

    Raises:
        InputError: nothing of the kind is there, or it does not say whose it is.
        RobotError: the robot's model is malformed.
    """
    path = Path(path)
    readers = {"diagnosis.json": _read_diagnosis, "log.yaml": _read_log, "plan.json": _read_plan}
    for name, read in readers.items():
        if path.name == name or (path / name).exists():
            return read(path if path.is_dir() else path.parent, robot)
    if not os.path.lexists(path):
        remedy = "give a motion, or the folder of a plan, log or diagnosis"
        raise InputError("is not there", source=path, remedy=remedy)
    return _read_motions(path, robot)


def _read_motions(path: Path, robot: str | None) -> Thing:
    files = []
    with suppress(InputError) if path.is_dir() else nullcontext():
        files = list(motion_paths([path]))
    if not files and not is_motion(path):
        raise InputError(
            "holds no motion, plan, log or diagnosis",
            source=path,
            remedy="give a folder that excite plan, export, simulate, convert or diagnose wrote with --out",
        )
    # The robot that motions are for, if all say the same: bundled, or kept beside their plan.
    names = {robot} if robot else {robot_beside(file, motion_robot(file)) for file in files}
    name = names.pop() if len(names) == 1 else ""
    if not name:
        raise InputError(
            "does not say which robot it is for", source=path, remedy="name it with --robot ROBOT"
        )
    loaded = load_robot(name)
    return _of_motions(path.name, loaded, load_motions([path], loaded))


def _read_plan(folder: Path, robot: str | None) -> Thing:
    file = folder / "plan.json"
    plan = read_document(file, PlanDocument, remedy="write it again with excite plan")
    if not plan.selected:
        raise InputError("holds no chosen motion", source=file, remedy="plan with more candidates")
    loaded = load_robot(robot or (str(folder / plan.robot_file) if plan.robot_file else plan.robot))
    motions = [load_motion(folder / entry.motion, loaded) for entry in plan.selected]
    return _of_motions(f"{folder.name}: plan of {plan.robot}", loaded, motions)


def _of_motions(title: str, robot: Robot, motions: Iterable[Motion]) -> Thing:
    return Thing(title, robot, {motion_title(one): motion_tracks(robot, one).to_json() for one in motions})


def _read_log(folder: Path, robot: str | None) -> Thing:
    log = load_log(folder)
    record = Record(nominal_robot(log) if robot is None else robot_for_log(robot, folder), log)
    clips = [recorded_track(record, trial) for trial in log.trials]
    title = f"{folder.name}: log of {record.robot.name}"
    return Thing(title, record.robot, {name: clip for one in clips for name, clip in one.items()})


def _read_diagnosis(folder: Path, robot: str | None) -> Thing:
    file, arrays, again = (
        folder / "diagnosis.json",
        folder / "report_data.npz",
        "write it again with excite diagnose",
    )
    document = read_document(file, model_of(Diagnosis), remedy=again).content()
    if robot is not None and os.path.exists(robot):
        document["robot_file"] = os.path.relpath(robot, folder)
    record = read_record(folder, document)
    if not isinstance(record, Record):
        why = record or f"it names no log; {again} LOG --out DIR"
        raise InputError(f"shows no robot: {why}", source=file)
    data = load_report_data(arrays) if arrays.exists() else ReportData()
    title = f"{folder.name}: {document['sentence'] or document['verdict']}"
    return Thing(title, record.robot, trial_tracks(record, data, document))
