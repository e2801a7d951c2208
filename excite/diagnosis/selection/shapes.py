"""Non-linear parameters of effects in the joint fit: their tangents, Gauss and Newton's steps, other forms of a law."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from excite.arrays import Array
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.effects.effect import Effect, Theta
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.selection.gram import Gram, whiten_rows
from excite.diagnosis.selection.prior import Atom, Slab, atom_of, group_of

# Relative step of a shape's finite difference; of a wave's count, a fraction of a period over the whole range.
_STEP, _COUNT_STEP = 2e-2, 5e-4
# Largest change of a shape's logarithm in one step, and shorter ones tried where it gains nothing.
_LONGEST, _SHORTER = 0.7, (1.0, 0.4, 0.12)
# Steps at most, and nats below which the next one is not taken.
_STEPS, _ENOUGH = 4, 0.5
# A priori precision of a step of a shape's logarithm.
_DAMPING = 2.0
# Starts of another form, and nats of a term from which its other forms are tried.
_STARTS, _WORTH = 9, 8.0
# Nats by which a richer form of a law has to be better than a plain one.
RICHER = 3.0

# Share of a term's nats that another law of its place has on its grid, from which it is searched there.
_NEARLY = 0.5

Change = Mapping[int, Array]


def shape_changes(maker: TermMaker, term: Term, x: Array) -> Iterator[tuple[int, Change]]:
    """By shape parameter, the change of a term's contribution of sizes ``(size,)`` with its logarithm, by joint."""
    for i, parameter in enumerate(term.effect.searched):
        step = _COUNT_STEP if parameter.name == "periods_per_rev" else _STEP
        step = step if term.theta[i] * np.exp(step) < parameter.high else -step
        theta = (*term.theta[:i], term.theta[i] * float(np.exp(step)), *term.theta[i + 1 :])
        other = _make_at(maker, term, theta)
        if other is None:
            continue
        if term.known:
            here = there = np.ones(1)
        else:
            beta = term.to_beta(x)
            here, there = beta[list(term.kept)] / term.scale, beta[list(other.kept)] / other.scale
        rows = len(next(iter(term.columns.values())))
        nothing = np.zeros(rows)
        change = {}
        for j in term.columns.keys() | other.columns.keys():
            new = other.columns[j] @ there if j in other.columns else nothing
            old = term.columns[j] @ here if j in term.columns else nothing
            change[j] = (new - old) / step
        yield i, change


def _make_at(maker: TermMaker, term: Term, theta: Theta) -> Term | None:
    """A term at another shape."""
    whole = term.known or len(term.kept) == len(term.effect.linear)
    return maker.make_term(term.effect, term.location, theta, None if whole else term.kept)


def step_shape(maker: TermMaker, term: Term, steps: Mapping[int, float], factor: float) -> Term | None:
    """A term whose shape's logarithms have moved by a multiple of steps; None where it cannot be."""
    theta = list(term.theta)
    for i, step in steps.items():
        p = term.effect.searched[i]
        change = factor * float(np.clip(step, -_LONGEST, _LONGEST))
        theta[i] = float(np.clip(theta[i] * np.exp(change), p.low, p.high))
    made = _make_at(maker, term, tuple(theta))
    return made if made is not None and made.n_free == term.n_free else None


def is_searched(term: Term) -> bool:
    """Whether a term has a shape that is searched here."""
    begun = term.started and not term.effect.along
    return bool(term.theta) and not begun and not term.effect.timing


@dataclass(frozen=True, eq=False)
class WhiteTerm:
    """A term's whitened columns and prior, and their products with what every model has.

    Attributes:
        precision: ``(size,)`` prior.
        mean: ``(size,)`` prior.
        columns: by joint, ``(n_whitened, size)``.
        cross: ``(always, size)`` products with the columns that every model has.
        right: ``(size,)`` with the measurement.
        square: ``(size, size)`` with themselves.
    """

    precision: Array
    mean: Array
    columns: dict[int, Array]
    cross: Array
    right: Array
    square: Array

    @classmethod
    def of_columns(cls, gram: Gram, columns: Mapping[int, Array], precision: Array, mean: Array) -> WhiteTerm:
        """Columns by joint, ``(n_rows, size)``, with a prior."""
        size = len(precision)
        made = dict[int, Array]()
        cross, right, square = np.zeros((gram.always, size)), np.zeros(size), np.zeros((size, size))
        for j, block in columns.items():
            made[j] = white = _whiten_columns(gram, j, block)
            index, rows = gram.index[j], gram.white[j]
            count = int(np.searchsorted(index, gram.always))
            cross[index[:count]] += rows[:, :count].T @ white
            right += white.T @ rows[:, -1]
            square += white.T @ white
        return cls(precision, mean, made, cross, right, square)

    @classmethod
    def of_term(cls, gram: Gram, term: Term, slab: Slab) -> WhiteTerm:
        """A term as shapes are searched; kept with the products of what every model has."""
        if term not in gram.searched:
            gram.searched[term] = cls.of_columns(gram, term.columns, *_search_prior(term, slab))
        return gram.searched[term]

    def products_with(self, other: WhiteTerm) -> Array:
        """Products with another's columns, ``(size, other's)``."""
        made = np.zeros((len(self.mean), len(other.mean)))
        for j in self.columns.keys() & other.columns.keys():
            made += self.columns[j].T @ other.columns[j]
        return made


