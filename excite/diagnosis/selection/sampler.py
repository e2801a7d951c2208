"""Which atoms of which groups are in the model: ascent to a mode and Gibbs sampling, on one Gram matrix.

A group is an effect at a place. Its atoms are points of its non-linear parameters and other forms of its law, of
which at most one is in the model. With the columns that every model has integrated out, the log marginal likelihood
of a model with the columns S is

    ½ hᵀ Λ⁻¹ h − ½ log|Λ| + ½ log|P| + Σ c,    Λ = A_SS + P_S,

A the Gram matrix, h the right side, P the prior's precisions. Sizes have bounds: an atom counts by the posterior mass
of its own size inside them, and one that would drive a size of the model out of its bounds does not enter.

Both moves are exact Gibbs steps (George, McCulloch 1993): a group is drawn from {none, its atoms} given all others;
and a slot is drawn from all atoms of all groups that are not in the model, which exchanges one name for another at
once. What the second draws from is the list of rivals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from excite.arrays import Array
from excite.lazy_kernel import LazyKernel

Indices = NDArray[np.int64]

# Most columns of a model, and of an atom.
_MOST, _WIDEST = 400, 24
# What an atom that breaks a bound loses: it never enters.
_NEVER = 1e4
# Standard deviations by which a size may leave its bounds by chance.
_BY_CHANCE = 3.0


# Deviation of the size of a contribution whose shape was fitted: one, but for what its shape is off.
FITTED_SIZE = 0.02


class AtomPrior(NamedTuple):
    """Prior of an atom: normal sizes of its columns within bounds, and its odds.

    Attributes:
        mean: ``(width,)``.
        precision: ``(width,)``.
        low: ``(width,)`` bounds; ``high`` alike.
        high: ``(width,)``.
        log_prior: log odds against none.
    """

    mean: Array
    precision: Array
    low: Array
    high: Array
    log_prior: float = 0.0


class Problem(NamedTuple):
    """A selection problem; columns are those of all atoms, one after the other.

    Attributes:
        gram: ``(n, n)`` A.
        right: ``(n,)`` h, the prior's ``P m`` in it.
        precision: ``(n,)`` P.
        constant: ``(n,)`` ``−½ P m²``.
        low: ``(n,)`` least size; ``high`` the greatest.
        high: ``(n,)``.
        mass: ``(n,)`` log of the prior's mass within them.
        first: ``(n_atoms,)`` first column of an atom.
        width: ``(n_atoms,)`` number of its columns.
        group: ``(n_atoms,)``; a group's atoms are neighbours.
        log_prior: ``(n_atoms,)`` log prior odds against none.
        begin: ``(n_groups,)`` first atom of a group.
        n_atoms: ``(n_groups,)`` number of its atoms.
        needs: ``(n_groups,)`` the group without which it cannot be; −1 where there is none.
    """

    gram: Array
    right: Array
    precision: Array
    constant: Array
    low: Array
    high: Array
    mass: Array
    first: Indices
    width: Indices
    group: Indices
    log_prior: Array
    begin: Indices
    n_atoms: Indices
    needs: Indices

    @classmethod
    def of_atoms(
        cls, atoms: Sequence[AtomPrior], group: Indices, needs: Indices, gram: Array, right: Array
    ) -> Problem:
        """The problem of atoms that stand group by group.

        Args:
            group: ``(n_atoms,)``.
            needs: ``(n_groups,)``.
            gram: ``(n, n)`` of all their columns, with what every model has integrated out.
            right: ``(n,)``.
        """
        mean, precision, low, high = (
            np.concatenate([np.zeros(0), *(getattr(atom, name) for atom in atoms)])
            for name in ("mean", "precision", "low", "high")
        )
        deviation = precision**-0.5
        mass = np.log(np.maximum(ndtr((high - mean) / deviation) - ndtr((low - mean) / deviation), 1e-30))
        width = np.array([len(atom.mean) for atom in atoms], dtype=np.int64)
        count = np.bincount(group, minlength=len(needs))
        return cls(
            np.ascontiguousarray(gram),
            right + precision * mean,
            precision,
            -0.5 * precision * mean**2,
            np.maximum(low, -1e30),
            np.minimum(high, 1e30),
            mass,
            np.cumsum(width) - width,
            width,
            group,
            np.array([atom.log_prior for atom in atoms]),
            np.cumsum(count) - count,
            count,
            needs,
        )


class Draws(NamedTuple):
    """What a run of the sampler tells.

    Attributes:
        inclusion: ``(n_groups,)`` posterior probability of each group.
        by_atom: ``(n_atoms,)`` of each atom.
        rivals: ``(n_groups, n_groups)`` probability of each group in the place of another that is in.
        states: ``(n_draws, n_groups)`` models: atom of each group, −1 for none.
        best: ``(n_groups,)`` the likeliest model that was seen.
    """

    inclusion: Array
    by_atom: Array
    rivals: Array
    states: Indices
    best: Indices


class _Workspace(NamedTuple):
    """Working arrays."""

    factor: Array
    z: Array
    sizes: Array
    cross: Array
    small: Array
    columns: Indices


@LazyKernel
def _solve_model(problem: Any, state: Any, without: Any, room: Any) -> Any:  # noqa: C901
    """Cholesky factor of Λ of a model without a group, z = L⁻¹h and the sizes; returns the number of columns."""
    n = 0
    for g in range(len(state)):
        if g != without and state[g] >= 0:
            for a in range(problem.width[state[g]]):
                room.columns[n] = problem.first[state[g]] + a
                n += 1
    for i in range(n):
        c = room.columns[i]
        for k in range(i + 1):
            s = problem.gram[c, room.columns[k]]
            if i == k:
                s += problem.precision[c]
            for m in range(k):
                s -= room.factor[i, m] * room.factor[k, m]
            if i == k:
                room.factor[i, i] = math.sqrt(max(s, 1e-12))
            else:
                room.factor[i, k] = s / room.factor[k, k]
        s = problem.right[c]
        for m in range(i):
            s -= room.factor[i, m] * room.z[m]
        room.z[i] = s / room.factor[i, i]
    for i in range(n - 1, -1, -1):
        s = room.z[i]
        for m in range(i + 1, n):
            s -= room.factor[m, i] * room.sizes[m]
        room.sizes[i] = s / room.factor[i, i]
    return n


@LazyKernel
def _atom_gain(problem: Any, atom: Any, n: Any, room: Any) -> Any:  # noqa: C901, PLR0912
    """Log marginal likelihood ratio of an atom beside a solved model of n columns, its prior odds in it."""
    first, width = problem.first[atom], problem.width[atom]
    v, c = room.cross, room.small
    for a in range(width):
        for i in range(n):
            s = problem.gram[room.columns[i], first + a]
            for m in range(i):
                s -= room.factor[i, m] * v[m, a]
            v[i, a] = s / room.factor[i, i]
    out = problem.log_prior[atom]
    r, x = np.empty(width), np.empty(width)
    for a in range(width):
        s = problem.right[first + a]
        for i in range(n):
            s -= v[i, a] * room.z[i]
        r[a] = s
        out += 0.5 * math.log(problem.precision[first + a]) + problem.constant[first + a]
        for k in range(a + 1):
            s = problem.gram[first + a, first + k]
            if a == k:
                s += problem.precision[first + a]
            for i in range(n):
                s -= v[i, a] * v[i, k]
            for m in range(k):
                s -= c[a, m] * c[k, m]
            if a == k:
                c[a, a] = math.sqrt(max(s, 1e-12))
                out -= math.log(c[a, a])
            else:
                c[a, k] = s / c[k, k]
        s = r[a]
        for m in range(a):
            s -= c[a, m] * r[m]
        r[a] = s / c[a, a]
        out += 0.5 * r[a] * r[a]
    for a in range(width - 1, -1, -1):
        s = r[a]
        for m in range(a + 1, width):
            s -= c[m, a] * x[m]
        x[a] = s / c[a, a]
    out += _log_mass_in_bounds(problem, first, width, x, c)
    if out > -6.0 and _drives_out(problem, width, n, x, room):
        out -= _NEVER
    return out


@LazyKernel
def _log_mass_in_bounds(problem: Any, first: Any, width: Any, x: Any, c: Any) -> Any:
    """Log of the mass of an atom's own sizes inside their bounds, over the prior's."""
    out = 0.0
    e = np.empty(width)
    for a in range(width):
        low, high = problem.low[first + a], problem.high[first + a]
        if low < -1e29 and high > 1e29:
            continue
        variance = 0.0
        for i in range(width):
            s = 1.0 if i == a else 0.0
            for m in range(i):
                s -= c[i, m] * e[m]
            e[i] = s / c[i, i]
            variance += e[i] * e[i]
        deviation = math.sqrt(2.0 * variance)
        mass = 0.5 * (math.erf((high - x[a]) / deviation) - math.erf((low - x[a]) / deviation))
        out += math.log(max(mass, 1e-300)) - problem.mass[first + a]
        spread = math.sqrt(variance)
        if x[a] < low - spread or x[a] > high + spread:
            out -= _NEVER
    return out


@LazyKernel
def _drives_out(problem: Any, width: Any, n: Any, x: Any, room: Any) -> Any:
    """Whether an atom of sizes x would drive a size of the model out of its bounds."""
    v, u = room.cross, np.empty(n)
    for i in range(n - 1, -1, -1):
        s = 0.0
        for a in range(width):
            s += v[i, a] * x[a]
        for m in range(i + 1, n):
            s -= room.factor[m, i] * u[m]
        u[i] = s / room.factor[i, i]
        c = room.columns[i]
        low, high = problem.low[c], problem.high[c]
        if low > -1e29 or high < 1e29:
            chance = _BY_CHANCE / math.sqrt(problem.gram[c, c] + problem.precision[c])
            now = room.sizes[i]
            inside = low - chance <= now <= high + chance
            if inside and not (low - chance <= now - u[i] <= high + chance):
                return True
    return False


@LazyKernel
def _is_needed(problem: Any, state: Any, group: Any) -> Any:
    """Whether a group of the model cannot be without this one."""
    for g in range(len(state)):
        if problem.needs[g] == group and state[g] >= 0:
            return True
    return False


@LazyKernel
def _may_enter(problem: Any, state: Any, group: Any, leaving: Any) -> Any:
    """Whether a group that is not in the model has what it needs while another leaves."""
    if group != leaving and state[group] >= 0:
        return False
    need = problem.needs[group]
    return need < 0 or (state[need] >= 0 and need != leaving)


@LazyKernel
def _ascend_to_mode(problem: Any, state: Any, room: Any) -> Any:  # noqa: C901, PLR0912
    """Ascent to a mode: what gains most enters, then each slot takes what fits it best, until nothing changes."""
    n_groups = len(state)
    for _ in range(120):
        n = _solve_model(problem, state, -1, room)
        if n > _MOST - 3 * _WIDEST:
            break
        best, pick = 1e-6, -1
        for g in range(n_groups):
            if _may_enter(problem, state, g, -1):
                for a in range(problem.begin[g], problem.begin[g] + problem.n_atoms[g]):
                    w = _atom_gain(problem, a, n, room)
                    if w > best:
                        best, pick = w, a
        if pick >= 0:
            state[problem.group[pick]] = pick
        changed = pick >= 0
        for g in range(n_groups):
            if state[g] < 0:
                continue
            stuck = _is_needed(problem, state, g)
            n = _solve_model(problem, state, g, room)
            own = state[g]
            best, new = -1e300 if stuck else 0.0, -1
            w = _atom_gain(problem, own, n, room)
            if w > best:
                best, new = w, own
            for k in range(n_groups):
                if k != g and (stuck or not _may_enter(problem, state, k, g)):
                    continue
                for a in range(problem.begin[k], problem.begin[k] + problem.n_atoms[k]):
                    w = _atom_gain(problem, a, n, room)
                    if w > best + 0.05:
                        best, new = w, a
            if new != own:
                state[g] = -1
                changed = True
                if new >= 0:
                    state[problem.group[new]] = new
        if not changed:
            break


@LazyKernel
def _draw_group(problem: Any, state: Any, g: Any, n: Any, draw: Any, weight: Any, room: Any) -> Any:
    """Log weights of a group's atoms beside a solved model; returns the drawn one, the top and the total."""
    begin, end = problem.begin[g], problem.begin[g] + problem.n_atoms[g]
    top = 0.0
    for a in range(begin, end):
        weight[a] = _atom_gain(problem, a, n, room)
        top = max(top, weight[a])
    total = math.exp(-top)
    for a in range(begin, end):
        total += math.exp(weight[a] - top)
    left = draw * total - math.exp(-top)
    new = -1
    if left > 0.0:
        for a in range(begin, end):
            new = a
            left -= math.exp(weight[a] - top)
            if left <= 0.0:
                break
    return new, top, total


