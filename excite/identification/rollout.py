"""Where a model takes a robot that starts from a record, under the forces that were measured."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array, Moved
from excite.identification.problem import IdentificationProblem
from excite.robot.robot import Robot

# How long a model runs before it starts anew from the record [s]. A Panda with 0.3 kg in its hand that the
# model lacks strays by 0.31 rad in that time, which is well seen; in 0.25 s by 1.9 rad, out of sight.
HORIZON_S = 0.1
# Rows further apart than so many of their steps have others missing between them.
_GAP = 1.5


def model_departures(
    problem: IdentificationProblem, parameters: Array, time: Array, record: Moved
) -> Array | None:
    """How far a model strays from a record in which it starts anew every :data:`HORIZON_S`.

    What the measured forces leave over of the model's, ``r = y − Yφ``, moves its bodies as it would move those of
    a robot that otherwise does as was recorded: ``ID(q + δq, v + δv, a + δa) = ID(q, v, a) + r``, with the
    model's own inverse dynamics (Featherstone 2008, eq. 3.1). Friction stays that of the recorded velocities. Of a
    robot on wrench sensors the joints move as they were measured, and the base departs.

    Args:
        problem: rows of one trial.
        parameters: of the model, ``(n_params,)``, in the order of the problem's columns.
        time: instants of the record, ``(n,)`` [s].
        record: q ``(n, nq)``, v and a ``(n, nv)``.

    Returns:
        ``(n, nv)`` [m, rad] in the frames of pinocchio's velocities; zero where the problem has no rows. None where the
        parameters belong to no bodies, or contact forces that nobody measured bear the robot.
    """
    robot = problem.robot
    floating = robot.measures_contacts
    if (robot.floating and not floating) or robot.mechanism is not None:
        return None
    there = [k for k in range(len(problem.channel_names)) if (problem.channel == k).any()]
    names = [problem.channel_names[k] for k in there]
    places = np.arange(6) if floating else np.array([_joint_index(robot, name) for name in names], dtype=int)
    model = _changed_model(problem, parameters)
    if model is None or (floating and len(there) < len(places)):
        return None
    left, known = _left_over(problem, parameters, there, time)
    found = np.zeros((len(time), model.nv))
    for part in _record_stretches(time):
        if known[part].all():
            strayed = _stretch_departure(
                model, places, left[part], time[part], Moved(*(x[part] for x in record))
            )
            if strayed is None:
                return None
            found[part] = strayed
    return found


def _stretch_departure(
    model: pin.Model, places: NDArray[np.intp], left: Array, time: Array, record: Moved
) -> Array | None:
    """Where a model strays in one stretch; None where it is no body's."""
    data, apart, speed = model.createData(), np.zeros((len(time), model.nv)), np.zeros(model.nv)
    square = np.ix_(places, places)
    for k, (q, v, a) in enumerate(zip(*record, strict=True)):
        if k + 1 == len(time):
            break
        force = pin.rnea(model, data, q, v, a)[places] + left[k]
        there = pin.integrate(model, q, apart[k])
        force -= pin.rnea(model, data, there, v + speed, a)[places]
        upper = np.triu(pin.crba(model, data, there))
        inertia = (upper + np.triu(upper, 1).T)[square]
        more = np.zeros(model.nv)
        try:
            np.linalg.cholesky(inertia)
            more[places] = np.linalg.solve(inertia, force)
        except np.linalg.LinAlgError:
            return None
        step = time[k + 1] - time[k]
        apart[k + 1] = apart[k] + step * (speed + 0.5 * step * more)
        speed = speed + step * more
    return apart if np.isfinite(apart).all() else None


def _joint_index(robot: Robot, joint: str) -> int:
    return int(robot.model.idx_vs[robot.model.getJointId(joint)])


def _changed_model(problem: IdentificationProblem, parameters: Array) -> pin.Model | None:
    """The robot with other bodies and rotors; None where a body has no mass."""
    robot = problem.robot
    model, values = robot.model.copy(), dict(zip(problem.parameter_names, parameters.tolist(), strict=True))
    rotors = np.zeros(model.nv)
    for name in robot.joint_names:
        rotors[_joint_index(robot, name)] = values.get(f"armature.{name}", 0.0)
    model.armature = rotors
    for joint in range(1, model.njoints):
        body = parameters[10 * (joint - 1) : 10 * joint]
        if np.array_equal(body, model.inertias[joint].toDynamicParameters()):
            continue
        if not body[0] > 0.0:
            return None
        model.inertias[joint] = pin.Inertia.FromDynamicParameters(body)
    return model


def _left_over(
    problem: IdentificationProblem, parameters: Array, channels: list[int], time: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """What rows leave over at other instants, ``(n, n_channels)``, and where all of them are known."""
    rest = problem.y - problem.Y @ parameters
    columns, known = [], np.ones(len(time), dtype=bool)
    for channel in channels:
        rows = np.flatnonzero(problem.channel == channel)
        rows = rows[np.argsort(problem.time[rows], kind="stable")]
        at = problem.time[rows]
        columns.append(np.interp(time, at, rest[rows]))
        step = np.diff(at)
        after = np.searchsorted(at, time).clip(1, max(1, len(at) - 1))
        inside = (time >= at[0]) & (time <= at[-1])
        wide = step > _GAP * np.median(step) if len(step) else np.ones(1, dtype=bool)
        known &= inside & ~wide[after - 1]
    return np.column_stack(columns), known


def _record_stretches(time: Array) -> list[slice]:
    """Parts of a record of :data:`HORIZON_S` each."""
    number = ((time - time[0]) / HORIZON_S + 1e-9).astype(int)
    edges = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(time)]
    return [slice(start, stop) for start, stop in pairwise(edges)]
