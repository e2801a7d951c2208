"""A thousand motion files that must not reach a robot, each a ready one with one thing wrong: none is exported."""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from excite.errors import ExciteError, MotionError, UnsafeMotionError
from excite.export.export import export_motions
from excite.motion.content import motion_columns
from excite.motion.files import load_motion, save_motion
from excite.motion.library import library_folder
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.benchmarks.table import Row

COUNT = 1000
_SEED = 77
_ROBOTS = ("ur10", "panda", "g1", "hrp2like")
Rng = np.random.Generator


def rows() -> list[Row]:
    """How many of the spoilt files were written for a controller."""
    left, refused = measure(COUNT, _SEED)
    kinds = f" ({', '.join(sorted(left))})" if left else ""
    return [
        Row.holds(
            f"motion files with one thing wrong, {len(SPOILERS)} kinds, exported without the override",
            f"0 of {COUNT}",
            f"{sum(left.values())} of {COUNT}{kinds}",
            not left,
        ),
        Row("… refused as unsafe, as no motion of the robot, and as malformed", "", _said(refused), None),
    ]


def measure(count: int, seed: int) -> tuple[Counter[str], Counter[str]]:
    """Spoil and export ``count`` files; by kind, what was written, and by error, what was refused."""
    rng, left, refused = np.random.default_rng(seed), Counter[str](), Counter[str]()
    robots = {name: load_robot(name) for name in _ROBOTS}
    files = {name: sorted((library_folder(name) / "motions").glob("*.parquet")) for name in _ROBOTS}
    kinds = list(SPOILERS)
    done = 0
    with tempfile.TemporaryDirectory(prefix="unsafe_exports_") as folder:
        while done < count:
            robot = robots[_ROBOTS[done % len(_ROBOTS)]]
            source = files[robot.name][int(rng.integers(len(files[robot.name])))]
            kind = kinds[(done // len(_ROBOTS)) % len(kinds)]
            spoilt = SPOILERS[kind](robot, load_motion(source, robot), Path(folder) / f"{done}", rng)
            if spoilt is None:
                # Nothing to spoil that way: a robot without feet has no contacts.
                kinds_left = [name for name in kinds if name not in _STANDING]
                kind = kinds_left[int(rng.integers(len(kinds_left)))]
                spoilt = SPOILERS[kind](robot, load_motion(source, robot), Path(folder) / f"{done}", rng)
            done += 1
            out = Path(folder) / f"out_{done}"
            form = ("csv", "npz", "ros2")[done % 3]
            try:
                export_motions([spoilt], form, out=out, robot=robot.name, rate_hz=(None, 200.0)[done % 2])
            except ExciteError as error:
                refused[type(error).__name__] += 1
                left[kind] += out.exists()
            else:
                left[kind] += 1
    return +left, refused


def _said(refused: Counter[str]) -> str:
    return (
        ", ".join(str(refused[error.__name__]) for error in (UnsafeMotionError, MotionError, ExciteError))
        + f" (others {sum(refused.values()) - refused['UnsafeMotionError'] - refused['MotionError']})"
    )


Spoiler = Callable[[Robot, Motion, Path, Rng], Path | None]


def _motion(change: Callable[[Robot, Motion, Rng], Motion | None]) -> Spoiler:
    """A spoiler that changes the motion and writes it anew, with hashes that fit."""

    def spoil(robot: Robot, motion: Motion, path: Path, rng: Rng) -> Path | None:
        changed = change(robot, motion, rng)
        suffix = (".parquet", ".csv", ".npz")[int(rng.integers(3))]
        return None if changed is None else save_motion(changed, path.with_suffix(suffix))

    return spoil


def _columns(
    change: Callable[[Robot, dict[str, Any], Rng], dict[str, Any]], *, metadata: bool = False
) -> Spoiler:
    """A spoiler that changes the columns of a table made elsewhere; or of an archive that says what it held before."""

    def spoil(robot: Robot, motion: Motion, path: Path, rng: Rng) -> Path:
        if not metadata:
            table = change(robot, motion_columns(motion), rng)
            names = list(table)
            lines = [",".join(names)]
            lines += [",".join(repr(float(x)) for x in row) for row in zip(*table.values(), strict=True)]
            path = path.with_suffix(".csv")
            path.write_text("\n".join(lines) + "\n")
            return path
        saved = save_motion(motion, path.with_suffix(".npz"))
        with np.load(saved, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        said = arrays.pop("__metadata__")
        np.savez_compressed(saved, __metadata__=said, **change(robot, arrays, rng))
        return saved

    return spoil


def _joint(robot: Robot, rng: Rng) -> int:
    return int(rng.integers(robot.n_joints))


def _faster(robot: Robot, motion: Motion, rng: Rng) -> Motion:
    share = (np.abs(motion.joint_velocities()) / robot.limits.velocity).max()
    k = float(rng.uniform(1.02, 3.0)) / share
    return replace(motion, time=motion.time / k, v=motion.v * k, a=motion.a * k**2)


def _beyond(robot: Robot, motion: Motion, rng: Rng) -> Motion:
    """A whole motion of one joint moved past an end of its range."""
    j = _joint(robot, rng)
    column, limits = robot.n_base_q + j, robot.limits
    q = motion.q.copy()
    top = limits.position_upper[j] - q[:, column].max()
    q[:, column] += top + rng.uniform(0.002, 1.0)
    return replace(motion, q=q)


def _spike(robot: Robot, motion: Motion, rng: Rng) -> Motion:
    q, row = motion.q.copy(), int(rng.integers(5, motion.n_samples - 5))
    q[row, robot.n_base_q + _joint(robot, rng)] += rng.choice([-1, 1]) * rng.uniform(0.1, 1.0)
    return replace(motion, q=q)


def _not_finite(robot: Robot, columns: dict[str, Any], rng: Rng) -> dict[str, Any]:
    name = list(columns)[int(rng.integers(len(columns)))]
    values = np.asarray(columns[name], dtype=float).copy()
    values[int(rng.integers(len(values)))] = rng.choice([np.nan, np.inf, -np.inf])
    return {**columns, name: values}


def _gap(robot: Robot, motion: Motion, rng: Rng) -> Motion:
    time = motion.time.copy()
    time[int(rng.integers(3, len(time) - 3)) :] += rng.uniform(0.06, 5.0)
    return replace(motion, time=time)


def _cut(robot: Robot, motion: Motion, rng: Rng) -> Motion:
    """A part that starts or ends where the motion is fastest."""
    share = (np.abs(motion.joint_velocities()) / robot.limits.velocity).max(axis=1)
    row = int(np.clip(np.argmax(share), 4, motion.n_samples - 5))
    part = slice(row, None) if rng.integers(2) else slice(None, row + 1)
    contacts = {name: flags[part] for name, flags in motion.contacts.items()}
    return replace(
        motion,
        time=motion.time[part],
        q=motion.q[part],
        v=motion.v[part],
        a=motion.a[part],
        contacts=contacts,
    )


def _rare(robot: Robot, motion: Motion, rng: Rng) -> Motion:
    step = int(np.ceil((motion.n_samples - 1) / motion.duration / rng.uniform(4.0, 19.0)))
    rows = np.arange(0, motion.n_samples, step)
    contacts = {name: flags[rows] for name, flags in motion.contacts.items()}
    return replace(
        motion,
        time=motion.time[rows],
        q=motion.q[rows],
        v=motion.v[rows],
        a=motion.a[rows],
        contacts=contacts,
    )


def _base(change: Callable[[np.ndarray, Rng], np.ndarray]) -> Spoiler:
    def moved(robot: Robot, motion: Motion, rng: Rng) -> Motion | None:
        return replace(motion, q=change(motion.q.copy(), rng)) if robot.floating else None

    return _motion(moved)


def _lifted(q: np.ndarray, rng: Rng) -> np.ndarray:
    q[:, 2] += rng.choice([-1, 1]) * rng.uniform(0.005, 0.2)
    return q


def _tilted(q: np.ndarray, rng: Rng) -> np.ndarray:
    angle = rng.uniform(0.03, 0.5)
    turn = np.array([np.sin(angle / 2), 0.0, 0.0, np.cos(angle / 2)])
    x, y, z, w = q[:, 3:7].T
    a, b, c, d = turn
    q[:, 3:7] = np.column_stack(
        [
            d * x + a * w + b * z - c * y,
            d * y + b * w + c * x - a * z,
            d * z + c * w + a * y - b * x,
            d * w - a * x - b * y - c * z,
        ]
    )
    return q


def _contacts(robot: Robot, motion: Motion, rng: Rng) -> Motion | None:
    """One foot's flags are not there, or say the contrary."""
    if not robot.feet:
        return None
    foot = robot.feet[int(rng.integers(len(robot.feet)))].name
    flags = dict(motion.contacts)
    if rng.integers(2):
        del flags[foot]
    else:
        flags = {name: ~values for name, values in flags.items()}
    return replace(motion, contacts=flags)


def _swapped(robot: Robot, motion: Motion, rng: Rng) -> Motion:
    """Positions of the two joints that move least alike, exchanged."""
    q = motion.joint_positions()
    apart = np.abs(q[:, :, None] - q[:, None, :]).max(axis=0)
    i, j = np.unravel_index(int(np.argmax(apart)), apart.shape)
    columns = [robot.n_base_q + int(i), robot.n_base_q + int(j)]
    swapped = motion.q.copy()
    swapped[:, columns] = swapped[:, columns[::-1]]
    return replace(motion, q=swapped)


def _renamed(robot: Robot, columns: dict[str, Any], rng: Rng) -> dict[str, Any]:
    joint = robot.joint_names[_joint(robot, rng)]
    return {name.replace(joint, joint + "_old"): values for name, values in columns.items()}


def _without(robot: Robot, columns: dict[str, Any], rng: Rng) -> dict[str, Any]:
    gone = f"q.{robot.joint_names[_joint(robot, rng)]}"
    return {name: values for name, values in columns.items() if name != gone}


def _times(factor: float, *prefixes: str) -> Callable[[Robot, dict[str, Any], Rng], dict[str, Any]]:
    def change(robot: Robot, columns: dict[str, Any], rng: Rng) -> dict[str, Any]:
        return {
            name: values * factor if name.startswith(prefixes) else values for name, values in columns.items()
        }

    return change


def _changed_after(robot: Robot, arrays: dict[str, Any], rng: Rng) -> dict[str, Any]:
    name = f"{rng.choice(list('qva'))}.{robot.joint_names[_joint(robot, rng)]}"
    values = arrays[name].copy()
    values[int(rng.integers(len(values)))] += rng.choice([-1, 1]) * 10.0 ** rng.uniform(-9, -1)
    return {**arrays, name: values}


def _two_axes(robot: Robot, arrays: dict[str, Any], rng: Rng) -> dict[str, Any]:
    name = list(arrays)[int(rng.integers(len(arrays)))]
    return {**arrays, name: np.column_stack([arrays[name], arrays[name]])}


def _shorter(robot: Robot, arrays: dict[str, Any], rng: Rng) -> dict[str, Any]:
    name = list(arrays)[int(rng.integers(len(arrays)))]
    return {**arrays, name: arrays[name][:-1]}


def _reversed(robot: Robot, columns: dict[str, Any], rng: Rng) -> dict[str, Any]:
    return {**columns, "time": columns["time"][::-1]}


def _repeated(robot: Robot, columns: dict[str, Any], rng: Rng) -> dict[str, Any]:
    time = columns["time"].copy()
    row = int(rng.integers(1, len(time)))
    time[row] = time[row - 1]
    return {**columns, "time": time}


def _said_of(**stated: str) -> Spoiler:
    return _motion(
        lambda robot, motion, rng: replace(
            motion,
            robot=stated.get("robot", motion.robot),
            metadata=replace(
                motion.metadata, robot_hash=stated.get("robot_hash", motion.metadata.robot_hash)
            ),
        )
    )


_STANDING = {"base lifted or sunk", "base tilted", "contacts gone or reversed"}
SPOILERS: dict[str, Spoiler] = {
    "too fast": _motion(_faster),
    "beyond a limit": _motion(_beyond),
    "spike in a position": _motion(_spike),
    "not finite": _columns(_not_finite),
    "gap in time": _motion(_gap),
    "starts or ends moving": _motion(_cut),
    "rate below 20 Hz": _motion(_rare),
    "base lifted or sunk": _base(_lifted),
    "base tilted": _base(_tilted),
    "contacts gone or reversed": _motion(_contacts),
    "joints exchanged": _motion(_swapped),
    "velocities as accelerations": _motion(
        lambda robot, motion, rng: replace(motion, v=motion.a, a=motion.v)
    ),
    "velocities zero": _motion(lambda robot, motion, rng: replace(motion, v=0.0 * motion.v)),
    "velocities reversed": _motion(lambda robot, motion, rng: replace(motion, v=-motion.v)),
    "a turn too many": _motion(
        lambda robot, motion, rng: replace(
            motion, q=motion.q + np.r_[np.zeros(robot.n_base_q), np.full(robot.n_joints, 2 * np.pi)]
        )
    ),
    "degrees": _columns(_times(180.0 / np.pi, "q.", "v.", "a.")),
    "milliseconds as seconds": _columns(_times(1000.0, "time")),
    "seconds as milliseconds": _columns(_times(0.001, "time")),
    "time reversed": _columns(_reversed),
    "time repeated": _columns(_repeated),
    "joint of another name": _columns(_renamed),
    "joint without positions": _columns(_without),
    "changed after it was written": _columns(_changed_after, metadata=True),
    "a column of two axes": _columns(_two_axes, metadata=True),
    "a column too short": _columns(_shorter, metadata=True),
    "another robot's": _said_of(robot="ur5"),
    "another version of the robot's": _said_of(robot_hash="0" * 64),
}


if __name__ == "__main__":
    print(measure(int(sys.argv[1]), int(sys.argv[2])))