@LazyKernel
def _draw_slot(  # noqa: C901
    problem: Any, state: Any, g: Any, draw: Any, weight: Any, rivals: Any, counts: Any, room: Any
) -> Any:  # noqa: C901, RUF100
    """A group of the model leaves, and one atom of any group enters."""
    n_groups = len(state)
    n = _solve_model(problem, state, g, room)
    top = -1e300
    for k in range(n_groups):
        if k == g or _may_enter(problem, state, k, g):
            for a in range(problem.begin[k], problem.begin[k] + problem.n_atoms[k]):
                weight[a] = _atom_gain(problem, a, n, room)
                top = max(top, weight[a])
    total = 0.0
    for k in range(n_groups):
        if k == g or _may_enter(problem, state, k, g):
            for a in range(problem.begin[k], problem.begin[k] + problem.n_atoms[k]):
                total += math.exp(weight[a] - top)
    left, pick = draw * total, -1
    for k in range(n_groups):
        if k == g or _may_enter(problem, state, k, g):
            for a in range(problem.begin[k], problem.begin[k] + problem.n_atoms[k]):
                p = math.exp(weight[a] - top)
                if counts:
                    rivals[g, k] += p / total
                left -= p
                if pick < 0 and left <= 0.0:
                    pick = a
    if pick >= 0:
        state[g] = -1
        state[problem.group[pick]] = pick


