"""The least margins of a motion over a set of inertial parameters: torque, zero-moment point, friction."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array, Moved
from excite.robot.robot import Robot
from excite.safety.checks.ground import ZMP_MARGIN
from excite.safety.checks.joints import drive_torques
from excite.safety.checks.sweep import Sweep
from excite.safety.ground_forces import RESIDUAL_TOLERANCE, cone_facets, hull_edges, shares_of_wrench
from excite.safety.parameter_set import (
    ParameterSet,
    RowsOfSet,
    WrenchRows,
    uncertainty_in_words,
    uncertainty_of,
)
from excite.safety.verdict import LoadRange, Robustness, Uncertainty, Worst

# Samples whose rows are looked at together: of a humanoid 3 MB, which stay in the processor's cache.
_BLOCK = 256


def judge_robustness(sweep: Sweep, parameters: ParameterSet, *, decides: bool = False) -> Robustness:
    """Least margins of a motion over a set of parameters.

    The limits are those of the checks: what a joint can give, the distance that the zero-moment point keeps from the
    edge, feet that neither slip nor turn. Friction of joints and ground, contact geometry and errors of tracking are
    as the model says.

    Args:
        sweep: the motion; it must be readable.
        parameters: the set, of the robot's own description as far as words go.
        decides: whether the motion is to be called safe only if it holds for all of the set.
    """
    robot = sweep.robot
    stands = bool(robot.feet) and robot.floating
    rows, fine = RowsOfSet(robot, parameters), sweep.fine
    looks: dict[str, _TorqueRoom | _WrenchRoom] = {"joint_torque_nm": _TorqueRoom(sweep, parameters, rows)}
    if stands:
        looks["zmp_m"] = _WrenchRoom(sweep, parameters, edges_of_support(sweep), ZMP_MARGIN)
        looks["friction"] = _WrenchRoom(sweep, parameters, faces_of_friction(sweep), 0.0)
    every = np.unique(
        np.concatenate(
            [one.samples for one in looks.values() if one.is_known] or [np.zeros(0, dtype=np.intp)]
        )
    ).astype(int)
    for start in range(0, len(every), _BLOCK):
        at = every[start : start + _BLOCK]
        of_block = rows.of_wrench(Moved(fine.q[at], fine.v[at], fine.a[at]))
        for one in looks.values():
            part = slice(*np.searchsorted(one.samples, [at[0], at[-1] + 1]))
            if one.is_known and part.stop - part.start == len(at):
                one.take_rows(of_block, part)
            elif one.is_known and part.stop > part.start:
                among = np.searchsorted(at, one.samples[part])
                one.take_rows(WrenchRows(*(rows_of[among] for rows_of in of_block)), part)
    worst = {name: one.worst if one.is_known else None for name, one in looks.items()}
    return Robustness(_stated_set(robot), worst, decides)


def _stated_set(robot: Robot) -> Uncertainty:
    """The set as ``robot.yaml`` states it, or the default."""
    stated, known = uncertainty_of(robot), robot.description.uncertainty is not None
    load = None if stated.payload is None else LoadRange(**stated.payload.model_dump())
    words = uncertainty_in_words(stated) + ("" if known else " (assumed)")
    return Uncertainty(
        **stated.model_dump(exclude={"payload", "source"}), payload=load, stated=known, words=words
    )


class _TorqueRoom:
    """What is left to the nearest torque limit [N·m or N].

    The torques of the joints are those of :func:`~excite.safety.checks.joints.drive_torques`. Friction and inertia of
    the drives are as they are stated; two feet share changes of the load as they share the load. None where a torque
    could not be computed, or the contacts cannot carry the motion.
    """

    def __init__(self, sweep: Sweep, parameters: ParameterSet, rows: RowsOfSet) -> None:
        robot, fine = sweep.robot, sweep.fine
        self._fine, self._joints, self._set, self._rows = fine, robot.joint_names, parameters, rows
        self._tau, self._shares = drive_torques(sweep), None
        positions = fine.q[sweep.torque_samples, robot.n_base_q :]
        self._limits = np.broadcast_to(robot.limits.while_between("torque", positions), self._tau.shape)
        self.worst: Worst | None = None
        self.samples = sweep.torque_samples
        self.is_known = True
        if robot.feet and robot.floating:
            self.is_known = not (sweep.contact_forces[0].residual > RESIDUAL_TOLERANCE).any()
            self._shares = shares_of_feet(sweep, self.samples, sweep.wrench[self.samples])

    def take_rows(self, rows: WrenchRows, part: slice) -> None:
        """Take some of ``samples``, whose rows these are, into account."""
        at, shares = self.samples[part], None if self._shares is None else self._shares[part]
        moved = Moved(self._fine.q[at], self._fine.v[at], self._fine.a[at])
        of_set, tau = self._rows.of_torques(moved, rows, shares), self._tau[part]
        upper, lower = tau + self._set.rise(of_set), tau - self._set.rise(of_set, -1.0)
        room = self._limits[part] - np.maximum(upper, -lower)
        self.is_known = bool(np.isfinite(room).all())
        row, joint = np.unravel_index(int(np.argmin(room)), room.shape)
        if self.worst is None or room[row, joint] < self.worst.value:
            time = float(self._fine.time[at[row]])
            self.worst = Worst(float(room[row, joint]), 0.0, self._joints[joint], time)


class _WrenchRoom:
    """The least ``−plane·w/f_z`` over samples and planes; None where ``f_z`` is not positive everywhere."""

    def __init__(self, sweep: Sweep, parameters: ParameterSet, facing: Facing | None, limit: float) -> None:
        self._sweep, self._set, self._limit, self._facing = sweep, parameters, limit, facing
        self._best, self._at, self.is_known = np.inf, -1, facing is not None
        self.samples = np.zeros(0, dtype=np.intp) if facing is None else facing.samples

    def take_rows(self, rows: WrenchRows, part: slice) -> None:
        """Take some of ``samples``, whose rows these are, into account."""
        if self._facing is None:
            return
        some, about = self.samples[part], self._facing.about
        phase = self._facing.phase[part]
        for k in range(phase[0], phase[-1] + 1):
            mine = slice(*np.searchsorted(phase, [k, k + 1]))
            of_set, nominal = rows.of_wrench[mine], self._sweep.wrench[some[mine]]
            if about[k].any():
                of_set = of_set.copy()
                of_set[:, 3:] -= pin.skew(about[k]) @ of_set[:, :3]
                nominal[:, 3:] -= np.cross(about[k], nominal[:, :3])
            planes = self._facing.planes[k]
            own = planes if len(planes) == 1 else planes[part][mine]
            self._best, row = self._set.least_ratio(own, nominal, of_set, self._best)
            if row == -2:
                self.is_known = False
                return
            if row >= 0:
                self._at = int(some[mine][row])

    @property
    def worst(self) -> Worst | None:
        """The least that was found, and where."""
        if not np.isfinite(self._best):
            return None
        on = self._sweep.contacts[self._at]
        names = [foot.name for foot, carries in zip(self._sweep.robot.feet, on, strict=True) if carries]
        time = float(self._sweep.fine.time[self._at])
        return Worst(float(self._best), self._limit, "+".join(names), time)


class Facing(NamedTuple):
    """Planes that wrenches stay below: by phase of ``samples`` the point ``(3,)`` that moments are about, and planes
    ``(n_samples or 1, n_planes, 6)``; NaN are none."""

    samples: NDArray[np.intp]
    phase: NDArray[np.intp]
    about: list[Array]
    planes: list[Array]


def edges_of_support(sweep: Sweep) -> Facing | None:
    """Edges of the support polygon, from which the zero-moment point keeps its distance [m].

    The point is a ratio of linear forms, ``n·p = (n_y m_x − n_x m_y)/f_z``: its distance from an edge is at least ``t``
    over the set if and only if a linear form that depends on ``t`` is nowhere positive. The largest such ``t`` is found
    by the steps of Dinkelbach (1967), which end at it exactly.

    Returns:
        None of a robot that is in the air anywhere.
    """
    n = sweep.fine.n_samples
    edges = np.full((n, max(1, sum(len(foot.sole) for foot in sweep.robot.feet)), 3), np.nan)
    for standing in sweep.on_feet(np.arange(n)):
        edges[standing.rows, : standing.corners.shape[1]] = hull_edges(standing.corners[:, :, :2])
    if not np.isfinite(edges[:, :, 0]).any(axis=1).all():
        return None
    planes = np.zeros((*edges.shape[:2], 6))
    planes[..., 2], planes[..., 3], planes[..., 4] = edges[..., 2], -edges[..., 1], edges[..., 0]
    return Facing(np.arange(n), np.zeros(n, dtype=np.intp), [np.zeros(3)], [planes])


def faces_of_friction(sweep: Sweep) -> Facing | None:
    """Faces of the cone of contact wrenches that forces inside the soles' friction pyramids supply.

    The distance from them along the horizontal force, as a share of the vertical one, is a coefficient of friction that
    is left before feet slip or turn (Caron, Pham and Nakamura 2015). Soles are taken where they were put down.

    Returns:
        None of a robot that is in the air anywhere, and where the feet touch in a point or a line.
    """
    robot = sweep.robot
    if not sweep.contacts.any(axis=1).all():
        return None
    samples = sweep.torque_samples
    phase = np.zeros(len(samples), dtype=np.intp)
    about: list[Array] = []
    planes: list[Array] = []
    for members in _phases(sweep):
        feet = np.flatnonzero(sweep.contacts[members[0]])
        corners = np.concatenate([sweep.sole_corners[i][members[0]] for i in feet])
        friction = np.repeat([robot.feet[i].friction for i in feet], [len(robot.feet[i].sole) for i in feet])
        centre = corners.mean(axis=0)
        facets = cone_facets(corners - centre, friction)
        # Faces that no horizontal force comes nearer to are those of the zero-moment point.
        pushed = np.linalg.norm(facets[:, :2], axis=1)
        sliding = pushed > 1e-6
        if not sliding.any():
            return None
        phase[np.searchsorted(samples, members)] = len(about)
        about.append(centre)
        planes.append((facets[sliding] / pushed[sliding, None])[None])
    return Facing(samples, phase, about, planes)


def _phases(sweep: Sweep) -> Iterator[NDArray[np.intp]]:
    """Samples at which forces are evaluated, by stretch of time on the same feet."""
    samples = sweep.torque_samples
    changed = np.cumsum(np.r_[False, (np.diff(sweep.contacts.astype(int), axis=0) != 0).any(axis=1)])[samples]
    yield from np.split(samples, np.flatnonzero(np.diff(changed)) + 1)


def shares_of_feet(sweep: Sweep, samples: NDArray[np.intp], wrench: Array) -> Array:
    """Each foot's wrench per total wrench ``(m, 6)`` at samples, ``(m, n_feet, 6, 6)``; zero for feet in the air."""
    found = np.zeros((len(samples), len(sweep.robot.feet), 6, 6))
    for feet, rows, counts, corners, friction in sweep.on_feet(samples):
        shared = shares_of_wrench(wrench[rows], corners, friction, counts)
        for k, i in enumerate(feet):
            found[rows, i] = shared[:, k]
    return found
