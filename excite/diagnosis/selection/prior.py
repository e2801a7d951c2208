"""Priors of the columns of effects: odds of their groups, and normal priors of their sizes, from what effects state."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Rows
from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.equations.own_columns import COULOMB
from excite.diagnosis.selection.sampler import FITTED_SIZE, AtomPrior, Indices, Problem

# Terms that a model begins with are as likely there as not; what has no name is rare.
_STARTED, _NAMELESS = 0.5, 0.03
# Deviation of a size that is one, as a gear's with its stiffness, while its shape lies on a grid.
_GRID_SIZE = 0.08
# Factor by which it may differ from one: a soft gear of size 0.4 took the place of another's play.
_AT_MOST = 2.0
# Deviation of the logarithm of a shape about its best value.
_SHAPE = 0.4
# Random bodies: how far their centres lie from the joint, and their own extent [m]; torques in units of the gap.
_CENTRE, _EXTENT, _BODY = 0.15, 0.05, 4.0

# Precision of what every model has, and least share of a column's power that is beside it: rounding, no more.
_FLAT, _LEAST = 1e-9, 1e-6

Key = tuple[str, str]


def group_of(term: Term) -> Key:
    """The group of a term: at most one of its atoms is in a model."""
    return term.effect.belief.group or term.name, term.location


@dataclass(frozen=True, eq=False)
class Atom:
    """A term with its prior, and with the change of its contribution with its shape where that is fitted.

    Attributes:
        term: the term.
        columns: by joint, ``(n_rows, width)``: the term's, then those of its shape's logarithms.
        own: number of the term's columns.
        mean: ``(width,)`` prior.
        precision: ``(width,)`` prior.
        low: ``(width,)`` bounds; ``high`` alike.
        high: ``(width,)``.
        log_prior: log odds against none.
        turned: ``(own, own)`` the term's parameters from the atom's; None where these are the same.
    """

    term: Term
    columns: Mapping[int, Array]
    own: int
    mean: Array
    precision: Array
    low: Array
    high: Array
    log_prior: float = 0.0
    turned: Array | None = None

    @property
    def n_cols(self) -> int:
        """Number of columns."""
        return len(self.mean)

    def term_parameters(self, x: Array) -> Array:
        """The term's parameters, from sizes ``(width,)`` of the atom's columns."""
        own = x[: self.own]
        return own if self.turned is None else self.turned @ own


@dataclass(frozen=True, eq=False)
class Slab:
    """The unit of an effect's torque: the gap of its joints, beside what every model takes up by itself.

    Of a gain most is taken up by bodies that are identified along, of a spring by a constant: what is left is what
    makes the gap, and what is to be as large as it (Zellner 1986, prior by the design's own moments).

    Attributes:
        always: by joint, ``(n_fitted, k_j)`` columns that every model has, in units of the gap.
        index: by joint, where they stand among all.
        factor: of their normal matrix.
        use: rows that are fitted.
        gap: ``(n_joints,)`` RMS of what is left without any effect.
    """

    always: tuple[Array, ...]
    index: tuple[Indices, ...]
    factor: tuple[Array, bool]
    use: NDArray[np.bool_]
    gap: Array

    @classmethod
    def of_rows(cls, rows: Rows, gap: Array) -> Slab:
        """The unit of a record's effects."""
        use, shared = rows.block >= 0, rows.shared.shape[2]
        own = np.cumsum([shared, *(o.shape[1] for o in rows.own)])
        n = int(own[-1])
        inner = np.diag(np.r_[np.ones(shared), np.full(n - shared, _FLAT)])
        always, index = [], []
        for j, block in enumerate(rows.own):
            always.append(np.column_stack([rows.shared[j][use], block[use]]) / gap[j])
            index.append(np.r_[0:shared, own[j] : own[j + 1]].astype(np.int64))
            inner[np.ix_(index[j], index[j])] += always[j].T @ always[j]
        factor = cho_factor(inner) if n else (inner, False)
        return cls(tuple(always), tuple(index), factor, use, gap)

    def column_moments(self, columns: Mapping[int, Array]) -> Array:
        """Mean products of columns beside what every model has, in units of the gap, ``(size, size)``."""
        parts = {j: block[self.use] / self.gap[j] for j, block in columns.items()}
        whole = np.asarray(sum(part.T @ part for part in parts.values()))
        rest = whole
        if len(self.factor[0]):
            cross = np.zeros((len(self.factor[0]), len(whole)))
            for j, part in parts.items():
                cross[self.index[j]] += self.always[j].T @ part
            rest = whole - cross.T @ cho_solve(self.factor, cross)
        least = _LEAST * np.diag(np.diag(whole))
        return np.asarray((0.5 * (rest + rest.T) + least) / max(int(self.use.sum()), 1))


def atom_of(term: Term, slab: Slab, changes: Sequence[Mapping[int, Array]] = ()) -> Atom:
    """A term with its prior: a torque as large as the gap of its joints, sizes as believed.

    Args:
        slab: the unit of its torque.
        changes: by shape parameter, the change of its contribution with the parameter's logarithm, by joint.
    """
    if term.effect.is_body and term.direction is None:
        return _body_atom(term, slab)
    columns, n, turned = dict(term.columns), term.n_free, None
    if term.known:
        deviation = FITTED_SIZE if changes else _GRID_SIZE
        mean, precision = np.ones(1), np.full(1, deviation**-2.0)
        low, high = mean / _AT_MOST, mean * _AT_MOST
    else:
        mean, kept = np.zeros(n), list(term.kept)
        moment = slab.column_moments(columns)
        moment[np.diag_indices(n)] += term.prior_precision + (term.scale / term.effect.belief.width) ** 2
        precision = np.maximum(np.diag(moment), 1e-30)
        low = np.array([p.low for p in term.effect.linear])[kept] / term.scale
        high = np.array([p.high for p in term.effect.linear])[kept] / term.scale
        if term.effect.stands_in and term.effect.timing:
            # A secant is that of a delay of its own length.
            mean = np.array([term.theta[0]]) / term.scale
            precision = (2.0 / mean) ** 2
        elif n > 1 and np.isinf(low).all() and np.isinf(high).all():
            # What is told apart by no bounds may be told by any of its directions.
            turned = np.linalg.inv(np.linalg.cholesky(moment)).T
            columns = {j: block @ turned for j, block in columns.items()}
            precision = np.ones(n)
    if changes:
        for j in set(columns).union(*changes):
            rows = len(next(iter(term.columns.values())))
            moved = [change.get(j, np.zeros(rows)) for change in changes]
            columns[j] = np.column_stack([columns.get(j, np.zeros((rows, n))), *moved])
        k = len(changes)
        mean, precision = np.append(mean, np.zeros(k)), np.append(precision, np.full(k, _SHAPE**-2.0))
        low, high = np.append(low, np.full(k, -np.inf)), np.append(high, np.full(k, np.inf))
    return Atom(term, columns, n, mean, precision, low, high, turned=turned)


def _body_atom(term: Term, slab: Slab) -> Atom:
    """A body as a draw of random bodies, as heavy as a link, of a torque as large as a few gaps of its joints.

    It is no lighter than what makes one gap: links weigh nothing where torques are a difference of two runs. Ten free
    numbers cost 50 nats and lose to three wrong lengths; of ten that are a body's few are free.
    """
    turned = _random_bodies(term) / term.scale[:, None]
    columns = {j: block @ turned for j, block in term.columns.items()}
    inertias = term.context.baseline.samples.robot.model.inertias
    mass = float(np.mean([inertia.mass for inertia in list(inertias)[1:]]))
    n = term.n_free
    moment = slab.column_moments(columns)
    precision = moment / _BODY**2 + np.eye(n) / max(mass**2, 1.0 / np.diag(moment).max())
    unit = np.linalg.inv(np.linalg.cholesky(precision)).T
    free = np.full(n, np.inf)
    columns = {j: block @ unit for j, block in columns.items()}
    return Atom(term, columns, n, np.zeros(n), np.ones(n), -free, free, turned=turned @ unit)


def _random_bodies(term: Term, count: int = 400) -> Array:
    """Lower triangular root of the second moments of random bodies' ten parameters, those that are kept."""
    rng = np.random.default_rng(3)
    mass, centre = rng.exponential(1.0, count), _CENTRE * rng.normal(size=(count, 3))
    square = (_EXTENT * rng.uniform(0.3, 1.5, (count, 3))) ** 2
    x, y, z = centre.T
    about = np.column_stack([y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y])
    about[:, [0, 2, 5]] += square[:, [1, 0, 0]] + square[:, [2, 2, 1]]
    made = (np.column_stack([np.ones(count), centre, about]) * mass[:, None])[:, list(term.kept)]
    size = made.T @ made / count
    return np.asarray(np.linalg.cholesky(size + 1e-12 * np.eye(len(size))))


def with_odds(atoms: Iterable[Atom]) -> list[Atom]:
    """Atoms, those of a group neighbours, with the odds that their group has, shared among them."""
    groups: dict[Key, list[Atom]] = {}
    for atom in atoms:
        groups.setdefault(group_of(atom.term), []).append(atom)
    made = []
    for members in groups.values():
        first = members[0].term
        chance = max(atom.term.effect.belief.chance for atom in members)
        if any(atom.term.started for atom in members):
            chance = _STARTED
        elif first.effect.nameless:
            chance = _NAMELESS
        odds = float(np.log(chance / (1.0 - chance)) - np.log(len(members)))
        made += [replace(atom, log_prior=odds) for atom in members]
    return made


def groups_of(atoms: Sequence[Atom]) -> list[Key]:
    """Groups of atoms that stand group by group, in their order."""
    return list(dict.fromkeys(group_of(atom.term) for atom in atoms))


def problem_of(atoms: Sequence[Atom], gram: Array, right: Array) -> Problem:
    """The selection problem of atoms that stand group by group.

    Args:
        atoms: with their odds.
        gram: ``(n, n)`` of all their columns, with what every model has integrated out.
        right: ``(n,)``.
    """
    groups = groups_of(atoms)
    number = {key: g for g, key in enumerate(groups)}
    group = np.array([number[group_of(atom.term)] for atom in atoms], dtype=np.int64)
    priors = [AtomPrior(a.mean, a.precision, a.low, a.high, a.log_prior) for a in atoms]
    return Problem.of_atoms(priors, group, _prerequisite_groups(atoms, number), gram, right)


def _prerequisite_groups(atoms: Sequence[Atom], number: Mapping[Key, int]) -> Indices:
    """By group, that of the Coulomb friction which its effects grow on, where the model does not begin with one."""
    needs = np.full(len(number), -1, dtype=np.int64)
    dry = {
        a.term.location: group_of(a.term) for a in atoms if a.term.started and a.term.effect.term is COULOMB
    }
    for atom in atoms:
        term = atom.term
        if term.effect.friction and not term.started and term.location in dry:
            needs[number[group_of(term)]] = number[dry[term.location]]
    # Bristles and play before friction are forms of the friction itself.
    for key in dry.values():
        needs[number[key]] = -1
    return needs
