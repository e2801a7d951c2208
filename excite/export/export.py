"""From a motion to the file that a robot's controller runs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.errors import InputError, MotionError, UnknownNameError
from excite.export.registry import EXPORTERS
from excite.motion.collection import motion_paths
from excite.motion.files import load_motion, motion_robot
from excite.motion.motion import Motion, interpolate
from excite.reading.number import check_number
from excite.robot.loading import load_robot
from excite.robot.robot import Robot

# From one sample a day to what no controller runs at [Hz].
_RATES_HZ = (1e-5, 1e6)
# Of one file: 0.8 GB in memory and twice that as text.
_MOST_NUMBERS = 100_000_000
_AT_REST = 1e-6  # [rad/s or m/s]; below it a motion that ends between two grid points may be held


def export_motion(
    motion: Motion, robot: Robot, format: str, path: Path, rate_hz: float | None = None
) -> Path:
    """Write a motion in a controller's format.

    Args:
        motion: the motion.
        robot: its robot.
        format: a name in ``EXPORTERS``.
        path: file or folder to write; the format's suffix is added where it is missing.
        rate_hz: samples per second of the file; None keeps the motion's own samples.

    Returns:
        The path written.

    Raises:
        UnknownNameError: no such format.
        MotionError: the motion is not this robot's.
        InputError: ``rate_hz`` is not positive and finite, or gives fewer than two samples.
    """
    if format not in EXPORTERS:
        raise UnknownNameError("format", format, sorted(EXPORTERS))
    if motion.joint_names != robot.joint_names:
        raise MotionError(
            f"its joints are not those of robot {robot.name!r}",
            source=motion.name,
            remedy="export it with its robot",
        )
    exporter = EXPORTERS[format]()
    path = Path(path)
    if exporter.suffix and path.suffix != exporter.suffix:
        path = path.with_name(path.name + exporter.suffix)
    exporter.write(motion if rate_hz is None else on_grid(motion, robot, rate_hz), path)
    return path


def export_motions(
    paths: Iterable[Path],
    format: str,
    *,
    out: Path,
    rate_hz: float | None = None,
    robot: str | None = None,
) -> list[Path]:
    """Write motion files in a controller's format, each under its own name.

    Args:
        paths: motion files, or folders of them.
        format: a name in ``EXPORTERS``.
        out: folder to write to.
        rate_hz: samples per second; None keeps each motion's own samples.
        robot: name or file of the robot; the one that each file names where left out.

    Returns:
        The paths written, one a motion.

    Raises:
        UnknownNameError: no such format or robot.
        MotionError: a file is malformed or not this robot's.
        InputError: bad rate, or two motions of the same name.
    """
    if format not in EXPORTERS:
        raise UnknownNameError("format", format, sorted(EXPORTERS))
    files = motion_paths(paths)
    names = [file.stem for file in files]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise InputError(
            f"two motions are called {repeated[0]!r}", source="export", remedy="export them apart"
        )
    robots: dict[str, Robot] = {}
    written = []
    for file in files:
        name = robot or motion_robot(file)
        if name not in robots:
            robots[name] = load_robot(name)
        motion = load_motion(file, robots[name])
        written.append(export_motion(motion, robots[name], format, Path(out) / file.stem, rate_hz))
    return written


def on_grid(motion: Motion, robot: Robot, rate_hz: float) -> Motion:
    """The motion from time zero, at exactly ``k / rate_hz`` [s].

    When the duration is no whole number of periods and the motion ends at rest, one more sample holds its
    last posture; when it ends moving, the grid stops at the last whole period.

    Args:
        motion: the motion.
        robot: its robot.
        rate_hz: samples per second.

    Returns:
        The motion on the grid, its q, v, a belonging together.

    Raises:
        InputError: ``rate_hz`` is not positive and finite, or gives fewer than two samples.
    """
    check_number(rate_hz, "rate_hz", *_RATES_HZ, "Hz", source="export")
    periods = motion.duration * rate_hz
    numbers = periods * (motion.q.shape[1] + motion.v.shape[1] + motion.a.shape[1])
    if numbers > _MOST_NUMBERS:
        raise InputError(
            f"{rate_hz:g} Hz gives {periods:.0f} samples of a motion of {motion.duration:.3f} s",
            source=motion.name,
            field="rate_hz",
            remedy=f"give at most {_MOST_NUMBERS / numbers * rate_hz:.0f} Hz",
        )
    whole = math.floor(periods + 1e-6)
    inside = np.arange(whole + 1) / rate_hz
    if len(inside) < 2:
        raise InputError(
            f"{rate_hz} Hz gives {len(inside)} sample of a motion of {motion.duration:.3f} s",
            source=motion.name,
            field="rate_hz",
            remedy=f"give at least {1.0 / motion.duration:.3f} Hz",
        )
    sampled = interpolate(motion, robot, np.minimum(motion.time[0] + inside, motion.time[-1]))
    if periods - whole > 1e-6 and np.abs(motion.v[-1]).max() < _AT_REST:
        return replace(
            sampled,
            time=np.arange(whole + 2) / rate_hz,
            q=np.vstack([sampled.q, motion.q[-1]]),
            v=np.vstack([sampled.v, np.zeros(motion.v.shape[1])]),
            a=np.vstack([sampled.a, np.zeros(motion.a.shape[1])]),
            contacts={
                name: np.append(flags, motion.contacts[name][-1]) for name, flags in sampled.contacts.items()
            },
        )
    return replace(sampled, time=inside)
