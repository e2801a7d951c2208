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
from excite.safety.parameter_set import ParameterSet, RowsOfSet, uncertainty_in_words, uncertainty_of
from excite.safety.verdict import LoadRange, Robustness, Uncertainty, Worst

# Samples whose regressor is looked at together: of a humanoid 5 MB, which stay in the processor's cache.
_BLOCK = 64
# Share of the weight that rounding leaves of a linear form at its root.
_ROUNDING = 1e-13


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
    worst = {"joint_torque_nm": worst_torque(sweep, parameters)}
    if stands:
        worst |= {"zmp_m": worst_zmp(sweep, parameters), "friction": worst_friction(sweep, parameters)}
    return Robustness(_stated_set(robot), worst, decides)


def _stated_set(robot: Robot) -> Uncertainty:
    """The set as ``robot.yaml`` states it, or the default."""
    stated, known = uncertainty_of(robot), robot.description.uncertainty is not None
    load = stated.payload
    return Uncertainty(
        stated.mass,
        stated.com,
        stated.inertia,
        None if load is None else LoadRange(load.link, load.mass, load.position),
        stated.identified,
        stated.sigmas,
        known,
        uncertainty_in_words(stated) + ("" if known else " (assumed)"),
    )


def worst_torque(sweep: Sweep, parameters: ParameterSet) -> Worst | None:
    """What is left to the nearest torque limit [N·m or N], over a set of parameters.

    The torques of the joints are those of :func:`~excite.safety.checks.joints.drive_torques`. Friction and inertia of
    the drives are as they are stated; two feet share changes of the load as they share the load.

    Returns:
        None where a torque could not be computed, or the contacts cannot carry the motion.
    """
    robot, samples, fine = sweep.robot, sweep.torque_samples, sweep.fine
    tau = drive_torques(sweep)
    limits = np.broadcast_to(
        robot.limits.while_between("torque", fine.q[samples, robot.n_base_q :]), tau.shape
    )
    carried = bool(robot.feet) and robot.floating
    if carried and (sweep.contact_forces[0].residual > RESIDUAL_TOLERANCE).any():
        return None
    rows = RowsOfSet(robot, parameters)
    shares = _shares(sweep) if carried else None
    least: Worst | None = None
    for start in range(0, len(samples), _BLOCK):
        part = slice(start, start + _BLOCK)
        at = samples[part]
        moved = Moved(fine.q[at], fine.v[at], fine.a[at])
        of_set = rows.of_torques(moved, None if shares is None else shares[part])
        upper, lower = tau[part] + parameters.rise(of_set), tau[part] - parameters.rise(of_set, -1.0)
        room = limits[part] - np.maximum(upper, -lower)
        if not np.isfinite(room).all():
            return None
        row, joint = np.unravel_index(int(np.argmin(room)), room.shape)
        if least is None or room[row, joint] < least.value:
            time = float(fine.time[at[row]])
            least = Worst(float(room[row, joint]), 0.0, robot.joint_names[joint], time)
    return least


def worst_zmp(sweep: Sweep, parameters: ParameterSet) -> Worst | None:
    """Distance of the zero-moment point from the support polygon's edge [m], over a set of parameters.

    The point is a ratio of linear forms, ``n·p = (n_y m_x − n_x m_y)/f_z``: its distance from an edge is at least ``t``
    over the set if and only if a linear form that depends on ``t`` is nowhere positive. The largest such ``t`` is found
    by the steps of Dinkelbach (1967), which end at it exactly.

    Returns:
        None of a robot without feet, one that is in the air anywhere, or one that the ground would have to pull.
    """
    if not (sweep.robot.feet and sweep.robot.floating):
        return None
    samples = np.arange(sweep.fine.n_samples)
    edges = np.full((len(samples), max(1, sum(len(foot.sole) for foot in sweep.robot.feet)), 3), np.nan)
    for feet, members in sweep.contact_phases():
        if len(feet):
            corners = np.concatenate([sweep.sole_corners[i][members, :, :2] for i in feet], axis=1)
            edges[members, : corners.shape[1]] = hull_edges(corners)
    if not np.isfinite(edges[:, :, 0]).any(axis=1).all():
        return None
    planes = np.zeros((*edges.shape[:2], 6))
    planes[..., 2], planes[..., 3], planes[..., 4] = edges[..., 2], -edges[..., 1], edges[..., 0]
    return _worst_of_wrench(sweep, parameters, [_Facing(samples, np.zeros(3), planes)], ZMP_MARGIN)


def worst_friction(sweep: Sweep, parameters: ParameterSet) -> Worst | None:
    """The horizontal push at the feet, as a share of the vertical force, that would make them slip or turn.

    It is the distance of the contact wrench from the faces of the cone of those that forces inside the soles' friction
    pyramids supply (Caron, Pham and Nakamura 2015), along the horizontal force and over a set of parameters: a
    coefficient of friction that is left. Soles are taken where they were put down.

    Returns:
        None as :func:`worst_zmp`, and where the feet touch in a point or a line.
    """
    robot = sweep.robot
    if not (robot.feet and robot.floating and sweep.contacts.any(axis=1).all()):
        return None
    facing = []
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
        facing.append(_Facing(members, centre, (facets[sliding] / pushed[sliding, None])[None]))
    return _worst_of_wrench(sweep, parameters, facing, 0.0)