@dataclass(frozen=True, eq=False)
class SolvedTerms:
    """Some terms with what every model has, solved: what a further term is judged beside.

    Attributes:
        gram: of the record; its whitening and its columns that every model has.
        terms: the terms.
        white: of each term.
        factor: of the scaled normal matrix.
        scale: ``(n,)``.
        right: ``(n,)``.
        x: ``(n,)`` sizes.
        begin: first column of each term.
        loss: half the weighted sum of squares that is left, priors in it.
        slab: unit of their torques.
    """

    gram: Gram
    terms: tuple[Term, ...]
    white: tuple[WhiteTerm, ...]
    factor: tuple[Array, bool]
    scale: Array
    right: Array
    x: Array
    begin: Array
    loss: float
    slab: Slab

    @classmethod
    def from_terms(cls, gram: Gram, terms: Sequence[Term], slab: Slab) -> SolvedTerms:
        """Terms solved together."""
        white = tuple(WhiteTerm.of_term(gram, term, slab) for term in terms)
        always = gram.always
        begin = always + np.cumsum([0, *(term.n_free for term in terms)])
        n = int(begin[-1])
        precision = np.concatenate([gram.prior, *(one.precision for one in white)])
        mean = np.concatenate([np.zeros(always), *(one.mean for one in white)])
        right = np.concatenate([gram.right[:always], *(one.right for one in white)]) + precision * mean
        normal = np.zeros((n, n))
        normal[:always, :always] = gram.whole[:always, :always]
        for k, one in enumerate(white):
            here = slice(begin[k], begin[k + 1])
            normal[:always, here] = one.cross
            normal[here, here] = one.square
            for i, other in enumerate(white[:k]):
                normal[begin[i] : begin[i + 1], here] = other.products_with(one)
        normal = np.triu(normal) + np.triu(normal, 1).T + np.diag(precision)
        scale = np.sqrt(np.diag(normal))
        factor = cho_factor(normal / np.outer(scale, scale) + 1e-9 * np.eye(n))
        x = cho_solve(factor, right / scale) / scale
        loss = 0.5 * float(gram.square - right @ x + (precision * mean) @ mean)
        return cls(gram, tuple(terms), white, factor, scale, right, x, begin, loss, slab)

    def term_sizes(self, i: int) -> Array:
        """Sizes of the i-th term."""
        return self.x[self.begin[i] : self.begin[i + 1]]

    def column_gain(self, columns: Mapping[int, Array], precision: Array, mean: Array) -> tuple[float, Array]:
        """Nats that further columns gain beside all others, and their sizes.

        Args:
            columns: by joint, ``(n_rows, w)``.
            precision: ``(w,)`` prior.
            mean: ``(w,)`` prior.
        """
        return self._gain_of(WhiteTerm.of_columns(self.gram, columns, precision, mean))

    def gain_of(self, term: Term) -> tuple[float, Array]:
        """The same of a term."""
        return self._gain_of(WhiteTerm.of_term(self.gram, term, self.slab))

    def _gain_of(self, one: WhiteTerm) -> tuple[float, Array]:
        cross = np.concatenate([one.cross, *(other.products_with(one) for other in self.white)])
        solved = cho_solve(self.factor, cross / self.scale[:, None]) / self.scale[:, None]
        own = one.square + np.diag(one.precision) - cross.T @ solved
        right = one.right + one.precision * one.mean - solved.T @ self.right
        scale = np.sqrt(np.maximum(np.diag(own), 1e-30))
        x = np.linalg.solve(own / np.outer(scale, scale) + 1e-9 * np.eye(len(scale)), right / scale) / scale
        return 0.5 * float(right @ x) - 0.5 * float((one.precision * one.mean) @ one.mean), x


