"""Torques of a trial beside those of the nominal model, and what a model of the drive explains of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.lazy_kernel import LazyKernel
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.drive_terms import smooth_sign
from excite.rows.joint_rows import JointRows
from excite.rows.kinematics import TrialKinematics, forces_on_grid, trial_kinematics
from excite.rows.settings import ProblemSettings

# A trial's torques as they stand in a log and as they were repaired, beside what the nominal model needs.


@dataclass(frozen=True, eq=False)
class BesideModel:
    """Torques of one trial, filtered alike.

    Attributes:
        trial: its name.
        joints: of the columns.
        units: of each column.
        time: ``(n,)`` by the repaired log's clock [s].
        model: of the nominal model's bodies, with an offset, friction and a rotor fitted to the repaired torques:
            ``(n, n_joints)`` [N·m or N].
        logged: as they stand in the log, likewise; samples keep their places where the clock was repaired.
        repaired: as they were repaired, likewise.
    """

    trial: str
    joints: tuple[str, ...]
    units: tuple[str, ...]
    time: Array
    model: Array
    logged: Array
    repaired: Array


def beside_model(robot: Robot, log: Log, repaired: Log) -> BesideModel | None:
    """The torques of a trial beside the nominal model's: of the first that judges, or else of the first.

    Args:
        robot: the nominal model.
        log: as it stands.
        repaired: the same as it was repaired.

    Returns:
        None of robots that move freely or hold their joints together, and where no trial has torques or is long enough.
    """
    if repaired.header.free_base or robot.mechanism is not None:
        return None
    standing = {trial.name: trial for trial in log.trials}
    for trial in (*repaired.role("validation"), *repaired.role("identification")):
        try:
            seen = _of_trial(robot, (log, standing[trial.name]), (repaired, trial))
        except (KeyError, LogError):
            continue
        if seen is not None:
            return seen
    return None


def _of_trial(robot: Robot, stands: tuple[Log, Trial], repaired: tuple[Log, Trial]) -> BesideModel | None:
    (log, as_logged), (mended, trial) = stands, repaired
    mechanics, settings = robot_in_log(robot, mended.header, mended.folder), ProblemSettings()
    filters = settings.filters(floating=False)
    k = trial_kinematics(mechanics, mended.header, trial, settings, filters)
    rows = [JointRows(mechanics, of.header, settings, filters, ()) for of in (log, mended)]
    # A torque that is none is left out by the repair.
    shown = [name for name in rows[1].channel_names if name in rows[0].channel_names]
    if not shown or not k.valid.any():
        return None
    places = [[names.channel_names.index(name) for name in shown] for names in rows]
    # Samples that were put on another clock keep their places.
    time = trial.time if len(trial.time) == len(as_logged.time) else as_logged.time
    columns = [mechanics.joint_index(name) for name in shown]

    def smooth(values: Array) -> Array:
        return lowpass(values, k.rate_hz, filters.cutoff_hz, filters.order)[k.valid]

    torques = smooth(forces_on_grid(trial.time, rows[1].torque(trial)[:, places[1]], k.time))
    model = smooth(inverse_dynamics(mechanics.model, k.q, k.v, k.a)[:, columns])
    own = [smooth(values) for values in _own(mended, k, columns)]
    return BesideModel(
        trial.name,
        tuple(shown),
        tuple(rows[1].channel_units[i] for i in places[1]),
        k.time[k.valid] - k.time[0],
        _with_drives(model, torques, own),
        smooth(forces_on_grid(time, rows[0].torque(as_logged)[:, places[0]], k.time)),
        torques,
    )


def _own(log: Log, k: TrialKinematics, columns: list[int]) -> list[Array]:
    """What each joint's torque may hold besides the bodies': ``(n, n_joints)`` each, of a coefficient one."""
    v, a = k.v[:, columns], k.a[:, columns]
    # Behind the gear neither its friction nor the rotor is felt.
    return [np.ones_like(v), *(() if log.header.torque == "link_side" else Drive.of(v, a))]


def _with_drives(model: Array, torques: Array, own: list[Array]) -> Array:
    """Torques of the bodies with what of each joint's own says most of what they leave."""
    made = model.copy()
    for j in range(model.shape[1]):
        columns = np.column_stack([values[:, j] for values in own])
        made[:, j] += columns @ np.linalg.lstsq(columns, torques[:, j] - model[:, j], rcond=1e-10)[0]
    return made


# Torques of joints beside the nominal model's: what model and drive explain of them.

# Nominal masses are believed within these factors.
_GAIN = (0.5, 2.0)
# A torque whose power is all but this share in its mean is a dead channel.
_DEAD = 1e-12
_TRACE = 1e-9
# Width over which dry friction changes sign [rad/s]: slower motion is mostly noise of the encoder after filtering.
WIDTH = 0.02


