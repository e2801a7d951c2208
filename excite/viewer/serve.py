"""Serves the stage to browsers until it is interrupted."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.atomic import write_text
from excite.errors import InputError, RobotError
from excite.report.html import html_paragraph, live_replay
from excite.report.page import html_page
from excite.report.replay.bodies import visible_bodies
from excite.report.replay.scene import robot_scene
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_model, geometry_data
from excite.viewer.source import Clip, Thing

if TYPE_CHECKING:
    import viser

# Of a browser's picture.
_FRAMES_HZ = 30.0


def serve(thing: Thing, port: int, ready: Callable[[str], None], *, seconds: float | None = None) -> None:
    """Show a thing in the browser.

    Args:
        thing: what is watched.
        port: where; the next free one where it is taken.
        ready: told the address once it is served.
        seconds: how long; None until it is interrupted.

    Raises:
        InputError: viser is not installed.
    """
    try:
        import viser
    except ImportError as error:
        raise InputError("excite view needs the package viser", remedy="pip install 'excite[viz]'") from error

    # viser says on stdout where it serves, which is where results stand.
    with redirect_stdout(sys.stderr):
        server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
        try:
            stage = Stage(server, thing)
            ready(f"http://127.0.0.1:{server.get_port()}")
            begun = before = time.monotonic()
            while seconds is None or before - begun < seconds:
                time.sleep(1.0 / _FRAMES_HZ)
                now = time.monotonic()
                stage.advance(now - before)
                before = now
        finally:
            server.stop()


# A robot on viser's stage: bodies, a ghost, what touches in red, sliders, plots of the joint that is clicked.

_BODY, _GHOST, _TOUCHING = (158, 172, 186), (213, 94, 0), (204, 41, 41)
_OPACITY = 0.35
# Of the scrubber [s].
_TIME_STEP = 0.01
# viser's field of view holds all bodies of a bundled robot at rest from 1.75 sizes away (an iiwa14; the others from
# 1.4 at most); moving limbs need about as much again.
_AWAY = 3.0


class Stage:
    """What is shown, and what the handles do. Every change goes through :meth:`show` or :meth:`pose`."""

    def __init__(self, server: viser.ViserServer, thing: Thing):
        """Put the robot on the stage and the handles beside it.

        Args:
            server: of viser.
            thing: what is watched.
        """
        # viser's own types say that the values of handles cannot be set, which its manual does throughout.
        self.server: Any = server
        self.thing, self.robot = thing, thing.robot
        self.clip: Clip = thing.clips[0]
        self.time = 0.0
        self.q: Array = self.clip.q[0]
        self.touching: frozenset[str] = frozenset()
        self.joint = ""
        self._lock = threading.RLock()
        self._setting = False
        self._data = self.robot.model.createData()
        server.scene.set_up_direction("+z")
        self._add_ground()
        self.frames, self.meshes = self._add_robot("robot", _BODY, None)
        self.ghost_frames, self.ghost_meshes = self._add_robot("ghost", _GHOST, _OPACITY)
        self._collisions = _collision_geometry(self.robot)
        self._add_handles()
        self.choose(self.clip.title)
        self._look()

    def _look(self) -> None:
        """From the front, a little from the left and from above, as far away as three times the robot's size."""
        places = np.array([place.translation for place in self._data.oMi][1:])
        centre = 0.5 * (places.min(axis=0) + places.max(axis=0))
        away = _AWAY * max(float(np.ptp(places, axis=0).max()), 0.2)
        camera = self.server.initial_camera
        camera.look_at = tuple(centre)
        camera.position = tuple(centre + away * np.array([0.77, 0.6, 0.22]))

    def _add_ground(self) -> None:
        table = self.robot.description.collision.table_height
        height = 0.0 if self.robot.floating or table is None else table
        self.server.scene.add_grid(
            "/ground", width=4.0, height=4.0, cell_size=0.25, position=(0.0, 0.0, height)
        )

    def _add_robot(self, name: str, color: tuple[int, int, int], opacity: float | None) -> tuple[list, list]:
        scene = self.server.scene
        frames = [
            scene.add_frame(f"/{name}/{joint}", show_axes=False) for joint in range(self.robot.model.njoints)
        ]
        meshes = []
        for i, body in enumerate(visible_bodies(self.robot)):
            mesh = scene.add_mesh_simple(
                f"/{name}/{body.joint}/{i}",
                body.corners.astype(np.float32),
                body.triangles.astype(np.uint32),
                color=color,
                opacity=opacity,
                flat_shading=True,
                side="double",
            )
            meshes.append((body, mesh))
            if opacity is None:
                mesh.on_click(self._clicked(body.joint))
        return frames, meshes

    def _clicked(self, joint: int) -> Callable[[Any], None]:
        return lambda _: self.select(self._name(joint))

    def _name(self, joint: int) -> str:
        """The actuated joint that moves a body, the first where the base carries it."""
        first = self.robot.n_joints - self.robot.model.njoints
        return self.robot.joint_names[max(0, joint + first)]

    def _add_handles(self) -> None:
        gui = self.server.gui
        gui.add_markdown(f"**{self.robot.description.title}**\n\n{self.thing.title}")
        self.choice = gui.add_dropdown("motion", [clip.title for clip in self.thing.clips])
        self.choice.on_update(lambda _: self.choose(str(self.choice.value)))
        self.scrubber = gui.add_slider("time [s]", 0.0, self._end(), _TIME_STEP, 0.0)
        self.scrubber.on_update(lambda _: self._scrubbed())
        self.playing = gui.add_checkbox("play", initial_value=False)
        self.said = gui.add_markdown("")
        limits, self.sliders = self.robot.limits, []
        with gui.add_folder("joints", expand_by_default=False):
            for i, name in enumerate(self.robot.joint_names):
                ends = (limits.position_lower[i], limits.position_upper[i])
                low, high = (float(end) for end in np.clip(ends, -2.0 * np.pi, 2.0 * np.pi))
                slider = gui.add_slider(name, low, high, 0.001, float(np.clip(self._joints()[i], low, high)))
                slider.on_update(lambda _: self._moved())
                self.sliders.append(slider)
        self.folder = gui.add_folder("joint that was clicked")
        self.plots: list[Any] = []

    def _end(self) -> float:
        """Where the scrubber ends [s]: with the clip."""
        return max(float(self.clip.time[-1]), _TIME_STEP)

    def _joints(self) -> Array:
        return np.asarray(self.q[self.robot.n_base_q :])

    def choose(self, title: str) -> None:
        """Show another motion or trial, from its start."""
        with self._lock:
            self.clip = next(clip for clip in self.thing.clips if clip.title == title)
            for _, mesh in self.ghost_meshes:
                mesh.visible = self.clip.ghost is not None
            self.scrubber.max = self._end()
            self.show(0.0)
            self.select(self.joint or self._widest())

    def _widest(self) -> str:
        """The joint in which robot and ghost differ most, or that moves farthest."""
        other = 0.0 if self.clip.ghost is None else self.clip.ghost[1]
        joints = (self.clip.q - other)[:, self.robot.n_base_q :]
        return self.robot.joint_names[int(np.ptp(joints, axis=0).argmax())]

    def show(self, time: float) -> None:
        """Put the robot, and the ghost, where they are at a time [s]."""
        with self._lock:
            clip = self.clip
            self.time = float(np.clip(time, 0.0, clip.time[-1]))
            self.pose(_configuration_at(self.robot, clip.time, clip.q, self.time))
            if clip.ghost is not None:
                self._place(
                    self.ghost_frames, _configuration_at(self.robot, clip.time, clip.ghost[1], self.time)
                )
            self._setting = True
            self.scrubber.value = self.time
            for slider, value in zip(self.sliders, self._joints(), strict=True):
                slider.value = float(np.clip(value, slider.min, slider.max))
            self._setting = False

    def pose(self, q: Array) -> None:
        """Put the robot into a configuration, ``(nq,)``; bodies nearer to each other than they may be turn red."""
        with self._lock:
            self.q = q
            self._place(self.frames, q)
            self.touching = self._near(q)
            for body, mesh in self.meshes:
                mesh.color = _TOUCHING if body.link in self.touching else _BODY
            names = ", ".join(sorted(self.touching))
            said = f"too near to each other: {names}" if names else "no two bodies too near"
            self.said.content = said if self._collisions is not None else "no geometry to tell what touches"

    def _near(self, q: Array) -> frozenset[str]:
        if self._collisions is None:
            return frozenset()
        geometry, found, required, links = self._collisions
        pin.updateGeometryPlacements(self.robot.model, self._data, geometry, found, q)
        pin.computeDistances(geometry, found)
        near = [i for i, result in enumerate(found.distanceResults) if result.min_distance < required]
        pairs = geometry.collisionPairs
        return frozenset(links[end] for i in near for end in (pairs[i].first, pairs[i].second))

    def _place(self, frames: list, q: Array) -> None:
        pin.forwardKinematics(self.robot.model, self._data, q)
        for frame, place in zip(frames, self._data.oMi, strict=True):
            x, y, z, w = pin.Quaternion(place.rotation).coeffs()
            frame.position, frame.wxyz = tuple(place.translation), (w, x, y, z)

    def select(self, joint: str) -> None:
        """Show what belongs to a joint: its residuals where there are any."""
        with self._lock:
            self.joint = joint
            for plot in self.plots:
                plot.remove()
            self.plots = []
            with self.folder:
                self.plots.append(self.server.gui.add_markdown(f"**{joint}**"))
                for curve in self.clip.curves.get(joint, ()):
                    colors = ("#0072b2", "#d55e00", "#009e73")
                    series = [{"label": "time"}] + [
                        {"label": label, "stroke": color, "width": 1.5}
                        for label, color in zip(curve.lines, colors, strict=False)
                    ]
                    data = (np.asarray(curve.time), *(np.asarray(line) for line in curve.lines.values()))
                    flat = {"x": {"time": False}}
                    plot = self.server.gui.add_uplot(
                        data, tuple(series), title=curve.title, scales=flat, aspect=1.8
                    )
                    self.plots.append(plot)

    def _scrubbed(self) -> None:
        if not self._setting:
            self.show(float(self.scrubber.value))

    def _moved(self) -> None:
        """A joint's slider was moved by hand."""
        if self._setting:
            return
        with self._lock:
            q = self.q.copy()
            q[self.robot.n_base_q :] = [slider.value for slider in self.sliders]
            self.playing.value = False
            self.pose(q)

    def advance(self, seconds: float) -> None:
        """Go on by so long while the box ``play`` is ticked; from the start again after the end."""
        if self.playing.value:
            end = float(self.clip.time[-1])
            self.show(self.time + seconds if self.time < end else 0.0)


