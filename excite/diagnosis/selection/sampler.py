"""Which atoms of which groups are in the model: ascent to a mode and Gibbs sampling, on one Gram matrix.

A group is an effect at a place. Its atoms are points of its non-linear parameters and other forms of its law, of
which at most one is in the model. With the columns that every model has integrated out, the log marginal likelihood
of a model with the columns S is

    ½ hᵀ Λ⁻¹ h − ½ log|Λ| + ½ log|P| + Σ c,    Λ = A_SS + P_S,

A the Gram matrix, h the right side, P the prior's precisions. Sizes have bounds: an atom counts by the posterior mass
of its own size inside them, and one that would drive a size of the model out of its bounds does not enter.

Both moves are exact Gibbs steps (George, McCulloch 1993): a group is drawn from {none, its atoms} given all others;
and a slot of the model, drawn by chance, takes one of all atoms of all groups that are not in it, which exchanges one
name for another at once. What the second draws from is the list of rivals.

What a model leaves of every column is kept beside its Cholesky factor L. Without a group G of it that is to leave, it
leaves what stands along an orthonormal basis Q of the columns L⁻¹ E_G too, as

    Λ⁻¹ − Λ⁻¹ E_G (E_Gᵀ Λ⁻¹ E_G)⁻¹ E_Gᵀ Λ⁻¹ = L⁻ᵀ (I − Q Qᵀ) L⁻¹

is the inverse without it: what an atom would gain beside all other groups is a matter of its own columns along Q. Where
the group does leave, Givens' rotations order the factor anew with it as the last (Golub, Van Loan 2013, §6.5.4).
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
# Sweeps after which a model is built anew, so that rounding does not add up: on ten problems of two machines, with up
# to 80 columns in, the draws are those of building it anew at every sweep, inclusions equal to 2e-13.
_UNTIL_RENEWED = 10
# What an atom that breaks a bound loses: it never enters.
_NEVER = 1e4
# Nats of an atom that hardly ever enters, whatever it would do to others.
_NOTHING = -6.0
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


class _Model(NamedTuple):
    """A model S of n columns in the order of their elimination, and what is left of all N columns beside it.

    Attributes:
        state: ``(n_groups,)`` atom of each group, −1 for none.
        place: ``(n_groups,)`` first row of a group of the model.
        n_columns: ``(1,)`` n.
        columns: ``(n,)`` which they are, row by row.
        low: ``(n,)`` bounds of their sizes, by chance.
        high: ``(n,)``.
        factor: ``(n, n)`` L, Λ = L Lᵀ.
        crossed: ``(n, N)`` Z = L⁻¹ A_S:.
        solved: ``(n,)`` z = L⁻¹ h.
        blocks: ``(N, width)`` row by row, each atom's own block of A + P − Zᵀ Z.
        left: ``(N,)`` h − Zᵀ z.
        score: ``(1,)`` log posterior up to a constant.
        density: ``(n_atoms,)`` log prior odds of an atom with the prior density of sizes at zero.
        sizes: ``(n,)`` of the columns, zero of a group that is to leave; ``sized (1,)`` whether they are those of all.
        sized: ``(1,)``.
        n_leaving: ``(1,)`` columns of the group that is to leave.
        basis: ``(n_leaving, n)`` Qᵀ.
        back: ``(n_leaving, n)`` (L⁻ᵀ Q)ᵀ.
        along: ``(n_leaving, N)`` Qᵀ Z, of the columns that are asked.
        taken: ``(n_leaving,)`` Qᵀ z.
        matrix: ``(width, width)`` of an atom that is asked; ``small`` its Cholesky factor.
        small: ``(width, width)``.
        x: ``(N,)`` sizes of atoms that were asked; ``change`` what one of them changes in the model's, ``(n,)``.
        change: ``(n,)``.
        slopes: ``(N, n)`` what a column's size of one changes in the model's, of atoms that were ``made`` of it.
        made: ``(n_atoms,)`` the version of the model that slopes were made of.
        version: ``(1,)`` of the model.
        entering: ``(n_atoms,)`` atoms that may enter.
    """

    state: Indices
    place: Indices
    n_columns: Indices
    columns: Indices
    low: Array
    high: Array
    factor: Array
    crossed: Array
    solved: Array
    blocks: Array
    left: Array
    score: Array
    density: Array
    sizes: Array
    sized: Indices
    n_leaving: Indices
    basis: Array
    back: Array
    along: Array
    taken: Array
    matrix: Array
    small: Array
    x: Array
    change: Array
    slopes: Array
    made: Indices
    version: Indices
    entering: Indices


@LazyKernel
def _factor_block(matrix: Any, width: Any, factor: Any) -> Any:
    """Cholesky factor of a small matrix; returns the log of the determinant."""
    out = 0.0
    for a in range(width):
        for k in range(a + 1):
            s = matrix[a, k]
            for m in range(k):
                s -= factor[a, m] * factor[k, m]
            if a == k:
                factor[a, a] = math.sqrt(max(s, 1e-12))
                out += 2.0 * math.log(factor[a, a])
            else:
                factor[a, k] = s / factor[k, k]
    return out


@LazyKernel
def _change_left(problem: Any, model: Any, begin: Any, end: Any, sign: Any) -> Any:
    """What is left beside the model changes by ± what some of its rows take."""
    for atom in range(len(problem.first)):
        first, width = problem.first[atom], problem.width[atom]
        for i in range(begin, end):
            for a in range(width):
                s = sign * model.crossed[i, first + a]
                model.left[first + a] += s * model.solved[i]
                for b in range(width):
                    model.blocks[first + a, b] += s * model.crossed[i, first + b]


@LazyKernel
def _enter(problem: Any, model: Any, atom: Any) -> Any:
    """An atom enters, its columns the last."""
    first, width, n = problem.first[atom], problem.width[atom], model.n_columns[0]
    log_determinant = _factor_block(model.blocks[first : first + width], width, model.small)
    model.score[0] += model.density[atom] - 0.5 * log_determinant
    for k in range(width):
        row = n + k
        model.columns[row] = first + k
        chance = _BY_CHANCE / math.sqrt(problem.gram[first + k, first + k] + problem.precision[first + k])
        model.low[row], model.high[row] = problem.low[first + k] - chance, problem.high[first + k] + chance
        scale = 1.0 / model.small[k, k]
        model.factor[row, row] = model.small[k, k]
        model.solved[row] = scale * problem.right[first + k]
        for c in range(len(model.left)):
            model.crossed[row, c] = scale * problem.gram[first + k, c]
        for i in range(row):
            model.factor[row, i] = model.crossed[i, first + k] if i < n else model.small[k, i - n]
            s = scale * model.factor[row, i]
            model.solved[row] -= s * model.solved[i]
            for c in range(len(model.left)):
                model.crossed[row, c] -= s * model.crossed[i, c]
        model.score[0] += 0.5 * model.solved[row] ** 2
    _change_left(problem, model, n, n + width, -1.0)
    model.state[problem.group[atom]], model.place[problem.group[atom]] = atom, n
    model.n_columns[0] = n + width
    model.sized[0] = 0
    model.version[0] += 1


@LazyKernel
def _move_last(problem: Any, model: Any, group: Any) -> Any:
    """Order the rows of the model anew with a group the last, by Givens' rotations."""
    begin, width, n = model.place[group], problem.width[model.state[group]], model.n_columns[0]
    if begin + width == n:
        return
    for _ in range(width):
        for i in range(begin, n - 1):
            model.columns[i], model.columns[i + 1] = model.columns[i + 1], model.columns[i]
            model.low[i], model.low[i + 1] = model.low[i + 1], model.low[i]
            model.high[i], model.high[i + 1] = model.high[i + 1], model.high[i]
            for k in range(i + 2):
                model.factor[i, k], model.factor[i + 1, k] = model.factor[i + 1, k], model.factor[i, k]
            length = math.hypot(model.factor[i, i], model.factor[i, i + 1])
            cosine, sine = model.factor[i, i] / length, model.factor[i, i + 1] / length
            for k in range(i, n):
                one, other = model.factor[k, i], model.factor[k, i + 1]
                model.factor[k, i] = cosine * one + sine * other
                model.factor[k, i + 1] = cosine * other - sine * one
            model.factor[i, i + 1] = 0.0
            for c in range(len(model.left)):
                one, other = model.crossed[i, c], model.crossed[i + 1, c]
                model.crossed[i, c] = cosine * one + sine * other
                model.crossed[i + 1, c] = cosine * other - sine * one
            one, other = model.solved[i], model.solved[i + 1]
            model.solved[i] = cosine * one + sine * other
            model.solved[i + 1] = cosine * other - sine * one
    for g in range(len(model.state)):
        if model.state[g] >= 0 and model.place[g] > begin:
            model.place[g] -= width
    model.place[group] = n - width