@LazyKernel
def _log_posterior(problem: Any, state: Any, room: Any) -> Any:
    """Log posterior of a model up to a constant."""
    n = _solve_model(problem, state, -1, room)
    out = 0.0
    for g in range(len(state)):
        if state[g] >= 0:
            out += problem.log_prior[state[g]]
    for i in range(n):
        c = room.columns[i]
        out += 0.5 * math.log(problem.precision[c]) + problem.constant[c]
        out += 0.5 * room.z[i] * room.z[i] - math.log(room.factor[i, i])
    return out


@LazyKernel
def _run_sweeps(  # noqa: C901, PLR0912
    problem: Any, state: Any, orders: Any, draws: Any, burnt: Any, room: Any
) -> Any:  # noqa: C901, PLR0912, RUF100
    """Gibbs sweeps; the first ``burnt`` of them are not counted."""
    n_groups, n_sweeps = len(state), len(orders)
    inclusion, by_atom = np.zeros(n_groups), np.zeros(len(problem.first))
    rivals, asked = np.zeros((n_groups, n_groups)), np.zeros(n_groups)
    weight = np.empty(len(problem.first))
    states = np.full((n_sweeps - burnt, n_groups), -1, np.int64)
    best, highest = state.copy(), -1e300
    for t in range(n_sweeps):
        n, fresh = 0, False
        for i in range(n_groups):
            g = orders[t, i]
            inside = state[g] >= 0
            if not inside and not _may_enter(problem, state, g, -1):
                continue
            if inside or not fresh:
                n = _solve_model(problem, state, g, room)
            new, top, total = _draw_group(problem, state, g, n, draws[t, 0, i], weight, room)
            if t >= burnt:
                inclusion[g] += 1.0 - math.exp(-top) / total
                for a in range(problem.begin[g], problem.begin[g] + problem.n_atoms[g]):
                    by_atom[a] += math.exp(weight[a] - top) / total
            if new < 0 and inside and _is_needed(problem, state, g):
                fresh = False
            else:
                # The factor at hand is that of the others.
                fresh = new < 0
                state[g] = new
        for i in range(n_groups):
            g = orders[t, i]
            if state[g] >= 0 and not _is_needed(problem, state, g):
                if t >= burnt:
                    asked[g] += 1.0
                _draw_slot(problem, state, g, draws[t, 1, i], weight, rivals, t >= burnt, room)
        if t >= burnt:
            states[t - burnt] = state
        now = _log_posterior(problem, state, room)
        if now > highest:
            highest = now
            best[:] = state
    counted = max(n_sweeps - burnt, 1)
    for g in range(n_groups):
        for k in range(n_groups):
            rivals[g, k] /= max(asked[g], 1.0)
    return inclusion / counted, by_atom / counted, rivals, states, best


