"""Curves that controllers run through setpoints: by which derivatives stand with the positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, Moved
from excite.errors import MotionError

StatedCurve = Literal["linear", "hold", "blend"]
"""Curves that no column tells, which a file may state: straight lines, each row held until the next one, or lines whose
corners are rounded by parabolas that last a stated time."""
Curve = Literal["quintic", "cubic", "spline"] | StatedCurve
"""Between samples: quintic and cubic polynomials that meet them and their derivatives, a stated curve, or nothing that
a controller would run: a spline through positions, of which v and a are derivatives."""
# Slowest sampling at which a spline through positions still says what a controller would do [Hz]; what is slower and
# states velocities is a goal.
SLOWEST_SAMPLES_HZ = 20.0
# Rate at which curves are sampled that jump in a derivative where they pass a setpoint [Hz].
_CURVE_RATE_HZ = 200.0
# Longest goal that is looked at [s]: goals last seconds, and an hour of seven joints fills 120 MB at that rate.
LONGEST_GOAL_S = 3600.0


def is_sparse(time: Array) -> bool:
    """Whether instants ``(n,)`` [s] are too far apart to be samples of a motion."""
    return float(np.median(np.diff(time))) > (1.0 + 1e-9) / SLOWEST_SAMPLES_HZ


def stated_curve(names: Sequence[str], time: Array, *, goal: bool, floating: bool) -> Curve:
    """The curve that a file's columns mean.

    Controllers of ROS 2 run the polynomial of least degree that meets all that a goal states (``joint_trajectory_
    controller``, page *Trajectory Representation*): quintic for accelerations, cubic for velocities, else lines.

    Args:
        names: of the columns that the file has.
        time: ``(n,)`` [s].
        goal: whether the file is a goal of such a controller.
        floating: whether it moves a free base, which no such controller does.
    """
    if any(name.startswith("a.") for name in names):
        return "quintic"
    velocities, sparse = any(name.startswith("v.") for name in names), is_sparse(time) and not floating
    if velocities:
        return "cubic" if sparse else "quintic"
    return "linear" if sparse and goal else "spline"


def sampled_curve(
    columns: Mapping[str, Array], joints: Sequence[str], curve: Curve, path: Path, blend: float | None = None
) -> dict[str, Array]:
    """Columns of a cubic, linear, held or blended curve at 200 Hz, with its own derivatives; others as they are.

    At a setpoint acceleration or velocity jumps from the value of one polynomial to that of the next. The samples
    stand half a step before and after, between which the jump happens: so fast it comes to a controller of that rate.

    Args:
        columns: ``(n,)`` each, ``time`` [s] and ``q.JOINT`` [rad or m] of all joints among them, ``v.JOINT`` if cubic.
        joints: of the robot.
        curve: what runs through the setpoints.
        path: the file, for errors.
        blend: how long the parabolas of a blended curve last [s].

    Raises:
        MotionError: it lasts longer than any motion, or its parabolas longer than the lines between them.
    """
    if curve not in ("cubic", "linear", "hold", "blend"):
        return dict(columns)
    time = columns["time"]
    q = np.column_stack([columns[f"q.{joint}"] for joint in joints])
    v = np.column_stack([columns[f"v.{joint}"] for joint in joints]) if curve == "cubic" else None
    if curve == "hold":
        time, q = _held(time, q)
    elif curve == "blend":
        time, moved = _blended(time, q, blend, path)
        q, v = moved.q, moved.v
    h = np.diff(time)
    if time[-1] - time[0] > LONGEST_GOAL_S:
        raise MotionError(
            f"lasts {time[-1] - time[0]:.3g} s",
            source=path,
            field="time",
            remedy="check that time is in seconds",
        )
    cells = np.ceil(h * _CURVE_RATE_HZ - 1e-9).astype(int)
    index = np.repeat(np.arange(len(h)), cells)
    within = np.arange(len(index)) - np.repeat(np.cumsum(cells) - cells, cells)
    index = np.r_[0, index, len(h) - 1]
    share = np.r_[0.0, (within + 0.5) / cells[index[1:-1]], 1.0]
    slope = np.diff(q, axis=0) / h[:, None]
    values = _polynomials(q, slope, v, h, index, share[:, None])
    instants = time[index] + share * h[index]
    if v is None:
        instants, values = _rounded_corners(instants, values, index)
    found = {"time": instants}
    for name, value in zip("qva", values, strict=True):
        found |= {f"{name}.{joint}": value[:, i] for i, joint in enumerate(joints)}
    return found


def _held(time: Array, q: Array) -> tuple[Array, Array]:
    """Setpoints of the lines that hold each row until the next one, to which the last of its cycles leads."""
    step = np.minimum(1.0 / _CURVE_RATE_HZ, 0.5 * np.diff(time))
    ends = np.column_stack([time[1:] - step, time[1:]]).ravel()
    return np.r_[time[0], ends], np.vstack([q[:1], np.stack([q[:-1], q[1:]], axis=1).reshape(-1, q.shape[1])])


def _blended(time: Array, q: Array, blend: float | None, path: Path) -> tuple[Array, Moved]:
    """Where lines of constant speed begin and end between setpoints, from rest to rest.

    Between lines the acceleration is constant, as of controllers that pass setpoints with a blend (linear segments with
    parabolic blends: Craig, Introduction to Robotics, section 7.3). The first and last parabola lie within the motion.
    """
    h, remedy = (
        np.diff(time),
        "state how long the parabola at each setpoint lasts, less than the lines beside it",
    )
    width = blend or 0.0
    outer = np.zeros(len(h))
    outer[0] += 0.5 * width
    outer[-1] += 0.5 * width
    if width <= 0.0 or (h - outer <= width).any():
        what = "is missing" if blend is None else f"is {blend:g} s, and setpoints are {h.min():.3g} s apart"
        raise MotionError(what, source=path, field="blend_s", remedy=remedy)
    speed = np.diff(q, axis=0) / (h - outer)[:, None]
    ends = time[1:-1, None] + 0.5 * width * np.array([-1.0, 1.0])
    instants = np.r_[time[0], time[0] + width, ends.ravel(), time[-1] - width, time[-1]]
    still = np.zeros((1, q.shape[1]))
    v = np.vstack([still, np.repeat(speed, 2, axis=0), still])
    moved = 0.5 * (v[:-1] + v[1:]) * np.diff(instants)[:, None]
    return instants, Moved(np.vstack([q[:1], q[0] + np.cumsum(moved, axis=0)]), v, np.zeros_like(v))


def _polynomials(
    q: Array, slope: Array, v: Array | None, h: Array, index: NDArray[np.intp], s: Array
) -> Moved:
    """Positions, velocities and accelerations at shares ``(m, 1)`` of intervals."""
    length = h[index][:, None]
    if v is None:
        return Moved(q[index] + s * length * slope[index], slope[index], np.zeros((len(index), q.shape[1])))
    # Hermite: what is missing from the mean slope at either end.
    first, last = v[index] - slope[index], v[index + 1] - slope[index]
    square, cube = -2.0 * first - last, first + last
    return Moved(
        q[index] + length * s * (slope[index] + first + s * (square + s * cube)),
        slope[index] + first + s * (2.0 * square + 3.0 * s * cube),
        (2.0 * square + 6.0 * s * cube) / length,
    )


def _rounded_corners(time: Array, values: Moved, index: NDArray[np.intp]) -> tuple[Array, Moved]:
    """Lines with one more sample at each setpoint, where the acceleration that turns them is largest."""
    q, v, _ = values
    before = np.flatnonzero(np.diff(index))
    width, turn = (time[before + 1] - time[before])[:, None], v[before + 1] - v[before]
    middle = (
        q[before] + width * (0.5 * v[before] + turn / 12.0),
        0.5 * (v[before] + v[before + 1]),
        2.0 * turn / width,
    )
    instants = np.insert(time, before + 1, 0.5 * (time[before] + time[before + 1]))
    return instants, Moved(
        *(np.insert(old, before + 1, new, axis=0) for old, new in zip(values, middle, strict=True))
    )