class _Facing(NamedTuple):
    """Planes ``(n or 1, n_planes, 6)`` that wrenches about a point stay below at some samples; NaN are none."""

    samples: NDArray[np.intp]
    about: Array
    planes: Array


class _Wrenches(NamedTuple):
    """The model's contact wrenches ``(n, 6)`` about a point, and their rows in a set's coordinates ``(n, 6, k)``."""

    nominal: Array
    of_set: Array


def _worst_of_wrench(
    sweep: Sweep, parameters: ParameterSet, facing: list[_Facing], limit: float
) -> Worst | None:
    """The least ``−plane·w/f_z`` over samples, planes and the set; None where ``f_z`` is not positive everywhere."""
    robot_rows, fine = RowsOfSet(sweep.robot, parameters), sweep.fine
    best, at = np.inf, 0
    for samples, about, planes in facing:
        for start in range(0, len(samples), _BLOCK):
            some = samples[start : start + _BLOCK]
            of_set = robot_rows.of_wrench(Moved(fine.q[some], fine.v[some], fine.a[some])).of_wrench
            of_set[:, 3:] -= pin.skew(about) @ of_set[:, :3]
            nominal = sweep.wrench[some].copy()
            nominal[:, 3:] -= np.cross(about, nominal[:, :3])
            wrenches = _Wrenches(nominal, of_set)
            lightest = nominal[:, 2] - parameters.rise(wrenches.of_set[:, 2], -1.0)
            if not (lightest > 0.0).all():
                return None
            own = planes if len(planes) == 1 else planes[start : start + _BLOCK]
            found, row = _least_ratio(
                parameters, wrenches, np.broadcast_to(own, (len(some), *own.shape[1:])), best
            )
            if found < best:
                best, at = found, int(some[row])
    if not np.isfinite(best):
        return None
    names = [foot.name for foot, on in zip(sweep.robot.feet, sweep.contacts[at], strict=True) if on]
    return Worst(float(best), limit, "+".join(names), float(fine.time[at]))


def _least_ratio(
    parameters: ParameterSet, wrenches: _Wrenches, planes: Array, best: float
) -> tuple[float, int]:
    """The least ratio at some samples and its sample, if it is below ``best``; else ``best``."""
    vertical = np.zeros(6)
    vertical[2] = 1.0
    row, plane = np.nonzero(np.isfinite(planes).all(axis=2))
    nominal, sample = wrenches.nominal[row], -1
    ratio = -np.einsum("ij,ij->i", planes[row, plane], nominal) / nominal[:, 2]
    if len(ratio) and ratio.min() < best:
        best, sample = float(ratio.min()), int(row[np.argmin(ratio)])
    # What each component alone rises bounds what a plane does, at little cost.
    up, down = parameters.rise(wrenches.of_set), parameters.rise(wrenches.of_set, -1.0)
    form = planes[row, plane] + best * vertical
    most = np.einsum("ij,ij->i", form, nominal)
    most += np.einsum("ij,ij->i", np.maximum(form, 0.0), up[row])
    most += np.einsum("ij,ij->i", np.maximum(-form, 0.0), down[row])
    near = np.flatnonzero(most > 0.0)
    while len(near):
        row, plane, nominal = row[near], plane[near], nominal[near]
        form = planes[row, plane] + best * vertical
        above = np.einsum("ij,ij->i", form, nominal)
        above += parameters.rise_of_forms(form, row, wrenches.of_set)
        near = np.flatnonzero(above > _ROUNDING * nominal[:, 2])
        if not len(near):
            break
        # What the ratio is for the parameters that are worst: it is less than the best so far, and is one that occurs.
        of_set = wrenches.of_set[row[near]]
        at = np.einsum("ij,ijk->ik", form[near], of_set)
        force = nominal[near, 2] + parameters.rise_of_other(at, of_set[:, 2])
        ratio = best - above[near] / force
        if not ratio.min() < best:
            break
        best, sample = float(ratio.min()), int(row[near[np.argmin(ratio)]])
    return best, sample


def _phases(sweep: Sweep) -> Iterator[NDArray[np.intp]]:
    """Samples at which forces are evaluated, by stretch of time on the same feet."""
    samples = sweep.torque_samples
    changed = np.cumsum(np.r_[False, (np.diff(sweep.contacts.astype(int), axis=0) != 0).any(axis=1)])[samples]
    yield from np.split(samples, np.flatnonzero(np.diff(changed)) + 1)


def _shares(sweep: Sweep) -> Array:
    """Each foot's wrench per total wrench at ``torque_samples``, ``(m, n_feet, 6, 6)``; zero for feet in the air."""
    robot, samples = sweep.robot, sweep.torque_samples
    found = np.zeros((len(samples), len(robot.feet), 6, 6))
    for feet, members in sweep.contact_phases():
        rows = np.flatnonzero(np.isin(samples, members))
        if not len(feet) or not len(rows):
            continue
        corners = np.concatenate([sweep.sole_corners[i][samples[rows]] for i in feet], axis=1)
        counts = [len(robot.feet[i].sole) for i in feet]
        friction = np.repeat([robot.feet[i].friction for i in feet], counts)
        shared = shares_of_wrench(sweep.wrench[samples[rows]], corners, friction, counts)
        for k, i in enumerate(feet):
            found[rows, i] = shared[:, k]
    return found