@LazyKernel
def _leave(problem: Any, model: Any, group: Any) -> Any:
    """A group leaves."""
    _move_last(problem, model, group)
    begin, n = model.place[group], model.n_columns[0]
    _change_left(problem, model, begin, n, 1.0)
    model.score[0] -= model.density[model.state[group]]
    for i in range(begin, n):
        model.score[0] += math.log(abs(model.factor[i, i])) - 0.5 * model.solved[i] ** 2
    model.state[group] = -1
    model.n_columns[0] = begin
    model.sized[0] = 0
    model.version[0] += 1


@LazyKernel
def _free(problem: Any, model: Any, leaving: Any, first: Any, end: Any) -> Any:
    """Sizes of the model without a group that is to leave, −1 for none, and what some columns have along it."""
    n = model.n_columns[0]
    if leaving < 0 and model.sized[0]:
        model.n_leaving[0] = 0
        return
    width = problem.width[model.state[leaving]] if leaving >= 0 else 0
    begin = model.place[leaving] if leaving >= 0 else n
    model.n_leaving[0], model.sized[0] = width, leaving < 0
    model.sizes[:n] = model.solved[:n]
    for k in range(width):
        _set_basis(model, begin, k)
        q, taken = model.basis[k], 0.0
        for i in range(begin, n):
            taken += q[i] * model.solved[i]
        model.taken[k] = taken
        model.along[k, first:end] = 0.0
        for i in range(begin, n):
            model.sizes[i] -= taken * q[i]
            for c in range(first, end):
                model.along[k, c] += q[i] * model.crossed[i, c]
        model.back[k, :n] = q[:n]
        _solve_back(model.factor, n, model.back[k])
    _solve_back(model.factor, n, model.sizes)


