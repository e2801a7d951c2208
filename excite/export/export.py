"""From a motion to the file that a controller runs: cleared by the independent check, on its grid."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.atomic import all_or_nothing
from excite.display import percent
from excite.errors import InputError, MotionError, OtherRobotError, UnsafeMotionError
from excite.export.exporter import SINGLE, Exporter, join_motions, motion_rows
from excite.export.registry import EXPORTERS
from excite.formats.file import PathsLike, as_paths
from excite.formats.number import check_number
from excite.motion.collection import motion_paths
from excite.motion.content import with_verdict
from excite.motion.files import load_motion, motion_robot
from excite.motion.motion import Motion, interpolate_motion
from excite.motion.setpoints import SLOWEST_SAMPLES_HZ
from excite.results import ADDED, HIDDEN, FilePath, Name, Stated, stated, write_json
from excite.robot.catalogue import bundled_robots
from excite.robot.description import read_description
from excite.robot.load import RobotLike, as_robot, load_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.checks.motion import coordinate_names
from excite.safety.repairs.collisions import find_route
from excite.safety.repairs.sampling import plan_transfer
from excite.safety.verdict import Margins, Verdict, Violation
from excite.simulation.rehearsal import rehearsed_verdict

# How far a motion at another rate may be from what it was: shares of each joint's range, velocity limit and
# acceleration limit. The ready motions of seven robots and planned ones of a UR10 lose at most 1e-5, 0.2 % and 2.7 % at
# 20 Hz, the lowest rate that the check accepts, and 6e-7, 0.01 % and 1 % at 50 Hz, where a controller's quintic
# polynomials go through positions, velocities and accelerations: twice that is another motion.
_LOST = {"position": (1e-4, "range"), "velocity": (0.005, "limit"), "acceleration": (0.05, "limit")}

# What no file holds, or of which nothing can be said: not written for any reason.
_UNWRITABLE = {"shape", "joint_order", "not_finite", "time_not_increasing", "too_few_samples"}

OVERRIDE = "--unsafe-anyway REASON (unsafe_anyway in Python) is the only way round"


def _refuse_unsafe(failed: Sequence[Verdict], n_motions: int, reason: str | None) -> None:
    """Raise UnsafeMotionError where the check fails some of so many motions and no reason stands against it."""
    broken = next((verdict for verdict in failed if _is_unwritable(verdict)), None)
    if broken is not None and reason is not None:
        raise UnsafeMotionError(
            broken.summary(),
            verdicts=failed,
            remedy="nothing was written, and no reason would change that: nobody can run it",
        )
    if failed and reason is None:
        more = f", and {len(failed) - 1} more of {n_motions} motions are not safe" if len(failed) > 1 else ""
        raise UnsafeMotionError(
            f"{failed[0].summary()}{more}", verdicts=failed, remedy=f"nothing was written; {OVERRIDE}"
        )


def _judge_motion(
    exporter: Exporter,
    motion: Motion,
    named: Mapping[str, Motion],
    asked_hz: float | None,
    reason: str | None,
) -> tuple[Motion, Verdict]:
    """A motion as it is written for a controller, on its grid, and what the independent check says of that."""
    robot = exporter.robot
    if motion.joint_names != robot.joint_names:
        raise MotionError(
            f"its joints are not those of robot {robot.name!r}",
            source=motion.name,
            remedy="export it with its robot",
        )
    verdict = check_motion(robot, motion, neighbours=named)
    if _is_unwritable(verdict):
        return motion, verdict
    rate_hz = exporter.rate(motion, asked_hz)
    written = motion
    if rate_hz is not None:
        written = on_grid(motion, robot, rate_hz)
        # What is not safe does not leave at any rate, and what cannot be read cannot be compared.
        if verdict.safe or (verdict.readable and reason is not None):
            _check_loss(robot, motion, written, rate_hz)
        if verdict.safe:
            verdict = check_motion(robot, written, neighbours=named)
    # What is written is the motion to within what a rate may lose, so that the motion's own rehearsal holds.
    verdict = rehearsed_verdict(robot, motion, verdict)
    verdict = replace(verdict, violations=(*verdict.violations, *exporter.violations(written)))
    said = dict(verdict.to_json())
    if not verdict.safe and reason is not None:
        said["unsafe_anyway"] = reason
    metadata = replace(written.metadata, robot_hash=robot.hash, stated_hash="")
    sealed = with_verdict(replace(written, robot=robot.name, metadata=metadata), said, robot.hash)
    return sealed, verdict


def _is_unwritable(verdict: Verdict) -> bool:
    return any(violation.kind in _UNWRITABLE for violation in verdict.violations)


def _check_loss(robot: Robot, motion: Motion, written: Motion, rate_hz: float) -> None:
    """Refuse a rate at which what a controller interpolates from its samples is another motion; raises InputError."""
    limits = robot.limits
    wholes = (limits.position_upper - limits.position_lower, limits.velocity, limits.acceleration)
    # Four instants for each sample of the finer of the two.
    n = 4 * max(motion.n_samples, written.n_samples)
    time = np.linspace(0.0, min(motion.duration, written.duration), n)
    here, there = (interpolate_motion(one, robot, one.time[0] + time) for one in (motion, written))
    values = ((m.joint_positions(), m.joint_velocities(), m.joint_accelerations()) for m in (here, there))
    for (quantity, (limit, of_what)), own, other, whole in zip(_LOST.items(), *values, wholes, strict=True):
        lost = np.abs(other - own).max(axis=0) / whole
        column = int(np.argmax(lost))
        if lost[column] > limit:
            name = coordinate_names(robot)[robot.n_base_v + column]
            raise InputError(
                f"at {rate_hz:g} Hz the {quantity} of {name} is off by up to"
                f" {percent(100.0 * lost[column])} of its {of_what}, more than {100.0 * limit:g} %",
                source=motion.name,
                field="rate_hz",
                remedy=f"give a higher rate; its own is {(motion.n_samples - 1) / motion.duration:.4g} Hz",
            )


# The way from the robot's rest posture to where a motion starts, and back from where it ends.

# Nearer to rest than single precision keeps a turn apart [rad or m], a motion needs no way there.
_NEAR = 2.0 * math.pi * SINGLE


def with_approach(robot: Robot, motion: Motion) -> Motion:
    """The motion from and to the robot's rest posture.

    The joints go straight, as fast as half of their velocity, acceleration and jerk limits let them; round the
    robot's own bodies in several straight parts, each from rest to rest, where they would touch. Which way is taken,
    and how fast, depends on what the independent check says of it; where it likes none, the straight way stands there
    and the check refuses the whole. Ends that another motion of a chain goes on from stay as they are.

    Args:
        motion: the motion; one that is broken, or of other joints, comes back as it is.

    Raises:
        InputError: it starts or ends elsewhere than at rest, and the robot stands on feet or its base moves too.
    """
    shapes = motion.q.shape == (motion.n_samples, robot.model.nq) and motion.n_samples > 2
    if not (
        shapes
        and motion.joint_names == robot.joint_names
        and bool(np.isfinite(motion.q).all() and (np.diff(motion.time) > 0.0).all())
    ):
        return motion
    start = None if motion.metadata.previous else _approach_way(robot, motion, 0)
    end = None if motion.metadata.following else _approach_way(robot, motion, -1)
    if start is None and end is None:
        return motion
    parts, begins = [], 0.0
    if start is not None:
        parts.append(motion_rows(start, slice(None, -1)))
        begins = start.duration
    whole = replace(motion, time=motion.time - motion.time[0] + begins)
    parts.append(whole)
    if end is not None:
        parts.append(motion_rows(replace(end, time=whole.time[-1] + end.time), slice(1, None)))
    return join_motions(motion, parts)


def _approach_way(robot: Robot, motion: Motion, row: int) -> Motion | None:
    """From rest to the first sample (row 0), or from the last one to rest; None where it is at rest already."""
    rest, there = robot.rest[robot.n_base_q :], motion.q[row, robot.n_base_q :]
    base = motion.q[row, : robot.n_base_q] - robot.rest[: robot.n_base_q]
    if np.abs(motion.q[row] - robot.rest).max() <= _NEAR:
        return None
    if robot.feet or np.abs(base).max(initial=0.0) > _NEAR:
        raise InputError(
            f"{'starts' if row == 0 else 'ends'} away from rest, and only joints can be led there, not feet or a base",
            source=motion.name,
            field="approach",
            remedy="plan it from rest to rest, or leave --approach out",
        )
    start, end = (rest, there) if row == 0 else (there, rest)
    postures = find_route(robot, start, end, np.random.default_rng(0)) or [start, end]
    # Speeds at which a way is tried, as shares of half of each limit: slower ones where the torques do not suffice.
    ways = [_way_along(robot, motion, postures, row, speed) for speed in (1.0, 0.5, 0.25)]
    unsaid = replace(motion.metadata, previous="", following="", stated_hash="", robot_hash="")
    safe = (
        way
        for way in ways
        if check_motion(robot, replace(way, contacts={}, metadata=unsaid, robot=robot.name)).safe
    )
    return next(safe, ways[0])


def _way_along(robot: Robot, motion: Motion, postures: list[Array], row: int, speed: float) -> Motion:
    """Straight from posture to posture, at rest in each, at a share of what a transfer does; else as in a sample."""
    rate, still = (motion.n_samples - 1) / motion.duration, np.zeros((1, robot.n_joints))
    time, q, v, a = [np.zeros(1)], [postures[0][None]], [still], [still]
    for start, end in pairwise(postures):
        # Sampled more finely by as much as it is stretched afterwards.
        part = plan_transfer(robot, start, end, rate / speed)
        time.append(time[-1][-1] + part.time[1:] / speed)
        for rows, values in ((q, part.q), (v, speed * part.v), (a, speed**2 * part.a)):
            rows.append(values[1:])
    n = sum(map(len, time))
    base, held = np.repeat(motion.q[[row], : robot.n_base_q], n, axis=0), np.zeros((n, robot.n_base_v))
    return replace(
        motion,
        time=np.concatenate(time),
        q=np.hstack([base, np.vstack(q)]),
        v=np.hstack([held, np.vstack(v)]),
        a=np.hstack([held, np.vstack(a)]),
        contacts={name: np.repeat(flags[[row]], n) for name, flags in motion.contacts.items()},
    )


# The uniform grid of samples that a controller runs.


def on_grid(motion: Motion, robot: Robot, rate_hz: float) -> Motion:
    """The motion from time zero, at exactly ``k / rate_hz`` [s].

    When the duration is no whole number of periods and the motion ends at rest, one more sample holds its
    last posture; when it ends moving, the grid stops at the last whole period.

    Args:
        rate_hz: samples per second.

    Returns:
        The motion on the grid, its q, v, a belonging together.

    Raises:
        InputError: ``rate_hz`` is too low for a controller, or gives more samples than a file holds.
    """
    row = motion.q.shape[1] + motion.v.shape[1] + motion.a.shape[1]
    # Below the lowest rate nobody can tell what a controller would do, and one sample is no motion.
    # Of one file: 0.8 GB in memory and twice that as text.
    least, most = max(SLOWEST_SAMPLES_HZ, 1.0 / motion.duration), 100_000_000 / (row * motion.duration)
    check_number(rate_hz, "rate_hz", least, most, "Hz", source=motion.name)
    periods = motion.duration * rate_hz
    whole = math.floor(periods + 1e-6)
    inside = np.arange(whole + 1) / rate_hz
    sampled = interpolate_motion(motion, robot, np.minimum(motion.time[0] + inside, motion.time[-1]))
    sampled = replace(sampled, time=inside)
    if periods - whole > 1e-6 and np.abs(motion.v[-1]).max() <= SINGLE:
        last = motion_rows(motion, slice(-1, None))
        held = replace(
            last, time=np.array([(whole + 1) / rate_hz]), v=np.zeros_like(last.v), a=np.zeros_like(last.a)
        )
        return join_motions(sampled, [sampled, held])
    return sampled


# From a motion to the file that a robot's controller runs.


@dataclass(frozen=True, eq=False)
class Exported(Stated):
    """A motion that left, and what it carries.

    Attributes:
        path: the file, or the folder of a bag.
        file: the same, relative to --out, or to the working folder.
        written: the motion on the controller's grid; its metadata carry the verdict, and the reason.
        judged: what the independent check says of what is written.
        reason: why it is written all the same; None where it is safe.
    """

    path: Path = field(metadata=HIDDEN)
    file: FilePath
    written: Motion = field(metadata=HIDDEN)
    judged: Verdict = field(metadata=HIDDEN)
    reason: str | None = field(metadata=HIDDEN)

    @property
    @stated
    def motion(self) -> Name:
        """Name of the motion."""
        return self.written.name

    @property
    @stated
    def robot(self) -> Name:
        """Name of its robot."""
        return self.written.robot

    @property
    @stated
    def verdict(self) -> Mapping[str, Any] | None:
        """What the independent check said of it, and why it was written all the same where it is not safe."""
        return self.written.metadata.verdict


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
    """Judge motions as they will be written, and write all of them or none.

    Beside one that is not safe stands why it was written. Errors are those of :func:`export_motion`.
    """
    if unsafe_anyway is not None and not unsafe_anyway.strip():
        raise InputError("is blank", field="unsafe_anyway", remedy="say why, for whoever finds the files")
    for exporter, motion in zip(exporters, motions, strict=True):
        exporter.refuse(motion)
    if approach:
        pairs = zip(exporters, motions, strict=True)
        motions = [with_approach(exporter.robot, motion) for exporter, motion in pairs]
    named = {motion.name: motion for motion in motions}
    judged = [
        _judge_motion(exporter, motion, named, rate_hz, unsafe_anyway)
        for exporter, motion in zip(exporters, motions, strict=True)
    ]
    _refuse_unsafe([verdict for _, verdict in judged if not verdict.safe], len(judged), unsafe_anyway)
    format, written = exporters[0].name, []
    with all_or_nothing():
        for exporter, name, (motion, verdict) in zip(exporters, names, judged, strict=True):
            path = exporter.destination(folder / name)
            exporter.write(motion if exporter.whole else _commanded_motion(exporter.robot, motion), path)
            reason = None if verdict.safe else unsafe_anyway
            one = Exported(path, str(path.relative_to(folder)), motion, verdict, reason)
            if reason is not None:
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
