"""Compiled loops over bodies: rows of a regressor in a parameter set's coordinates, and how far they rise over it.

Of a body seven coordinates are its mass, first moment and principal moments; then come the loads, each on a body; last,
where there is an ellipsoid, its shift and its root (:class:`~excite.safety.parameter_set.ParameterSet`).
"""

from __future__ import annotations

import numpy as np

from excite.lazy_kernel import LazyKernel
from excite.regressor.motion_loops import LANES, by_sample, move_bodies
from excite.regressor.row_loops import body_rows, write_screw

# Coordinates of a body. numba notices a change only in the file that it compiles.
OF_BODY = 7


@LazyKernel
def wrench_coordinates(
    structure, gravity, q, v, a, room, block, state, wrench, bodies, loads, carriers, screws, out
):  # fmt: skip
    """Rows of the wrench on the whole robot about the world's origin, into ``out (n, 6, …)``, and the joints' screws.

    ``bodies (n_bodies, 10, 7)`` and ``loads (n_loads, 10)`` on ``carriers`` are the set's; ``screws
    (n, n_joints + 1, 6)``; arrays from ``room`` to ``wrench (1, 6, 10)`` are scratch.
    """
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned = structure
    for first in range(0, q.shape[0], LANES):
        move_bodies(
            kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, True,
            q, v, a, first, room, block,
        )  # fmt: skip
        by_sample(block, state)
        for b in range(min(LANES, q.shape[0] - first)):
            t = first + b
            for j in range(1, state.shape[1]):
                write_screw(kinds[j], state, j, b, screws[t])
                body_rows(state, j, b, wrench, 0, 0)
                write_body(wrench, j - 1, bodies, loads, carriers, out, t)


@LazyKernel
def write_body(wrench, body, bodies, loads, carriers, out, t):
    """A body's coordinates from its rows ``wrench (1, 6, 10)``, and those of the loads on it, into ``out[t]``."""
    first = OF_BODY * body
    for i in range(6):
        # Only mass and first moments make a force.
        n_of, n_to = (4, 4) if i < 3 else (10, OF_BODY)
        for k in range(OF_BODY):
            out[t, i, first + k] = 0.0
        for c in range(n_of):
            factor = wrench[0, i, c]
            for k in range(n_to):
                out[t, i, first + k] += factor * bodies[body, c, k]
    for k in range(loads.shape[0]):
        if carriers[k] == body:
            for i in range(6):
                total = 0.0
                for c in range(10):
                    total += wrench[0, i, c] * loads[k, c]
                out[t, i, OF_BODY * bodies.shape[0] + k] = total


@LazyKernel
def rise_of_row(at, row, sign, n_bodies, mass, n_loads):
    """The most that ``sign`` times a row of ``at (n, n_coordinates)`` rises over the set."""
    total = 0.0
    for b in range(n_bodies):
        k = OF_BODY * b
        centre = abs(at[row, k + 1]) + abs(at[row, k + 2]) + abs(at[row, k + 3])
        total += centre + abs(mass * (sign * at[row, k] + centre))
        total += abs(at[row, k + 4]) + abs(at[row, k + 5]) + abs(at[row, k + 6])
    for k in range(OF_BODY * n_bodies, OF_BODY * n_bodies + n_loads):
        total += max(sign * at[row, k], 0.0)
    first = OF_BODY * n_bodies + n_loads
    if at.shape[1] > first:
        square = 0.0
        for k in range(first + 1, at.shape[1]):
            square += at[row, k] * at[row, k]
        total += max(sign * at[row, first] + np.sqrt(square), 0.0)
    return total


@LazyKernel
def rises(at, sign, n_bodies, mass, n_loads, out):
    """How far each row of ``at (n, n_coordinates)`` rises, into ``out (n,)``."""
    for row in range(at.shape[0]):
        out[row] = rise_of_row(at, row, sign, n_bodies, mass, n_loads)


@LazyKernel
def rise_of_other(at, other, t, row, n_bodies, mass, n_loads):
    """How far row ``row`` of ``other (n, 6, n_coordinates)[t]`` is above the model's value where the row
    ``at (1, n_coordinates)`` has risen most."""
    total = 0.0
    for b in range(n_bodies):
        k = OF_BODY * b
        centre, moved, turned = 0.0, 0.0, 0.0
        for i in range(k + 1, k + 4):
            centre += abs(at[0, i])
            moved += np.sign(at[0, i]) * other[t, row, i]
        for i in range(k + 4, k + 7):
            turned += np.sign(at[0, i]) * other[t, row, i]
        total += moved + mass * np.sign(at[0, k] + centre) * (other[t, row, k] + moved) + turned
    for k in range(OF_BODY * n_bodies, OF_BODY * n_bodies + n_loads):
        if at[0, k] > 0.0:
            total += other[t, row, k]
    first = OF_BODY * n_bodies + n_loads
    if at.shape[1] > first:
        square, along = 0.0, 0.0
        for k in range(first + 1, at.shape[1]):
            square += at[0, k] * at[0, k]
            along += at[0, k] * other[t, row, k]
        length = np.sqrt(square)
        if at[0, first] + length > 0.0:
            total += other[t, row, first] + (along / length if length > 0.0 else 0.0)
    return total


@LazyKernel
def form_row(form, of_wrench, t, out):
    """A linear form ``(6,)`` of the wrench at a sample in the set's coordinates, into ``out (1, n_coordinates)``."""
    for k in range(of_wrench.shape[2]):
        out[0, k] = 0.0
    for i in range(6):
        factor = form[i]
        if factor != 0.0:
            for k in range(of_wrench.shape[2]):
                out[0, k] += factor * of_wrench[t, i, k]