@LazyKernel
def _set_basis(model: Any, begin: Any, k: Any) -> Any:
    """The k-th vector of the basis of a group whose rows begin at some one, those before it there."""
    n, q = model.n_columns[0], model.basis[k]
    _solve_unit(model.factor, begin + k, n, q)
    # Twice is enough: what is orthogonal to rounding stays so.
    for m in range(2 * k):
        other, s = model.basis[m % k], 0.0
        for i in range(begin, n):
            s += other[i] * q[i]
        for i in range(begin, n):
            q[i] -= s * other[i]
    s = 0.0
    for i in range(begin, n):
        s += q[i] * q[i]
    for i in range(begin, n):
        q[i] /= math.sqrt(s)


@LazyKernel
def _solve_unit(factor: Any, column: Any, n: Any, x: Any) -> Any:
    """Solve L x = e of one column."""
    for i in range(n):
        x[i] = 0.0
    x[column] = 1.0 / factor[column, column]
    for i in range(column + 1, n):
        s = 0.0
        for m in range(column, i):
            s += factor[i, m] * x[m]
        x[i] = -s / factor[i, i]


@LazyKernel
def _solve_back(factor: Any, n: Any, x: Any) -> Any:
    """Solve Lᵀ x = r in place."""
    for i in range(n - 1, -1, -1):
        x[i] /= factor[i, i]
        for m in range(i):
            x[m] -= factor[i, m] * x[i]


@LazyKernel
def _set_state(problem: Any, model: Any, state: Any) -> Any:
    """Build the model of a state from nothing."""
    model.n_columns[0] = 0
    model.score[0] = 0.0
    for g in range(len(state)):
        model.state[g] = -1
    for c in range(len(model.left)):
        model.left[c] = problem.right[c]
    for atom in range(len(problem.first)):
        first, width = problem.first[atom], problem.width[atom]
        model.density[atom] = problem.log_prior[atom]
        for a in range(width):
            model.density[atom] += 0.5 * math.log(problem.precision[first + a]) + problem.constant[first + a]
            for b in range(width):
                model.blocks[first + a, b] = problem.gram[first + a, first + b]
            model.blocks[first + a, a] += problem.precision[first + a]
    for g in range(len(state)):
        if state[g] >= 0:
            _enter(problem, model, state[g])