@LazyKernel
def _atom_gains(problem: Any, state: Any, room: Any) -> Any:
    """What each atom would gain beside a model, ``(n_atoms,)``."""
    n = _solve_model(problem, state, -1, room)
    out = np.empty(len(problem.first))
    for a in range(len(out)):
        out[a] = _atom_gain(problem, a, n, room)
    return out


def gains_beside(problem: Problem, state: Indices) -> Array:
    """Log marginal likelihood ratio of each atom beside a model, its prior odds in it, ``(n_atoms,)``."""
    return np.asarray(_atom_gains(problem, state, _make_room()))


def find_mode(problem: Problem, state: Indices) -> Indices:
    """The mode that an ascent from a model reaches, ``(n_groups,)``."""
    state = state.copy()
    _ascend_to_mode(problem, state, _make_room())
    return state


def draw_models(problem: Problem, state: Indices, sweeps: int, burnt: int, rng: np.random.Generator) -> Draws:
    """Draw models by Gibbs sampling.

    Args:
        state: ``(n_groups,)`` where to begin.
        sweeps: over all groups and all slots, those that are burnt among them.
        burnt: that are not counted.
        rng: random numbers.
    """
    n = len(problem.begin)
    orders = np.array([rng.permutation(n) for _ in range(sweeps)], dtype=np.int64).reshape(sweeps, n)
    return Draws(*_run_sweeps(problem, state.copy(), orders, rng.random((sweeps, 2, n)), burnt, _make_room()))


def _make_room() -> _Workspace:
    return _Workspace(
        np.zeros((_MOST, _MOST)),
        np.zeros(_MOST),
        np.zeros(_MOST),
        np.zeros((_MOST, _WIDEST)),
        np.zeros((_WIDEST, _WIDEST)),
        np.zeros(_MOST, np.int64),
    )
