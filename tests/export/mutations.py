"""Ways to spoil a safe motion: each as somebody, a program or a disk might."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
from numpy.random import Generator

from excite.motion.files import load_motion, save_motion
from excite.motion.motion import Motion
from excite.robot.robot import Robot

Mutation = Callable[[Robot, Motion, Generator, Path], Motion]


def unmarked(motion: Motion) -> Motion:
    """Without anything that a check could recognise it by but what it does."""
    return replace(motion, metadata=replace(motion.metadata, robot_hash="", verdict=None, stated_hash=""))


def _share(rng: Generator) -> float:
    """From a thousandth to the whole, both likely."""
    return float(10.0 ** rng.uniform(-3.0, 0.0))


def _joint(robot: Robot, rng: Generator) -> int:
    return int(rng.integers(robot.n_joints))


def _rows(motion: Motion, keep: np.ndarray | slice) -> Motion:
    arrays = {name: getattr(motion, name)[keep] for name in ("time", "q", "v", "a")}
    return replace(motion, contacts={n: f[keep] for n, f in motion.contacts.items()}, **arrays)


def _edited(motion: Motion, field: str, edit: Callable[[np.ndarray], None]) -> Motion:
    values = getattr(motion, field).copy()
    edit(values)
    return replace(motion, **{field: values})


def _scaled(field: str) -> Mutation:
    def mutate(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
        factor, j = 1.0 + float(rng.choice([-1, 1])) * _share(rng), _joint(robot, rng) - robot.n_joints
        return _edited(motion, field, lambda x: x.__setitem__((slice(None), j), factor * x[:, j]))

    return mutate


def _spike(field: str) -> Mutation:
    def mutate(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
        row, j = int(rng.integers(motion.n_samples)), _joint(robot, rng) - robot.n_joints
        size = float(rng.choice([-1, 1])) * 5.0 * _share(rng)
        return _edited(motion, field, lambda x: x.__setitem__((row, j), x[row, j] + size))

    return mutate


def _value(field: str, value: float) -> Mutation:
    def mutate(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
        row, column = int(rng.integers(motion.n_samples)), int(rng.integers(getattr(motion, field).shape[1]))
        return _edited(motion, field, lambda x: x.__setitem__((row, column), value))

    return mutate


def _pace(factor: float) -> Mutation:
    def mutate(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
        k = factor * float(rng.uniform(1.0, 2.0))
        return replace(motion, time=motion.time / k, v=k * motion.v, a=k * k * motion.a)

    return mutate


def _time_only(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    return replace(motion, time=motion.time * (1.0 + float(rng.choice([-0.9, 1.0])) * _share(rng)))


def _gap(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    first = int(rng.integers(1, motion.n_samples - 12))
    keep = np.delete(np.arange(motion.n_samples), np.arange(first, first + int(rng.integers(1, 10))))
    return _rows(motion, keep)


def _late(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    row = int(rng.integers(1, motion.n_samples))
    return _edited(motion, "time", lambda t: t.__setitem__(slice(row, None), t[row:] + _share(rng)))


def _reversed_time(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    return replace(motion, time=motion.time[::-1].copy())


def _two_times_swapped(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    row = int(rng.integers(motion.n_samples - 1))
    return _edited(motion, "time", lambda t: t.__setitem__([row, row + 1], t[[row + 1, row]]))


def _swapped_joints(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    i, j = (int(x) - robot.n_joints for x in rng.choice(robot.n_joints, 2, replace=False))
    for field in ("q", "v", "a"):
        motion = _edited(motion, field, lambda x: x.__setitem__((slice(None), [i, j]), x[:, [j, i]]))
    return motion


def _swapped_arrays(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    return replace(motion, v=motion.a, a=motion.v)


def _no_contact_column(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    return replace(motion, contacts=dict(list(motion.contacts.items())[1:]))


def _flipped_contact(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    name = str(rng.choice(list(motion.contacts)))
    first = int(rng.integers(motion.n_samples - 1))
    flags = motion.contacts[name].copy()
    flags[first : first + int(rng.integers(1, motion.n_samples))] ^= True
    return replace(motion, contacts={**motion.contacts, name: flags})


def _cut(end: int) -> Mutation:
    def mutate(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
        n = int(motion.n_samples * rng.uniform(0.01, 0.7)) + 1
        return _rows(motion, slice(n, None) if end == 0 else slice(None, motion.n_samples - n))

    return mutate


def _low_rate(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    return _rows(motion, slice(None, None, int(rng.integers(2, 6))))


def _wider(field: str) -> Mutation:
    def mutate(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
        values = getattr(motion, field)
        return replace(
            motion, **{field: values[:, :, None] if rng.random() < 0.5 else np.hstack([values, values])}
        )

    return mutate


def _base(row: int | slice, size: Callable[[Generator], float]) -> Mutation:
    def mutate(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
        return _edited(motion, "q", lambda q: q.__setitem__((slice(None), row), q[:, row] + size(rng)))

    return mutate


def _tilted(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    half = 0.5 * _share(rng)
    x, y, z, w = motion.q[:, 3:7].T
    s, c = np.sin(half), np.cos(half)
    # Turned about the world's x.
    turned = np.column_stack([c * x + s * w, c * y - s * z, c * z + s * y, c * w - s * x])
    return _edited(motion, "q", lambda q: q.__setitem__((slice(None), slice(3, 7)), turned))


def _quaternion_scaled(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    factor = 1.0 + _share(rng)
    return _edited(motion, "q", lambda q: q.__setitem__((slice(None), slice(3, 7)), factor * q[:, 3:7]))


def _turn(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    j, turn = _joint(robot, rng) - robot.n_joints, 2.0 * np.pi * float(rng.choice([-1, 1]))
    return _edited(motion, "q", lambda q: q.__setitem__((slice(None), j), q[:, j] + turn))


def _drift(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    j, size = _joint(robot, rng) - robot.n_joints, float(10.0 ** rng.uniform(-9.0, 0.0))
    slope = size * (motion.time - motion.time[0]) / motion.duration
    return _edited(motion, "q", lambda q: q.__setitem__((slice(None), j), q[:, j] + slope))


def _held_beyond(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    j = _joint(robot, rng)
    beyond = robot.limits.position_upper[j] + _share(rng)
    for field, value in (("q", beyond), ("v", 0.0), ("a", 0.0)):
        motion = _edited(
            motion, field, lambda x, y=value: x.__setitem__((slice(None), j - robot.n_joints), y)
        )
    return motion


def _offset(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    """Joints held elsewhere all along: limits are kept, bodies may touch and balance may be lost."""
    limits, q = robot.limits, motion.joint_positions()
    room = np.where(
        rng.random(robot.n_joints) < 0.5,
        limits.position_upper - q.max(axis=0),
        limits.position_lower - q.min(axis=0),
    )
    shift = np.concatenate([np.zeros(robot.n_base_q), float(rng.uniform(0.2, 0.95)) * room])
    return replace(motion, q=motion.q + shift)


def _larger(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    """The same motion about its start, larger, its derivatives with it."""
    factor, n = 1.0 + 2.0 * _share(rng), robot.n_joints
    q, v, a = motion.q.copy(), motion.v.copy(), motion.a.copy()
    q[:, -n:] = q[0, -n:] + factor * (q[:, -n:] - q[0, -n:])
    v[:, -n:] *= factor
    a[:, -n:] *= factor
    return replace(motion, q=q, v=v, a=a)


def _shake(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    """A burst of samples in a thousandth of a second, in which a joint goes far and comes back; all of one piece."""
    row, j = int(rng.integers(2, motion.n_samples - 3)), _joint(robot, rng) - robot.n_joints
    s = np.linspace(0.0, 1.0, 40)[1:-1]
    span, size = 1e-3, _share(rng)
    time = motion.time[row] + span * s
    k = np.full(len(time), row)
    long = _rows(motion, np.sort(np.append(np.arange(motion.n_samples), k)))
    place = np.arange(row + 1, row + 1 + len(time))
    bump = size * s**4 * (1 - s) ** 4 * 256
    first = size * 256 * 4 * s**3 * (1 - s) ** 3 * (1 - 2 * s) / span
    second = size * 256 * 4 * (3 * s**2 * (1 - s) ** 2 * (1 - 2 * s) ** 2 - 2 * s**3 * (1 - s) ** 3) / span**2
    q, v, a, t = long.q.copy(), long.v.copy(), long.a.copy(), long.time.copy()
    t[place] = time
    h = (time - motion.time[row])[:, None]
    if not robot.floating:
        q[place] += h * v[place] + 0.5 * h**2 * a[place]
        v[place] += h * a[place]
    q[place, j] += bump
    v[place, j] += first
    a[place, j] += second
    return replace(long, time=t, q=q, v=v, a=a)


def _other_robot(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    return replace(motion, robot=str(rng.choice(["panda", "iiwa14", "hrp2like", "g1x", ""])) or "nobody")


def _other_version(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    return replace(motion, metadata=replace(motion.metadata, robot_hash=rng.bytes(32).hex()))


def _changed_file(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    """A file whose numbers somebody changed, its metadata as they were."""
    path = save_motion(motion, folder / "changed.parquet")
    table = parquet.read_table(path)
    name = str(rng.choice([n for n in table.column_names if n.startswith(("q.", "v.", "a."))]))
    values = table[name].to_numpy().copy()
    values[int(rng.integers(len(values)))] += float(10.0 ** rng.uniform(-9.0, 0.0))
    changed = table.set_column(table.column_names.index(name), name, [values])
    parquet.write_table(changed.replace_schema_metadata(table.schema.metadata), path)
    return load_motion(path, robot)


def _changed_hash(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    """A file whose stated hash of its content is another one's."""
    path = save_motion(motion, folder / "hash.csv")
    first, rest = path.read_text().split("\n", 1)
    start = first.index('"content_hash": "') + len('"content_hash": "')
    path.write_text(first[:start] + rng.bytes(32).hex() + first[start + 64 :] + "\n" + rest)
    return load_motion(path, robot)