@LazyKernel
def _weigh_atoms(problem: Any, model: Any, n: Any, weight: Any) -> Any:
    """Log marginal likelihood ratios of the first n atoms that may enter, beside the model without what is free.

    Their prior odds are in them; what would drive a size of the model out of its bounds weighs next to nothing. One
    call for many atoms: to pass what a model is made of takes longer than to weigh one.
    """
    x, matrix, small = model.x, model.matrix, model.small
    for i in range(n):
        atom = model.entering[i]
        first, width = problem.first[atom], problem.width[atom]
        for a in range(width):
            x[first + a] = model.left[first + a]
            for b in range(a + 1):
                matrix[a, b] = model.blocks[first + a, b]
            for k in range(model.n_leaving[0]):
                x[first + a] += model.along[k, first + a] * model.taken[k]
                for b in range(a + 1):
                    matrix[a, b] += model.along[k, first + a] * model.along[k, first + b]
        out = model.density[atom] - 0.5 * _factor_block(matrix, width, small)
        out += 0.5 * _solve_sizes(small, first, width, x)
        out += _log_mass_in_bounds(
            problem.low, problem.high, problem.mass, first, width, x, small, model.change
        )
        weight[i] = out if model.n_columns[0] + width <= _MOST else -_NEVER
    _rule_out(problem, model, n, weight)


@LazyKernel
def _solve_sizes(factor: Any, first: Any, width: Any, x: Any) -> Any:
    """Solve L Lᵀ x = r in place of some columns; returns the square of L⁻¹ r."""
    out = 0.0
    for a in range(width):
        for m in range(a):
            x[first + a] -= factor[a, m] * x[first + m]
        x[first + a] /= factor[a, a]
        out += x[first + a] ** 2
    for a in range(width - 1, -1, -1):
        x[first + a] /= factor[a, a]
        for m in range(a):
            x[first + m] -= factor[a, m] * x[first + a]
    return out


@LazyKernel
def _log_mass_in_bounds(
    low: Any, high: Any, mass: Any, first: Any, width: Any, x: Any, factor: Any, e: Any
) -> Any:
    """Log of the mass of an atom's own sizes inside their bounds, over the prior's ``mass``; ``e`` is overwritten."""
    out = 0.0
    for a in range(width):
        c = first + a
        if low[c] < -1e29 and high[c] > 1e29:
            continue
        variance = 0.0
        for i in range(a, width):
            s = 1.0 if i == a else 0.0
            for m in range(a, i):
                s -= factor[i, m] * e[m]
            e[i] = s / factor[i, i]
            variance += e[i] * e[i]
        spread = math.sqrt(variance)
        if x[c] < low[c] - spread or x[c] > high[c] + spread:
            return -_NEVER
        deviation = math.sqrt(2.0) * spread
        inside = 0.5 * (math.erf((high[c] - x[c]) / deviation) - math.erf((low[c] - x[c]) / deviation))
        out += math.log(max(inside, 1e-300)) - mass[c]
    return out


@LazyKernel
def _rule_out(problem: Any, model: Any, n: Any, weight: Any) -> Any:  # noqa: C901
    """Of atoms that were asked, what would drive a size of the model out of its bounds weighs next to nothing."""
    rows, change, slopes = model.n_columns[0], model.change, model.slopes
    for k in range(n):
        if weight[k] <= _NOTHING:
            continue
        atom = model.entering[k]
        first = problem.first[atom]
        end = first + problem.width[atom]
        if model.made[atom] != model.version[0]:
            for a in range(first, end):
                slopes[a, :rows] = model.crossed[:rows, a]
                _solve_back(model.factor, rows, slopes[a])
            model.made[atom] = model.version[0]
        change[:rows] = 0.0
        for a in range(first, end):
            for i in range(rows):
                change[i] += slopes[a, i] * model.x[a]
        for m in range(model.n_leaving[0]):
            s = 0.0
            for a in range(first, end):
                s += model.along[m, a] * model.x[a]
            for i in range(rows):
                change[i] -= s * model.back[m, i]
        for i in range(rows):
            now, low, high = model.sizes[i], model.low[i], model.high[i]
            if low <= now <= high and not low <= now - change[i] <= high:
                weight[k] -= _NEVER
                break


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
def _list_entering(problem: Any, model: Any, leaving: Any) -> Any:
    """Number of atoms that may enter while a group leaves, its own among them; which, in ``entering``."""
    n = 0
    stuck = leaving >= 0 and _is_needed(problem, model.state, leaving)
    for g in range(len(model.state)):
        if g == leaving or (not stuck and _may_enter(problem, model.state, g, leaving)):
            for a in range(problem.begin[g], problem.begin[g] + problem.n_atoms[g]):
                model.entering[n] = a
                n += 1
    return n