def _whiten_columns(gram: Gram, j: int, columns: Array) -> Array:
    lag, deviation = gram.filters[j]
    return np.asarray(whiten_rows(gram.rows, lag, columns) / deviation)


def _search_prior(term: Term, slab: Slab) -> tuple[Array, Array]:
    """Precision and mean of a term's sizes while shapes are searched: of a body, whatever the record asks for."""
    if not (term.effect.is_body and term.direction is None):
        atom = atom_of(term, slab)
        if atom.turned is None:
            return atom.precision, atom.mean
    return np.full(term.n_free, 1e-6) + term.prior_precision, np.zeros(term.n_free)


def search_shape(company: SolvedTerms, maker: TermMaker, term: Term) -> tuple[Term, float]:
    """A term's shape by Gauss and Newton's steps beside others that are held, and its nats."""
    gain, x = company.gain_of(term)
    for _ in range(_STEPS):
        changes = list(shape_changes(maker, term, x))
        if not changes:
            break
        own = WhiteTerm.of_term(company.gram, term, company.slab)
        rows, n = len(company.gram.rows.trial), term.n_free
        columns = {
            j: np.column_stack(
                [
                    term.columns.get(j, np.zeros((rows, n))),
                    *(c.get(j, np.zeros(rows)) for _, c in changes),
                ]
            )
            for j in set(term.columns).union(*(c for _, c in changes))
        }
        k = len(changes)
        precision, mean = np.append(own.precision, np.full(k, _DAMPING)), np.append(own.mean, np.zeros(k))
        _, both = company.column_gain(columns, precision, mean)
        steps = {i: float(s) for (i, _), s in zip(changes, both[n:], strict=True)}
        for factor in _SHORTER:
            made = step_shape(maker, term, steps, factor)
            more, size = (-np.inf, x) if made is None else company.gain_of(made)
            if made is not None and more > gain + 0.02:
                ended = more < gain + _ENOUGH
                term, gain, x = made, more, size
                break
        else:
            ended = True
        if ended:
            break
    return term, gain


def search_shapes(gram: Gram, terms: Sequence[Term], slab: Slab) -> tuple[list[Term], SolvedTerms]:
    """The shapes of all terms by Gauss and Newton's steps together, what is linear projected out (Kaufman 1975)."""
    found, company = list(terms), SolvedTerms.from_terms(gram, terms, slab)
    movable = [i for i, term in enumerate(found) if is_searched(term)]
    for _ in range(_STEPS if movable else 0):
        makers = {i: TermMaker(found[i].context, found[i].context.baseline.strict) for i in movable}
        changes = [
            (i, p, c) for i in movable for p, c in shape_changes(makers[i], found[i], company.term_sizes(i))
        ]
        if not changes:
            break
        rows = len(gram.rows.trial)
        columns = {
            j: np.column_stack([c.get(j, np.zeros(rows)) for _, _, c in changes])
            for j in range(gram.rows.n_joints)
        }
        _, both = company.column_gain(columns, np.full(len(changes), _DAMPING), np.zeros(len(changes)))
        ended = True
        for factor in _SHORTER:
            new = list(found)
            for i in movable:
                steps = {p: float(s) for (k, p, _), s in zip(changes, both, strict=True) if k == i}
                made = step_shape(makers[i], found[i], steps, factor)
                new[i] = found[i] if made is None else made
            other = SolvedTerms.from_terms(gram, new, slab)
            if other.loss < company.loss - 0.02 and not _leaves_bounds(company, other):
                ended = company.loss - other.loss < _ENOUGH
                found, company = new, other
                break
        if ended:
            break
    return found, company


def _leaves_bounds(before: SolvedTerms, after: SolvedTerms) -> bool:
    """Whether some term is what its name says before a step, and is not after it."""
    return any(
        old.is_possible(old.context, before.term_sizes(i))
        and not new.is_possible(new.context, after.term_sizes(i))
        for i, (old, new) in enumerate(zip(before.terms, after.terms, strict=True))
        if not new.effect.is_body and new.theta != old.theta
    )


