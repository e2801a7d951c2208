"""From a motion to the file that a robot's controller runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from excite.atomic import all_or_nothing
from excite.errors import InputError, MotionError, OtherRobotError, UnsafeMotionError
from excite.export.clearance import Cleared, clear_motions
from excite.export.exporter import Exporter
from excite.export.registry import EXPORTERS
from excite.formats.file import PathsLike, as_paths
from excite.motion.collection import motion_paths
from excite.motion.files import load_motion, motion_robot
from excite.motion.motion import Motion
from excite.results import ADDED, HIDDEN, FilePath, Name, Stated, stated, write_json
from excite.robot.catalogue import bundled_robots
from excite.robot.description import read_description
from excite.robot.load import RobotLike, as_robot, load_robot
from excite.robot.robot import Robot
from excite.safety.verdict import Margins, Verdict, Violation


@dataclass(frozen=True, eq=False)
class Exported(Stated):
    """A motion that left, and what it carries.

    Attributes:
        path: the file, or the folder of a bag.
        file: the same, relative to --out, or to the working folder.
        cleared: the motion as written, and its verdict.
    """

    path: Path = field(metadata=HIDDEN)
    file: FilePath
    cleared: Cleared = field(metadata=HIDDEN)

    @property
    @stated
    def motion(self) -> Name:
        """Name of the motion."""
        return self.cleared.motion.name

    @property
    @stated
    def robot(self) -> Name:
        """Name of its robot."""
        return self.cleared.motion.robot

    @property
    @stated
    def verdict(self) -> Mapping[str, Any] | None:
        """What the independent check said of it, and why it was written all the same where it is not safe."""
        return self.cleared.motion.metadata.verdict


@dataclass(frozen=True, eq=False)
class ExportReport(Stated):
    """The files that were written for a controller.

    Attributes:
        format: format of the files.
        files: relative to --out, or to the working folder.
        motions: what stands in each of them, in the same order.
    """

    SCHEMA = "excite.export/1"

    format: Name
    files: tuple[FilePath, ...]
    motions: tuple[Exported, ...] = field(metadata=ADDED)


def export_motion(
    motion: Motion,
    robot: Robot,
    format: str,
    path: Path,
    rate_hz: float | None = None,
    *,
    unsafe_anyway: str | None = None,
    approach: bool = False,
    settings: Mapping[str, object] | None = None,
) -> Path:
    """Write a motion in a controller's format, if the independent check finds it safe.

    Args:
        motion: the motion.
        robot: its robot.
        format: a name in ``EXPORTERS``.
        path: file or folder to write; the format's suffix is added where it is missing.
        rate_hz: samples per second of the file; None keeps the motion's own samples, or takes the controller's rate
            where it runs at one only.
        unsafe_anyway: why a motion that fails the check is written all the same. The reason and what is violated then
            stand in the file, where its format can hold them, and in ``NAME.unsafe.json`` beside it.
        approach: whether the way from the robot's rest posture to the start, and back from the end, is part of the
            file; it is checked with the motion.
        settings: what can be said of the format beside the motion, by name (``Exporter.settings``).

    Returns:
        The path written.

    Raises:
        UnknownNameError: no such format.
        UnsafeMotionError: the check does not find it safe, as it is or at ``rate_hz``; nothing was written.
        MotionError: the motion is not this robot's.
        InputError: ``rate_hz`` is not positive and finite, gives fewer than two samples, loses the motion, or is not
            the controller's; the controller runs no such robot; no such setting.
    """
    exporter, path = EXPORTERS.find(format)(robot, settings), Path(path)
    report = _write_motions(
        [exporter], [motion], [path.name], path.parent, rate_hz, unsafe_anyway, approach=approach
    )
    return report.motions[0].path


def export_motions(
    paths: PathsLike,
    format: str,
    *,
    out: Path,
    rate_hz: float | None = None,
    robot: RobotLike | None = None,
    unsafe_anyway: str | None = None,
    approach: bool = False,
    settings: Mapping[str, object] | None = None,
) -> list[Path]:
    """Write motions in the format of a controller, each under its own name; all of them, or none.

    Args:
        paths: motion files, or folders of them; or one of these.
        format: name in the registry of formats, such as ``csv`` or ``ur-script``.
        out: folder that the files are written to.
        rate_hz: samples per second [Hz]; the controller's, or the motion's own, where left out.
        robot: the robot, its name or its file, where the motions do not name a bundled one.
        unsafe_anyway: why motions that fail the check are written all the same; None to refuse them.
        approach: lead from the rest posture to each motion and back.
        settings: settings of the format by name.

    Returns:
        The files, in the order of the motions.

    Raises:
        UnknownNameError: no such format or robot.
        UnsafeMotionError: a motion is not safe, as it is or at ``rate_hz``; nothing was written.
        MotionError: a file is malformed, not this robot's, or does not say whose it is.
        InputError: bad rate, setting or robot, as for :func:`export_motion`; or two motions of the same name.
    """
    report = export_with_verdicts(
        paths,
        format,
        out=out,
        rate_hz=rate_hz,
        robot=robot,
        unsafe_anyway=unsafe_anyway,
        approach=approach,
        settings=settings,
    )
    return [item.path for item in report.motions]


def export_with_verdicts(
    paths: PathsLike,
    format: str,
    *,
    out: Path,
    rate_hz: float | None = None,
    robot: RobotLike | None = None,
    unsafe_anyway: str | None = None,
    approach: bool = False,
    settings: Mapping[str, object] | None = None,
) -> ExportReport:
    """As :func:`export_motions`, each motion with the verdict that it carries."""
    kind = EXPORTERS.find(format)
    files = motion_paths(as_paths(paths))
    names = [file.stem for file in files]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise InputError(
            f"two motions are called {repeated[0]!r}", source="export", remedy="export them apart"
        )
    robots = _load_robots(files, robot)
    motions = [_read_motion(file, its) for file, its in zip(files, robots, strict=True)]
    exporters = [kind(its, settings) for its in robots]
    return _write_motions(exporters, motions, names, Path(out), rate_hz, unsafe_anyway, approach=approach)


def _write_motions(
    exporters: Sequence[Exporter],
    motions: Sequence[Motion],
    names: Sequence[str],
    folder: Path,
    rate_hz: float | None,
    unsafe_anyway: str | None,
    *,
    approach: bool,
) -> ExportReport:
    """Judge motions, and write all of them or none; beside one that is not safe stands why it was written."""
    format, written = exporters[0].name, []
    cleared = clear_motions(exporters, motions, rate_hz, unsafe_anyway, approach=approach)
    with all_or_nothing():
        for exporter, name, item in zip(exporters, names, cleared, strict=True):
            path = exporter.destination(folder / name)
            whole = item.motion if exporter.whole else _commanded_motion(exporter.robot, item.motion)
            exporter.write(whole, path)
            one = Exported(path, str(path.relative_to(folder)), item)
            if item.reason is not None:
                alone = ExportReport(format, (one.file,), (replace(one, file=path.name),))
                write_json(alone.to_json(), path.with_name(path.name + ".unsafe.json"))
            written.append(one)
    return ExportReport(format, tuple(one.file for one in written), tuple(written))


def robot_beside(file: Path, name: str) -> str:
    """What to load a motion's robot by: its name, or the description that a plan for a model of one's own kept.

    Args:
        file: the motion's file, in the plan's folder or one of its own there.
        name: of the robot, as the motion has it.
    """
    if not name or name in bundled_robots():
        return name
    for folder in file.resolve().parents[:3]:
        kept = folder / "robot" / "robot.yaml"
        if kept.is_file() and read_description(kept).name == name:
            return str(kept)
    return name


def _load_robots(files: Sequence[Path], robot: RobotLike | None) -> list[Robot]:
    """The robot of each file; each is loaded once."""
    if robot is not None:
        return [as_robot(robot)] * len(files)
    loaded: dict[str, Robot] = {}
    found = []
    for file in files:
        name = robot_beside(file, motion_robot(file))
        if not name:
            raise MotionError("does not say whose motion it is", source=file, remedy="give --robot")
        if name not in loaded:
            loaded[name] = load_robot(name)
        found.append(loaded[name])
    return found


def _read_motion(file: Path, robot: Robot) -> Motion:
    try:
        return load_motion(file, robot)
    except OtherRobotError as error:
        found = Violation("other_robot", None, error.robot, None, None)
        verdict = Verdict(file.stem, Margins(), (found,), readable=False)
        raise UnsafeMotionError(
            verdict.summary(),
            verdicts=[verdict],
            remedy="nothing was written, and no reason would change that: its joints differ",
        ) from error


def _commanded_motion(robot: Robot, motion: Motion) -> Motion:
    """The motion of the joints that have a motor; others follow."""
    if robot.mechanism is None:
        return motion
    base, kept = robot.n_base_v, ~robot.passive
    free = np.ones(base, dtype=bool)
    v, q = np.concatenate([free, kept]), np.concatenate([np.ones(robot.n_base_q, dtype=bool), kept])
    return replace(
        motion, joint_names=robot.driven_names, q=motion.q[:, q], v=motion.v[:, v], a=motion.a[:, v]
    )