@LazyKernel
def _exchange(problem: Any, model: Any, group: Any, atom: Any) -> Any:
    """A group leaves where it is in the model, and an atom enters unless it is −1."""
    if model.state[group] >= 0:
        _leave(problem, model, group)
    if atom >= 0:
        _enter(problem, model, atom)


@LazyKernel
def _ascend_to_mode(problem: Any, model: Any) -> Any:  # noqa: C901, PLR0912
    """Ascent to a mode: what gains most enters, then each slot takes what fits it best, until nothing changes."""
    state, weight = model.state, np.empty(len(problem.first))
    for _ in range(120):
        if model.n_columns[0] > _MOST - 3 * _WIDEST:
            break
        best, pick = 1e-6, -1
        _free(problem, model, -1, 0, 0)
        n = _list_entering(problem, model, -1)
        _weigh_atoms(problem, model, n, weight)
        for i in range(n):
            if weight[i] > best:
                best, pick = weight[i], model.entering[i]
        if pick >= 0:
            _enter(problem, model, pick)
        changed = pick >= 0
        for g in range(len(state)):
            if state[g] < 0:
                continue
            _free(problem, model, g, 0, len(model.left))
            own = state[g]
            best, new = -1e300 if _is_needed(problem, state, g) else 0.0, -1
            n = _list_entering(problem, model, g)
            _weigh_atoms(problem, model, n, weight)
            for i in range(n):
                if model.entering[i] == own and weight[i] > best:
                    best, new = weight[i], own
            for i in range(n):
                if weight[i] > best + 0.05:
                    best, new = weight[i], model.entering[i]
            if new != own:
                changed = True
                _exchange(problem, model, g, new)
        if not changed:
            break


@LazyKernel
def _draw_group(problem: Any, model: Any, g: Any, draw: Any, weight: Any) -> Any:
    """Log weights of a group's atoms beside the others; returns the drawn one, the top and the total."""
    begin, end = problem.begin[g], problem.begin[g] + problem.n_atoms[g]
    last = end - 1
    leaving = g if model.state[g] >= 0 else -1
    _free(problem, model, leaving, problem.first[begin], problem.first[last] + problem.width[last])
    n = end - begin
    for i in range(n):
        model.entering[i] = begin + i
    _weigh_atoms(problem, model, n, weight)
    top = max(0.0, weight[:n].max())
    total = math.exp(-top)
    for i in range(n):
        total += math.exp(weight[i] - top)
    left = draw * total - math.exp(-top)
    new = -1
    if left > 0.0:
        for i in range(n):
            new = begin + i
            left -= math.exp(weight[i] - top)
            if left <= 0.0:
                break
    return new, top, total


@LazyKernel
def _draw_slot(problem: Any, model: Any, g: Any, draw: Any, weight: Any, rivals: Any, counts: Any) -> Any:
    """A group of the model leaves, and one atom of any group enters."""
    _free(problem, model, g, 0, len(model.left))
    n, total = _list_entering(problem, model, g), 0.0
    _weigh_atoms(problem, model, n, weight)
    top = weight[:n].max() if n > 0 else 0.0
    for i in range(n):
        weight[i] = math.exp(weight[i] - top)
        total += weight[i]
    left, pick = draw * total, -1
    for i in range(n):
        if counts:
            rivals[g, problem.group[model.entering[i]]] += weight[i] / total
        left -= weight[i]
        if pick < 0 and left <= 0.0:
            pick = model.entering[i]
    if pick >= 0 and pick != model.state[g]:
        _exchange(problem, model, g, pick)


