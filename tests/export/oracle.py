"""Whether an exported CSV may be run, found without the package's checks: its text, scipy, pinocchio and geometry.

Limits are held to by samples at 1 kHz of polynomials made here, with room for rounding; what stands, by the soles' path
and by the zero-moment point of the centroidal momentum; bodies, by their distances at 50 Hz.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.interpolate import BPoly
from scipy.spatial import ConvexHull, QhullError

from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_model

# Of a limit: what sampling and rounding may leave. A motion beyond it is unsafe by any reading.
_ROOM = 1.02
_POSE = ("px", "py", "pz", "qx", "qy", "qz", "qw")
_TWIST = ("vx", "vy", "vz", "wx", "wy", "wz")
_RATES = ("ax", "ay", "az", "alphax", "alphay", "alphaz")


def unsafe(robot: Robot, path: Path) -> list[str]:
    """Why an exported motion must not be run; empty where nothing speaks against it."""
    columns = _read(path)
    time = columns["time"]
    step = np.diff(time)
    if not np.isfinite(np.concatenate(list(columns.values()))).all():
        return ["not finite"]
    if (step <= 0.0).any() or step.max() > 0.0501:
        return ["time"]
    names = robot.joint_names
    q, v, a = (np.column_stack([columns[f"{p}.{name}"] for name in names]) for p in "qva")
    dense = np.arange(time[0], time[-1], 1e-3)
    path_of = [
        BPoly.from_derivatives(time, np.stack([q[:, j], v[:, j], a[:, j]], axis=1)) for j in range(len(names))
    ]
    found = _joints(robot, dense, path_of)
    limit = robot.limits.velocity
    if (np.abs(v[[0, -1]]) > 0.01 * limit).any():
        found.append("moves at an end")
    # Positions alone say what the speed is, to the third power of the step; v may be off by as little.
    mean = np.diff(q, axis=0) / step[:, None]
    simpson = 0.5 * (v[1:] + v[:-1]) - step[:, None] * np.diff(a, axis=0) / 12.0
    bend = step[:, None] * np.abs(np.diff(a, axis=0)) / 6.0
    if (np.abs(mean - simpson) > 0.02 * limit + bend).any():
        found.append("v is not the derivative of q")
    full_q, full_v, full_a = q, v, a
    if robot.floating:
        pose, twist, rates = (
            np.column_stack([columns[f"base.{c}"] for c in part]) for part in (_POSE, _TWIST, _RATES)
        )
        if (np.abs(np.linalg.norm(pose[:, 3:], axis=1) - 1.0) > 1e-3).any():
            return [*found, "quaternion"]
        full_q, full_v, full_a = np.hstack([pose, q]), np.hstack([twist, v]), np.hstack([rates, a])
        found += _standing(robot, columns, time, full_q, full_v, full_a)
    else:
        found += _torques(robot, q, v, a)
    return found + _collisions(robot, time, full_q)


def _read(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline="") as stream:
        rows = list(csv.reader(line for line in stream if not line.startswith("#")))
    values = np.array(rows[1:], dtype=float)
    return {name: values[:, i] for i, name in enumerate(rows[0])}


def _joints(robot: Robot, dense: np.ndarray, path_of: list[BPoly]) -> list[str]:
    limits, found = robot.limits, []
    room = (_ROOM - 1.0) * 0.5 * (limits.position_upper - limits.position_lower)
    for j, polynomial in enumerate(path_of):
        q, v, a = polynomial(dense), polynomial(dense, 1), polynomial(dense, 2)
        if (q < limits.position_lower[j] - room[j]).any() or (q > limits.position_upper[j] + room[j]).any():
            found.append(f"position of {robot.joint_names[j]}")
        if (np.abs(v) > _ROOM * limits.velocity[j]).any():
            found.append(f"speed of {robot.joint_names[j]}")
        # Two per cent more for the polynomials' own waves between samples, which the accelerations at these limit.
        if (np.abs(a) > _ROOM * _ROOM * limits.acceleration[j]).any():
            found.append(f"acceleration of {robot.joint_names[j]}")
    return found


def _torques(robot: Robot, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> list[str]:
    data = robot.model.createData()
    tau = np.array([pin.rnea(robot.model, data, *row) for row in zip(q, v, a, strict=True)])
    return ["torque"] if (np.abs(tau) > _ROOM * robot.limits.torque).any() else []


def _standing(
    robot: Robot, columns: dict, time: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> list[str]:
    feet = [foot for foot in robot.feet if f"contact.{foot.name}" in columns]
    if len(feet) < len(robot.feet):
        return ["no contact flags"]
    contact = np.column_stack([columns[f"contact.{foot.name}"] > 0.5 for foot in feet])
    data = robot.model.createData()
    found: set[str] = set()
    stood: dict[int, np.ndarray] = {}
    for k in range(0, len(time), 2):
        if not contact[k].any():
            found.add("no contact")
            continue
        pin.forwardKinematics(robot.model, data, q[k])
        soles = [np.array([data.oMi[foot.joint].act(c) for c in foot.sole]) for foot in feet]
        for i, sole in enumerate(soles):
            if not contact[k, i]:
                stood.pop(i, None)
                if sole[:, 2].min() < -0.01:
                    found.add("foot in the ground")
                continue
            if np.abs(sole[:, 2]).max() > 0.02:
                found.add("foot off the ground")
            if np.abs(sole - stood.setdefault(i, sole)).max() > 0.02:
                found.add("foot slips")
        if not _carries(
            robot,
            data,
            q[k],
            v[k],
            a[k],
            np.vstack([s for s, on in zip(soles, contact[k], strict=True) if on]),
        ):
            found.add("zero-moment point")
    return sorted(found)


def _carries(
    robot: Robot, data: pin.Data, q: np.ndarray, v: np.ndarray, a: np.ndarray, corners: np.ndarray
) -> bool:
    """Whether the zero-moment point is inside the soles' hull, or out of it by no more than 5 mm."""
    pin.computeCentroidalMomentumTimeVariation(robot.model, data, q, v, a)
    force = np.array(data.dhg.linear) - robot.mass * robot.model.gravity.linear
    moment = np.array(data.dhg.angular) + np.cross(data.com[0], force)
    if force[2] <= 0.0:
        return False
    point = np.array([-moment[1], moment[0]]) / force[2]
    try:
        planes = ConvexHull(corners[:, :2]).equations
    except QhullError:
        return False
    return bool((planes[:, :2] @ point + planes[:, 2] <= 0.005).all())


def _collisions(robot: Robot, time: np.ndarray, q: np.ndarray) -> list[str]:
    geometry = collision_model(robot)
    data, places = robot.model.createData(), pin.GeometryData(geometry)
    stride = max(1, round(0.02 / float(np.median(np.diff(time)))))
    for row in q[::stride]:
        pin.updateGeometryPlacements(robot.model, data, geometry, places, row)
        if pin.computeCollisions(geometry, places, True):
            return ["collision"]
    return []