class Drive(NamedTuple):
    """Motion of measured joints, which their drives feel.

    Attributes:
        v: velocities ``(n, n_torques)``.
        sign: of the velocities, smooth, likewise.
        a: accelerations, likewise.
    """

    v: Array
    sign: Array
    a: Array

    @classmethod
    def of(cls, v: Array, a: Array, speed: float | Array = 1.0) -> Drive:
        """From velocities and accelerations that are read as ``speed`` times what was logged, all or each joint's.

        Dry friction changes its sign over the same rows whatever the clock and the unit: its shape is not known well
        enough to tell how fast a joint is.
        """
        return cls(v, smooth_sign(v, WIDTH * speed), a)


class Predicted(NamedTuple):
    """What a model says of measured joints.

    Attributes:
        torque: of rigid bodies ``(n, n_torques)`` [N·m].
        drive: motion of the joints.
    """

    torque: Array
    drive: Drive


def shares_left(torque: Array, models: Array, drive: Drive, mixtures: Array | None = None) -> Array:
    """Share of each torque's power that the model and the joint's own drive leave.

    The model's gain is free within :data:`_GAIN`, an offset is free; friction takes power out and rotors are heavy:
    these coefficients are not negative. So a torque with its sign turned is explained by nothing.

    Args:
        torque: measured, ``(n, m)`` [N·m].
        models: nominal, ``(n, m)`` [N·m]; or parts of it, ``(k, n, m)``, with ``mixtures``.
        drive: motions of the joints, each ``(n, m)``.
        mixtures: ``(r, k)`` weights of the parts in each of several models.

    Returns:
        ``(m,)``, or ``(r, m)`` with mixtures; one for a torque that never changes.
    """
    parts = models[None] if mixtures is None else models
    weights = np.ones((1, 1)) if mixtures is None else np.asarray(mixtures, dtype=float)
    out = np.empty((len(weights), torque.shape[1]))
    # Of one layout in memory, for which alone the loops are then compiled.
    moved = (np.ascontiguousarray(values) for values in (torque, parts, weights, *drive))
    unexplained_shares(*moved, *_GAIN, _DEAD, _TRACE, out)
    return out[0] if mixtures is None else out


def shares_across(torque: Array, model: Array, drive: Drive) -> Array:
    """Share of every torque's power that every joint's model and drive leave, of either sign the better.

    Args:
        torque: measured, ``(n, m)``; ``model`` nominal, ``(n, m)`` [N·m].
        drive: motions of the joints.

    Returns:
        ``(m, m)``: of each joint as it explains each torque.
    """
    found = []
    for j in range(torque.shape[1]):
        one, *moved = (np.repeat(values[:, [j]], torque.shape[1], axis=1) for values in (model, *drive))
        either = [shares_left(turned, one, Drive(*moved)) for turned in (torque, -torque)]
        found.append(np.minimum(*either))
    return np.array(found)


def beside_drives(torque: Array, model: Array, drive: Drive) -> list[tuple[Array, Array]]:
    """Measured and modelled torque of each joint ``(n,)`` without what offset, friction and rotor explain of them.

    Args:
        torque: measured, ``(n, m)``; ``model`` nominal, ``(n, m)`` [N·m].
        drive: motions of the joints.
    """
    found = []
    for j in range(torque.shape[1]):
        columns = np.column_stack([np.ones(len(torque)), *(values[:, j] for values in drive)])
        basis, _ = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
        y, x = (values - basis @ (basis.T @ values) for values in (torque[:, j], model[:, j]))
        found.append((y, x))
    return found