@LazyKernel
def lower_ratio(
    plane, nominal, of_wrench, t, up, down, n_bodies, mass, n_loads, best, rounding, form, row
):  # fmt: skip
    """The least ratio of one plane at one sample where it is below ``best``, else that; ``form (6,)`` and ``row`` are
    scratch."""
    while True:
        # What each component alone rises bounds what the plane does, at little cost.
        most, value = 0.0, 0.0
        for i in range(6):
            form[i] = plane[i] + (best if i == 2 else 0.0)
            value += form[i] * nominal[i]
            most += form[i] * up[i] if form[i] > 0.0 else -form[i] * down[i]
        if not value + most > 0.0:
            return best
        form_row(form, of_wrench, t, row)
        above = value + rise_of_row(row, 0, 1.0, n_bodies, mass, n_loads)
        if not above > rounding * nominal[2]:
            return best
        # What the ratio is for the parameters that are worst: it is less than the best so far, and occurs.
        ratio = best - above / (nominal[2] + rise_of_other(row, of_wrench, t, 2, n_bodies, mass, n_loads))
        if not ratio < best:
            return best
        best = ratio


@LazyKernel
def least_ratio(planes, nominal, of_wrench, n_bodies, mass, n_loads, best, rounding):
    """The least ``−plane·w/f_z`` over samples, planes and the set, and the sample at which it is.

    The set's wrenches are ``nominal (n, 6)`` and what ``of_wrench (n, 6, n_coordinates)`` adds; ``planes
    (n or 1, n_planes, 6)`` of NaN are none. The sample is -1 where no ratio is below ``best``, and -2 where the
    vertical force is not positive all over the set. Steps are those of Dinkelbach (1967).
    """
    sample, row = -1, np.empty((1, of_wrench.shape[2]))
    up, down, form = np.empty(6), np.empty(6), np.empty(6)
    for t in range(nominal.shape[0]):
        for i in range(6):
            up[i] = rise_of_row(of_wrench[t], i, 1.0, n_bodies, mass, n_loads)
            down[i] = rise_of_row(of_wrench[t], i, -1.0, n_bodies, mass, n_loads)
        if not nominal[t, 2] - down[2] > 0.0:
            return best, -2
        of_sample = t if planes.shape[0] > 1 else 0
        for p in range(planes.shape[1]):
            plane = planes[of_sample, p]
            if np.isnan(plane).any():
                continue
            here = 0.0
            for i in range(6):
                here -= plane[i] * nominal[t, i]
            if here / nominal[t, 2] < best:
                best, sample = here / nominal[t, 2], t
            lower = lower_ratio(
                plane, nominal[t], of_wrench, t, up, down, n_bodies, mass, n_loads, best, rounding, form, row
            )
            if lower < best:
                best, sample = lower, t
    return best, sample


@LazyKernel
def rises_of_forms(forms, samples, of_wrench, n_bodies, mass, n_loads, scratch, out):
    """How far linear forms ``(n, 6)`` of wrenches at some samples rise, into ``out (n,)``.

    ``of_wrench (n_samples, 6, n_coordinates)``; ``scratch (1, n_coordinates)``.
    """
    for row in range(forms.shape[0]):
        form_row(forms[row], of_wrench, samples[row], scratch)
        out[row] = rise_of_row(scratch, 0, 1.0, n_bodies, mass, n_loads)


@LazyKernel
def torque_coordinates(beyond, idx_v, screws, taken, maps, of_wrench, carriers, n_bodies, out):
    """Rows of the motors' torques from those of the whole robot's wrench, into ``out (n, n_rows, …)``.

    Of what moves beyond a joint (``beyond (n_joints + 1, n_joints + 1)``) its screw carries the wrench, and of the
    whole robot's it is relieved by ``taken (n, n_joints + 1, 6)``; ``maps (n or 1, n_rows, nv)`` are from joints to
    motors.
    """
    form = np.empty(6)
    for t in range(out.shape[0]):
        of_sample = t if maps.shape[0] > 1 else 0
        for row in range(out.shape[1]):
            for k in range(out.shape[2]):
                out[t, row, k] = 0.0
            for j in range(1, beyond.shape[0]):
                factor = maps[of_sample, row, idx_v[j]]
                if factor == 0.0:
                    continue
                relieved = is_relieved(taken, t, j)
                for b in range(1, beyond.shape[0]):
                    if beyond[j, b] or relieved:
                        for i in range(6):
                            carried = screws[t, j, i] if beyond[j, b] else 0.0
                            form[i] = factor * (carried - taken[t, j, i])
                        add_body(form, of_wrench, b - 1, carriers, n_bodies, out, t, row)


@LazyKernel
def is_relieved(taken, t, j):
    """Whether contacts take anything off a joint."""
    relieved = False
    for i in range(6):
        relieved = relieved or taken[t, j, i] != 0.0
    return relieved


@LazyKernel
def add_body(form, of_wrench, body, carriers, n_bodies, out, t, row):
    """Add to a row what a linear form ``(6,)`` makes of a body's coordinates, and of those of the loads on it."""
    for i in range(6):
        factor = form[i]
        for k in range(OF_BODY * body, OF_BODY * body + OF_BODY):
            out[t, row, k] += factor * of_wrench[t, i, k]
    for k in range(carriers.shape[0]):
        if carriers[k] == body:
            column = OF_BODY * n_bodies + k
            for i in range(6):
                out[t, row, column] += form[i] * of_wrench[t, i, column]