def _configuration_at(robot: Robot, time: Array, q: Array, when: float) -> Array:
    """The configuration at a time, between two frames."""
    after = int(np.clip(np.searchsorted(time, when), 1, len(time) - 1))
    share = (when - time[after - 1]) / (time[after] - time[after - 1])
    return np.asarray(pin.interpolate(robot.model, q[after - 1], q[after], float(np.clip(share, 0.0, 1.0))))


def _collision_geometry(robot: Robot) -> tuple[pin.GeometryModel, pin.GeometryData, float, list[str]] | None:
    """Geometry, its data, the least distance [m], and each shape's link; None of a robot without geometry."""
    try:
        geometry = collision_model(robot)
    except RobotError:
        return None
    links = [item.name.rsplit("_", 1)[0] for item in geometry.geometryObjects]
    return geometry, geometry_data(geometry), float(robot.description.collision.margin), links


# What is watched, as one HTML file that needs neither a server nor a network.

_HOW = (
    "Drag the picture to look from elsewhere. One cursor runs over all plots: a click takes the robot there, a drag "
    "along a plot zooms, a double click shows all of it again."
)


def record_page(thing: Thing, path: Path) -> Path:
    """Write the page; appears only when complete.

    Args:
        thing: what is watched.
        path: the HTML file.
    """
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
    return write_text(Path(path), html_page(thing.title, body))