@LazyKernel
def _run_sweeps(problem: Any, model: Any, orders: Any, draws: Any, burnt: Any) -> Any:  # noqa: C901, PLR0912
    """Gibbs sweeps; the first ``burnt`` of them are not counted."""
    state = model.state
    n_groups, n_sweeps = len(state), len(orders)
    inclusion, by_atom = np.zeros(n_groups), np.zeros(len(problem.first))
    rivals, asked = np.zeros((n_groups, n_groups)), np.zeros(n_groups)
    weight = np.empty(len(problem.first))
    states = np.full((n_sweeps - burnt, n_groups), -1, np.int64)
    best, highest = state.copy(), -1e300
    for t in range(n_sweeps):
        if t % _UNTIL_RENEWED == 0:
            _set_state(problem, model, state.copy())
        for i in range(n_groups):
            g = orders[t, i]
            if state[g] < 0 and not _may_enter(problem, state, g, -1):
                continue
            new, top, total = _draw_group(problem, model, g, draws[t, 0, i], weight)
            if t >= burnt:
                inclusion[g] += 1.0 - math.exp(-top) / total
                for k in range(problem.n_atoms[g]):
                    by_atom[problem.begin[g] + k] += math.exp(weight[k] - top) / total
            if new != state[g] and not (new < 0 and _is_needed(problem, state, g)):
                _exchange(problem, model, g, new)
        # A slot is asked by chance: asked in turn they would not keep the posterior, as what left cannot return.
        n_inside = 0
        for g in range(n_groups):
            n_inside += state[g] >= 0
        for i in range(n_inside):
            place = draws[t, 1, i] * n_inside
            left, g = int(place), -1
            while left >= 0:
                g += 1
                left -= state[g] >= 0
            if not _is_needed(problem, state, g):
                if t >= burnt:
                    asked[g] += 1.0
                _draw_slot(problem, model, g, place - int(place), weight, rivals, t >= burnt)
        higher = model.score[0] > highest
        highest = max(highest, model.score[0])
        for g in range(n_groups):
            if t >= burnt:
                states[t - burnt, g] = state[g]
            if higher:
                best[g] = state[g]
    counted = max(n_sweeps - burnt, 1)
    for g in range(n_groups):
        for k in range(n_groups):
            rivals[g, k] /= max(asked[g], 1.0)
    return inclusion / counted, by_atom / counted, rivals, states, best


@LazyKernel
def _atom_gains(problem: Any, model: Any) -> Any:
    """What each atom would gain beside a model, ``(n_atoms,)``."""
    out = np.empty(len(problem.first))
    _free(problem, model, -1, 0, 0)
    for a in range(len(out)):
        model.entering[a] = a
    _weigh_atoms(problem, model, len(out), out)
    return out


def gains_beside(problem: Problem, state: Indices) -> Array:
    """Log marginal likelihood ratio of each atom beside a model, its prior odds in it, ``(n_atoms,)``."""
    return np.asarray(_atom_gains(problem, _build_model(problem, state)))


def find_mode(problem: Problem, state: Indices) -> Indices:
    """The mode that an ascent from a model reaches, ``(n_groups,)``."""
    model = _build_model(problem, state)
    _ascend_to_mode(problem, model)
    return model.state


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
    return Draws(
        *_run_sweeps(problem, _build_model(problem, state), orders, rng.random((sweeps, 2, n)), burnt)
    )


def _build_model(problem: Problem, state: Indices) -> _Model:
    n_groups, n = len(problem.begin), len(problem.right)
    model = _Model(
        state=np.full(n_groups, -1, np.int64),
        place=np.zeros(n_groups, np.int64),
        n_columns=np.zeros(1, np.int64),
        columns=np.zeros(_MOST, np.int64),
        low=np.zeros(_MOST),
        high=np.zeros(_MOST),
        factor=np.zeros((_MOST, _MOST)),
        crossed=np.zeros((_MOST, n)),
        solved=np.zeros(_MOST),
        blocks=np.zeros((n, _WIDEST)),
        left=np.zeros(n),
        score=np.zeros(1),
        density=np.zeros(len(problem.first)),
        sizes=np.zeros(_MOST),
        sized=np.zeros(1, np.int64),
        n_leaving=np.zeros(1, np.int64),
        basis=np.zeros((_WIDEST, _MOST)),
        back=np.zeros((_WIDEST, _MOST)),
        along=np.zeros((_WIDEST, n)),
        taken=np.zeros(_WIDEST),
        matrix=np.zeros((_WIDEST, _WIDEST)),
        small=np.zeros((_WIDEST, _WIDEST)),
        x=np.zeros(n),
        change=np.zeros(_MOST),
        slopes=np.zeros((n, _MOST)),
        made=np.zeros(len(problem.first), np.int64),
        version=np.ones(1, np.int64),
        entering=np.zeros(len(problem.first), np.int64),
    )
    _set_state(problem, model, state)
    return model