def drive_fit(torque: Array, model: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Least-squares weights of model, offset, viscous and dry friction and inertia ``(5,)``, and the friction ``(n,)``.

    Args:
        torque: measured, ``(n,)`` [N·m].
        model: nominal, ``(n,)`` [N·m].
        v: velocity of the joint, ``(n,)``; ``a`` its acceleration. The weights may have any sign.
    """
    columns = np.column_stack([model, np.ones_like(v), v, smooth_sign(v, WIDTH), a])
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    weights = np.linalg.lstsq(columns / scale, torque, rcond=1e-10)[0] / scale
    return weights, columns[:, 2:4] @ weights[2:4]


# Shares of torques that model and drive leave, for many mixtures of models at once; compiled.


@LazyKernel
def product(x, y):
    """Sum of the products of two arrays ``(n,)``, in four sums that do not wait for each other."""
    a = b = c = d = 0.0
    end = len(x) - len(x) % 4
    for k in range(0, end, 4):
        a += x[k] * y[k]
        b += x[k + 1] * y[k + 1]
        c += x[k + 2] * y[k + 2]
        d += x[k + 3] * y[k + 3]
    for k in range(end, len(x)):
        a += x[k] * y[k]
    return (a + b) + (c + d)


@LazyKernel
def remove_mean(x):
    """Take the mean of an array ``(n,)`` off."""
    total = 0.0
    for k in range(len(x)):
        total += x[k]
    for k in range(len(x)):
        x[k] -= total / len(x)


@LazyKernel
def factor_chosen(gram, places, n, root):
    """Cholesky factor of a matrix's first ``n`` chosen rows and columns, into ``root``."""
    for i in range(n):
        for j in range(i + 1):
            value = gram[places[i], places[j]]
            for k in range(j):
                value -= root[i, k] * root[j, k]
            root[i, j] = np.sqrt(value) if i == j else value / root[j, j]


@LazyKernel
def solve_factored(root, n, x):
    """Solution of a factored system in place of its right side; what it takes off the squares, and its least value."""
    gain = 0.0
    for i in range(n):
        for k in range(i):
            x[i] -= root[i, k] * x[k]
        x[i] /= root[i, i]
        gain += x[i] * x[i]
    least = np.inf
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= root[k, i] * x[k]
        x[i] /= root[i, i]
        least = min(least, x[i])
    return gain, least


@LazyKernel
def solve_nonnegative(gram, right, first, x):
    """Least squares with the unknowns from ``first`` on not negative: the best of all sets of those that are not zero.

    Few unknowns leave few sets, and no tolerance has to be chosen. ``gram (p, p)``, ``right (p,)``, ``x (p,)``.
    """
    p = len(right)
    root, some, places = np.empty((p, p)), np.empty(p), np.empty(p, dtype=np.int64)
    best = -1.0
    # All unknowns come first, none last.
    for mask in range((1 << (p - first)) - 1, -1, -1):
        n = 0
        for i in range(first, p):
            if mask >> (i - first) & 1:
                places[n], some[n] = i, right[i]
                n += 1
        factor_chosen(gram, places, n, root)
        gain, least = solve_factored(root, n, some)
        if least >= 0.0 and gain > best:
            best = gain
            for i in range(first, p):
                x[i] = 0.0
            for i in range(n):
                x[places[i]] = some[i]
            if n == p - first:
                return


@LazyKernel
def mix_products(products, mixture, sums):
    """Sums of products of the mixed model and the four columns behind its parts, into ``sums (5, 5)``."""
    k = len(mixture)
    # Loops, not slices: numba takes seconds to compile the assignment of one slice to another.
    for i in range(4):
        sums[0, i] = 0.0
        for c in range(4):
            sums[i + 1, c + 1] = products[k + i, k + c]
    sums[0, 4] = 0.0
    for i in range(k):
        for c in range(k):
            sums[0, 0] += mixture[i] * mixture[c] * products[i, c]
        for c in range(4):
            sums[0, c + 1] += mixture[i] * products[i, k + c]
    for c in range(1, 5):
        sums[c, 0] = sums[0, c]


@LazyKernel
def share_of(sums, low, high, trace):
    """Share of the last column's power that the others leave: gain of the first within bounds, others not negative."""
    gram, scale, right, others, x = np.empty((4, 4)), np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    for i in range(4):
        scale[i] = max(np.sqrt(max(sums[i, i], 0.0)), 1e-300)
        right[i] = (sums[i, 4] - low * sums[i, 0]) / scale[i]
    for i in range(4):
        for c in range(4):
            gram[i, c] = sums[i, c] / scale[i] / scale[c]
        # The normal equations are all that the small problems need; a trace of regularisation keeps them regular.
        gram[i, i] += trace
    solve_nonnegative(gram, right, 0, x)
    most = (high - low) * scale[0]
    if x[0] > most:
        x[0] = most
        for i in range(1, 4):
            others[i] = right[i] - most * gram[i, 0]
        solve_nonnegative(gram, others, 1, x)
    rest = sums[4, 4] - 2.0 * low * sums[0, 4] + low * low * sums[0, 0]
    for i in range(4):
        rest -= 2.0 * x[i] * right[i] + trace * x[i] * x[i]
        for c in range(4):
            rest += x[i] * x[c] * gram[i, c]
    return max(rest, 0.0) / sums[4, 4]


@LazyKernel
def unexplained_shares(torque, models, mixtures, v, sign, a, low, high, least, trace, out):
    """Share of each torque's power that its model and drive leave, into ``out (r, m)``.

    The model of each mixture is the sum of ``models (k, n, m)`` weighted by a row of ``mixtures (r, k)``. ``torque``,
    velocity ``v``, its smooth ``sign`` and acceleration ``a`` are ``(n, m)``. See
    :func:`~excite.doctor.model_comparison.shares_left` for what may be fitted, within ``low`` and
    ``high`` the model's gain; a torque with less than a share ``least`` of its power beside its mean is dead.
    """
    k, n, m = models.shape
    columns, products, sums = np.empty((k + 4, n)), np.empty((k + 4, k + 4)), np.empty((5, 5))
    for j in range(m):
        for t in range(n):
            for i in range(k):
                columns[i, t] = models[i, t, j]
            columns[k, t], columns[k + 1, t], columns[k + 2, t] = v[t, j], sign[t, j], a[t, j]
            columns[k + 3, t] = torque[t, j]
        whole = product(columns[k + 3], columns[k + 3])
        for i in range(k + 4):
            remove_mean(columns[i])
            for c in range(i + 1):
                products[i, c] = products[c, i] = product(columns[i], columns[c])
        # A torque that never changes, filters' rounding aside, is explained by nothing.
        dead = products[k + 3, k + 3] <= least * whole
        for r in range(len(mixtures)):
            mix_products(products, mixtures[r], sums)
            out[r, j] = 1.0 if dead else share_of(sums, low, high, trace)
