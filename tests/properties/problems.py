"""Problems: an arm, limits drawn about what a drawn motion does, and what a second judge says of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from tests.properties.arms import MARGIN_M, Arm

State = Callable[[np.ndarray], list[np.ndarray]]
"""Position, velocity, acceleration and jerk at times, ``(4, n, joints)``."""

# Shares of a limit within which two judges may differ: the check bounds curves from control points, samples torques at
# 200 Hz, and takes the mean jerk between dense samples. Of positions and distances they are in radians and metres.
UNDECIDED = {
    "joint_position": 2e-3,
    "joint_velocity": 0.01,
    "joint_acceleration": 0.03,
    "joint_jerk": 0.12,
    "joint_torque": 0.03,
    "self_collision": 3e-3,
}


@dataclass(frozen=True)
class Problem:
    """A motion of an arm with limits, and how far beyond each of them it is by the second judge.

    Attributes:
        kind: how it was drawn.
        robot: with the drawn limits.
        motion: what the check is handed.
        beyond: by kind of violation, the largest excess, as a share of the limit (positions: rad or m; distances: m).
        certain: kinds that must be found whatever else is.
    """

    kind: str
    robot: Robot
    motion: Motion
    beyond: dict[str, float]
    certain: tuple[str, ...] = ()

    def disagreement(self) -> str:
        """What the check says otherwise than the second judge, empty where they agree."""
        verdict = check_motion(self.robot, self.motion)
        found = {violation.kind for violation in verdict.violations}
        missed = {k for k, excess in self.beyond.items() if excess > UNDECIDED[k]} - found
        missed |= set(self.certain) - found
        invented = {k for k in found if self.beyond.get(k, -np.inf) < -UNDECIDED.get(k, 0.0)} - set(
            self.certain
        )
        if self.certain:
            # Of a broken motion nothing else need be told.
            invented = set()
        if not missed and not invented and verdict.safe == (not found):
            return ""
        return f"{self.kind}: missed {sorted(missed)}, invented {sorted(invented)}, {verdict.reason}, {self.beyond}"

    @property
    def decided(self) -> bool:
        """Whether the second judge is sure of every limit."""
        return all(abs(excess) > UNDECIDED[kind] for kind, excess in self.beyond.items())


def draw_problem(arms: list[Arm], seed: int, index: int, folder: Path) -> Problem:
    """The problem of a number; the same for the same seed."""
    rng = np.random.default_rng([seed, index])
    arm = arms[index % len(arms)]
    draw = rng.choice(6, p=[0.4, 0.25, 0.1, 0.1, 0.1, 0.05])
    kind = ("samples", "quintic", "cubic", "switched", "wrong_derivative", "moving_start")[draw]
    if kind in ("quintic", "cubic"):
        return _goal(arm, rng, kind, folder)
    return _samples(arm, rng, kind)


def _samples(arm: Arm, rng: np.random.Generator, kind: str) -> Problem:
    """Dense samples of a smooth motion from rest to rest; of one that switches its acceleration; or spoilt ones."""
    n, rate = arm.robot.n_joints, float(rng.choice([100.0, 125.0, 200.0, 250.0, 500.0]))
    duration = round(rng.uniform(0.6, 1.2) * rate) / rate
    time = np.arange(round(duration * rate) + 1) / rate
    state = _smooth(rng, n, duration) if kind != "switched" else _switched(rng, n, duration)
    q, v, a, _ = state(time)
    dense = np.linspace(0.0, duration, 601)
    values, certain = state(dense), tuple[str, ...]()
    if kind == "switched":
        # Half a motion at one acceleration and half at its opposite: no smaller a jump than that of its samples.
        values[3] = np.vstack([np.abs(np.diff(a, axis=0)), np.abs(a[[0, -1]])]) * rate
    robot, beyond = _limited(arm, rng, values)
    if kind == "switched":
        _swing(beyond)
    if kind == "wrong_derivative":
        which, limit = rng.integers(2), 0.005 * robot.limits.velocity
        if which == 0 and (0.1 * np.abs(v).max(axis=0) > 3.0 * limit).any():
            v, certain = 1.1 * v, ("velocity_not_derivative",)
        elif (0.3 * np.abs(a).max(axis=0) > 0.1 * robot.limits.acceleration).any():
            a, certain = 1.3 * a, ("acceleration_not_derivative",)
    if kind == "moving_start":
        first = len(time) // 4
        time, q, v, a = time[first:], q[first:], v[first:], a[first:]
        beyond = {}
        if (np.abs(v[0]) > 2.0 * 0.005 * robot.limits.velocity).any():
            certain = ("starts_moving",)
    if kind in ("wrong_derivative", "moving_start") and not certain:
        beyond, certain = {}, ()
        kind = "undecided"
    return Problem(kind, robot, Motion("m", "arm", robot.joint_names, time, q, v, a), beyond, certain)


def _smooth(rng: np.random.Generator, n: int, duration: float) -> State:
    """Fourth powers of sines, whose first three derivatives are zero at both ends: sums of cosines."""
    start, size = rng.uniform(-1.0, 1.0, n), rng.normal(0.0, 0.3, (2, n)) / np.array([[1.0], [3.0]])

    def state(time: np.ndarray) -> list[np.ndarray]:
        found = [np.tile(start, (len(time), 1)), *(np.zeros((len(time), n)) for _ in range(3))]
        for k in (1, 2):
            for weight, times in ((0.375, 0.0), (-0.5, 2.0), (0.125, 4.0)):
                rate = times * k * np.pi / duration
                for order in range(4):
                    wave = rate**order * np.cos(rate * time + 0.5 * np.pi * order)
                    found[order] = found[order] + weight * wave[:, None] * size[k - 1]
        return found

    return state


def _switched(rng: np.random.Generator, n: int, duration: float) -> State:
    """The fastest way under a limit of acceleration: there at one value, back to rest at its opposite."""
    start, hard = rng.uniform(-1.0, 1.0, n), rng.normal(0.0, 1.0, n)
    half = 0.5 * duration

    def state(time: np.ndarray) -> list[np.ndarray]:
        t = time[:, None]
        late = np.maximum(t - half, 0.0)
        q = start + 0.5 * hard * t**2 - hard * late**2
        return [q, hard * t - 2.0 * hard * late, np.where(t < half, hard, -hard), np.zeros((len(time), n))]

    return state


def _goal(arm: Arm, rng: np.random.Generator, kind: str, folder: Path) -> Problem:
    """Setpoints further apart than samples, with derivatives as a planner writes them or at random."""
    n, points = arm.robot.n_joints, int(rng.integers(4, 8))
    step = rng.uniform(0.08, 0.3, points - 1) if rng.random() < 0.5 else np.full(points - 1, 0.1)
    time = np.concatenate([[0.0], np.cumsum(step)])
    q = rng.uniform(-1.0, 1.0, n) + np.cumsum(rng.normal(0.0, 0.05, (points, n)), axis=0)
    v = np.gradient(q, time, axis=0) * rng.uniform(0.5, 1.2)
    a = np.gradient(v, time, axis=0) * rng.uniform(0.0, 1.0)
    v[[0, -1]] = a[[0, -1]] = 0.0
    degree = 5 if kind == "quintic" else 3
    pieces = _pieces(time, [q, v, a][: (degree + 1) // 2])
    values = [np.vstack(parts) for parts in zip(*(_derivatives(p, h) for p, h in pieces), strict=True)]
    if kind == "cubic":
        ends = [_derivatives(p, h, np.array([0.0, 1.0])) for p, h in pieces]
        before = np.vstack([np.zeros(n), *(e[2][1] for e in ends)])
        after = np.vstack([*(e[2][0] for e in ends), np.zeros(n)])
        # A controller of 200 Hz or somewhat faster sees the jump from one setpoint to the next.
        cell = step / np.ceil(step * 200.0 - 1e-9)
        width = np.concatenate([cell[:1], 0.5 * (cell[:-1] + cell[1:]), cell[-1:]])
        values[3] = np.vstack([values[3], np.abs(after - before)[1:-1] / width[1:-1, None]])
        robot, beyond = _limited(arm, rng, values)
        jump = float((np.maximum(np.abs(after[0]), np.abs(before[-1])) / robot.limits.jerk).max())
        # At the ends the first setpoint of a controller is up to a cell away, or half of one.
        if jump / (0.5 * cell.min()) > 1.0 - UNDECIDED["joint_jerk"]:
            beyond["joint_jerk"] = max(beyond["joint_jerk"], jump / cell.max() - 1.0, 0.0)
        _swing(beyond)
        motion = _through_file(robot, time, {"q": q, "v": v}, folder)
    else:
        robot, beyond = _limited(arm, rng, values)
        motion = Motion("m", "arm", robot.joint_names, time, q, v, a)
    return Problem(kind, robot, motion, beyond)


def _swing(beyond: dict[str, float]) -> None:
    """Leave undecided what is near its limit where accelerations switch.

    Polynomials through samples swing by up to half of what switches between these, of which their control points make a
    whole; and the switch itself is half a sample away.
    """
    for name in ("joint_acceleration", "joint_torque"):
        if -0.55 < beyond[name] < 0.1:
            beyond[name] = 0.0


def _through_file(robot: Robot, time: np.ndarray, stated: dict[str, np.ndarray], folder: Path) -> Motion:
    names = [f"{prefix}.{joint}" for prefix in stated for joint in robot.joint_names]
    path = folder / "goal.csv"
    np.savetxt(
        path,
        np.column_stack([time, *stated.values()]),
        "%.17g",
        ",",
        header=",".join(["time", *names]),
        comments="",
    )
    return load_motion(path, robot)


def _pieces(time: np.ndarray, ends: list[np.ndarray]) -> list[tuple[np.ndarray, float]]:
    """Polynomials that meet derivatives at both ends, ``(degree + 1, joints)`` each, and durations."""
    found, orders = [], len(ends)
    for k, h in enumerate(np.diff(time)):
        rows, right = [], []
        for at in (0.0, h):
            for order in range(orders):
                powers = polyder(np.eye(2 * orders), order, axis=0)
                rows.append(polyval(at, powers))
                right.append(ends[order][k + (at > 0.0)])
        found.append((np.linalg.solve(np.array(rows), np.array(right)), float(h)))
    return found


def _derivatives(piece: np.ndarray, h: float, share: np.ndarray | None = None) -> list[np.ndarray]:
    """Position to jerk along one piece, each ``(n, joints)``."""
    time = h * (np.linspace(0.0, 1.0, 41) if share is None else share)
    ways = [piece] + [polyder(piece, order, axis=0) for order in (1, 2, 3)]
    return [polyval(time, way).T for way in ways]


def _limited(arm: Arm, rng: np.random.Generator, values: list[np.ndarray]) -> tuple[Robot, dict[str, float]]:
    """The arm with limits about what the motion does, and how far it is beyond each."""
    torque, distance = _simulated(arm, values)
    limits, beyond = arm.robot.limits, {}
    # Most limits are kept, or nothing would ever be safe.
    reached = {"velocity": values[1], "acceleration": values[2], "jerk": values[3], "torque": torque}
    drawn = {}
    for name, value in reached.items():
        most = np.abs(value).max(axis=0)
        drawn[name] = np.maximum(most, 1e-3) * np.exp(rng.uniform(-0.1, 0.8, len(most)))
        beyond[f"joint_{name}"] = float((most / drawn[name]).max() - 1.0)
    room = rng.uniform(-0.02, 0.2, (2, len(limits.velocity)))
    low, high = values[0].min(axis=0) - room[0], values[0].max(axis=0) + room[1]
    beyond["joint_position"] = float(-room.min())
    beyond["self_collision"] = MARGIN_M - distance
    limits = replace(limits, position_lower=low, position_upper=high, **drawn)
    return replace(arm.robot, limits=limits), beyond


def _simulated(arm: Arm, values: list[np.ndarray]) -> tuple[np.ndarray, float]:
    """Torques ``(n, joints)`` that MuJoCo finds, and the least distance of balls that may not touch [m]."""
    model, rows = arm.model, range(0, len(values[2]), 3)
    data, torque, least = mujoco.MjData(model), np.empty((len(rows), model.nv)), np.inf
    # Balls of links that are joined may touch.
    first, second = np.triu_indices(len(arm.radii), 2)
    radii = np.array(arm.radii)
    touching = radii[first] + radii[second]
    for k, row in enumerate(rows):
        data.qpos[:], data.qvel[:], data.qacc[:] = values[0][row], values[1][row], values[2][row]
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse
        between = data.geom_xpos[first] - data.geom_xpos[second]
        least = min(least, float((np.sqrt((between**2).sum(axis=1)) - touching).min()))
    return torque, least