def _chained_to_itself(robot: Robot, motion: Motion, rng: Generator, folder: Path) -> Motion:
    """A piece between two passages at the same speed, which says that it goes on from itself."""
    n = motion.n_samples // 3
    cut = _rows(motion, slice(n, 2 * n))
    there_and_back = np.r_[0 : cut.n_samples, cut.n_samples - 1]
    cut = _rows(cut, there_and_back[: cut.n_samples])
    chain = {"previous": motion.name, "following": motion.name}
    return replace(cut, metadata=replace(cut.metadata, **chain))


FLOATING: dict[str, Mutation] = {
    "contact column gone": _no_contact_column,
    "contact flipped": _flipped_contact,
    "base lifted": _base(2, lambda rng: 0.1 * _share(rng)),
    "base sunk": _base(2, lambda rng: -0.1 * _share(rng)),
    "base tilted": _tilted,
    "quaternion scaled": _quaternion_scaled,
}
# Refused whatever the motion does: what it says of itself is not so.
NEVER = {"other robot", "other version of the robot", "file changed", "hash changed"}
MUTATIONS: dict[str, Mutation] = {
    "positions scaled": _scaled("q"),
    "velocities scaled": _scaled("v"),
    "accelerations scaled": _scaled("a"),
    "time scaled": _time_only,
    "spike in q": _spike("q"),
    "spike in v": _spike("v"),
    "spike in a": _spike("a"),
    "NaN": _value("q", np.nan),
    "infinite": _value("a", np.inf),
    "rows gone": _gap,
    "late from here": _late,
    "time reversed": _reversed_time,
    "two times swapped": _two_times_swapped,
    "joints swapped": _swapped_joints,
    "v and a swapped": _swapped_arrays,
    "start cut": _cut(0),
    "end cut": _cut(-1),
    "rate low": _low_rate,
    "axis doubled": _wider("q"),
    "axis doubled in v": _wider("v"),
    "full turn": _turn,
    "drift": _drift,
    "held beyond a limit": _held_beyond,
    "held elsewhere": _offset,
    "larger": _larger,
    "faster": _pace(1.3),
    "much faster": _pace(3.0),
    "shaken between samples": _shake,
    "chained to itself": _chained_to_itself,
    "other robot": _other_robot,
    "other version of the robot": _other_version,
    "file changed": _changed_file,
    "hash changed": _changed_hash,
}


def mutations(robot: Robot) -> dict[str, Mutation]:
    """The kinds that mean something for a robot."""
    return {**MUTATIONS, **(FLOATING if robot.floating else {})}


def spoilt(robot: Robot, motion: Motion, kind: str, seed: int, folder: Path) -> Motion:
    """A motion spoilt in one way; the same for the same seed."""
    rng = np.random.default_rng([seed, *kind.encode()])
    start = motion if kind in NEVER else unmarked(motion)
    return mutations(robot)[kind](robot, start, rng, folder)