def other_forms(
    gram: Gram, atoms: Sequence[Atom], terms: Sequence[Term], slab: Slab, makers: Sequence[TermMaker]
) -> list[tuple[Term, TermMaker]]:
    """Other forms of each term's law, from several starts each, those that are near it at their best.

    And other laws of its place, at their best: a shape on a grid loses to what needs none.
    """
    found = []
    for i, term in enumerate(terms):
        forms = _forms_of(term)
        if term.effect.is_body:
            continue
        company = SolvedTerms.from_terms(gram, [other for k, other in enumerate(terms) if k != i], slab)
        own = company.gain_of(term)[0]
        if own < _WORTH:
            continue
        tried = [(form, form.search_starts(term.theta)) for form in forms]
        for other in () if term.started else _other_laws(company, atoms, term, own):
            tried.append((other.effect, [other.theta]))
            tried += [(form, form.search_starts(other.theta)) for form in other.effect.extended_forms]
        for form, starts in tried:
            begun = [_make_form(makers[i], form, term, theta) for theta in starts[:_STARTS]]
            for best, gain in _best_of(company, makers[i], begun):
                if gain > own - RICHER:
                    found.append((replace(best, started=term.started), makers[i]))
    return found


def use_plainest_forms(gram: Gram, terms: Sequence[Term], slab: Slab) -> list[Term]:
    """Terms at their best shapes together, each in its law's plain form where a richer one says no more.

    What stood beside them while they were found may have bent them.
    """
    terms, _ = search_shapes(gram, terms, slab)
    for i, term in enumerate(terms):
        plain = EFFECTS.get(term.name)
        if plain is None or plain.stands_in or type(plain) is type(term.effect) or term.started:
            continue
        maker = TermMaker(term.context, term.context.baseline.strict)
        beside = SolvedTerms.from_terms(gram, [other for k, other in enumerate(terms) if k != i], slab)
        begun = [
            maker.make_term(plain, term.location, theta)
            for theta in plain.search_grid(term.context, term.location)
        ]
        best, gain = max(_best_of(beside, maker, begun), key=lambda item: item[1], default=(term, -np.inf))
        spared = term.n_parameters - best.n_parameters
        if gain > beside.gain_of(term)[0] - RICHER * spared:
            terms[i] = best
    return terms


def search_further_forms(
    gram: Gram,
    terms: Sequence[Term],
    slab: Slab,
    maker: TermMaker,
    effects: Sequence[Effect],
    joints: Sequence[str],
) -> list[Term]:
    """Richer forms where no plain one on its grid fits anything, at their best beside a model.

    Args:
        gram: of the record.
        terms: of the model.
        slab: unit of their torques.
        maker: of columns at what the model predicts.
        effects: whose forms are tried.
        joints: at which they are.
    """
    company, found = SolvedTerms.from_terms(gram, terms, slab), []
    for joint in joints:
        for effect in effects:
            for form in effect.extended_forms:
                there = joint in effect.locations(maker.context)
                starts = form.further_starts(maker.context, joint) if there else []
                begun = [maker.make_term(form, joint, theta) for theta in starts]
                found += [best for best, gain in _best_of(company, maker, begun) if gain > _WORTH]
    return found


def _best_of(
    company: SolvedTerms, maker: TermMaker, begun: Sequence[Term | None]
) -> Iterator[tuple[Term, float]]:
    """The two best of some starts, each at its own end, with its nats; without what is no longer what its name says.

    A spring that acts over the last of the travel alone is a stop.
    """
    gains = [(company.gain_of(term)[0], term) for term in begun if term is not None]
    for _, start in sorted(gains, reverse=True, key=lambda item: item[0])[:2]:
        best, gain = search_shape(company, maker, start)
        if best.effect.is_body or best.is_possible(best.context, company.gain_of(best)[1]):
            yield best, gain


def _other_laws(company: SolvedTerms, atoms: Sequence[Atom], term: Term, own: float) -> list[Term]:
    """The likeliest other law of a term's place that has a shape, as it stands on its grid."""
    taken = {group_of(other) for other in (term, *company.terms)}
    there = [
        atom.term
        for atom in atoms
        if atom.term.location == term.location and group_of(atom.term) not in taken and is_searched(atom.term)
    ]
    best = max(there, key=lambda other: company.gain_of(other)[0], default=None)
    return [] if best is None or company.gain_of(best)[0] < _NEARLY * own else [best]


def _forms_of(term: Term) -> tuple[Effect, ...]:
    """Other forms of a term's law; of what a model begins with, those that have another effect in them."""
    if not term.started:
        return (
            (*term.effect.extended_forms, *term.effect.variant_forms)
            if is_searched(term) or not term.theta
            else ()
        )
    return tuple(
        form
        for form in term.effect.extended_forms
        if form.along
        and form.is_admissible(
            term.context, term.location, form.search_starts(term.theta)[0], np.ones(len(form.linear))
        )
    )


def _make_form(maker: TermMaker, form: Effect, term: Term, theta: Theta) -> Term | None:
    """A form at one of its starts; None where it has no such one."""
    return maker.make_term(form, term.location, theta) if len(theta) == len(form.searched) else None
