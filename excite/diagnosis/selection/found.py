"""The model of the gap of a record: what the posterior names, fitted together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.bodies import body
from excite.diagnosis.budget.fit.design import Design, Rows
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.library import Library
from excite.diagnosis.budget.prediction import Prediction, predicted
from excite.diagnosis.budget.record import Found, Rival, rows_of
from excite.diagnosis.budget.shares import shares_of
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.standing_joints import stands_throughout
from excite.diagnosis.selection.gram import Gram, Noise, discrepancy_columns
from excite.diagnosis.selection.predictive import nats_of, that_predict
from excite.diagnosis.selection.prior import (
    Atom,
    Key,
    Slab,
    atom_of,
    group_of,
    groups_of,
    problem_of,
    with_odds,
)
from excite.diagnosis.selection.sampler import Draws, climb, gains_beside, sample
from excite.diagnosis.selection.settling import Basis, gears_of, settle
from excite.diagnosis.selection.shapes import (
    forms_unlike_grids,
    in_plainest_forms,
    other_forms,
    shape_changes,
)
from excite.progress import step

# By turn: factor of the noise's variance, and white part of its spectrum.
_TURNS = ((16.0, 10.0), (4.0, 3.0), (1.0, 1.0), (1.0, 1.0))
# Sweeps of a turn, those that do not count, and how many times more the last one has.
_SWEEPS, _BURNT, _LONGER = 60, 30, 4
# How often an ascent begins again without what its sizes deny, and what that loses.
_BANS, _BANNED = 6, 1e4
# Power left of a joint, in units of its noise, from which forms are tried there that no grid tells; and of how many.
_STANDS, _TRIED = 4.0, 2
# Deviation of the discrepancy at first, in units of the gap.
_DISCREPANCY = 0.1

Atoms = dict[Key, list[Atom]]


@dataclass(frozen=True, eq=False)
class Selected:
    """The posterior over a record's effects.

    Attributes:
        full: what every model begins with, fitted; its friction changes sign as beside the largest effects.
        gram: of the last turn.
        draws: of models.
        noise: of its rows.
        gap: ``(n_joints,)`` RMS without any effect.
    """

    full: Baseline
    gram: Gram
    draws: Draws
    noise: Noise
    gap: Array

    @property
    def chosen(self) -> tuple[int, ...]:
        """Atoms of the likeliest model."""
        return tuple(int(a) for a in self.draws.best if a >= 0)


@dataclass(eq=False)
class _Turns:
    """State of the search."""

    full: Baseline
    modelled: tuple[str, ...]
    library: Library
    begun_context: Context
    rows: Rows
    discrepancy: tuple[Array, ...]
    noise: Noise
    slab: Slab
    begun_terms: Sequence[Term]
    candidates: Sequence[Term]
    bodies: Sequence[Term]

    @classmethod
    def begun(
        cls, full: Baseline, modelled: tuple[str, ...], effects: tuple[Effect, ...], floor: Array
    ) -> _Turns:
        library, rows = Library(modelled, effects), rows_of(full, modelled, floor)
        residual = fit(Design(rows, ()), (), left_out=False).residual
        gap = np.sqrt(np.maximum((residual[:, rows.block >= 0] ** 2).mean(axis=1), floor**2))
        n = len(gap)
        noise = Noise(residual, 1.0, np.ones(n), 1.0, _DISCREPANCY * gap, floor)
        maker = TermMaker(Context(full), full.strict)
        bodies = (maker.make(effect, place, ()) for effect, place in library.bodies(maker.context))
        return cls(
            full,
            modelled,
            library,
            maker.context,
            rows,
            discrepancy_columns(full),
            noise,
            Slab.of(rows, gap),
            library.begun(maker),
            library.candidates(maker, maker.context),
            [body for body in bodies if body is not None],
        )

    def run(self, rng: np.random.Generator) -> Selected:
        """All turns."""
        found: Atoms = {}
        keys: list[Term] = []
        for turn, (anneal, white) in enumerate(_TURNS):
            self.noise = replace(self.noise, anneal=anneal, white=white)
            atoms = self._atoms(found, searched=turn >= 2)
            gram = Gram.of(self.rows, self.discrepancy, atoms, self.noise)
            draws = _sampled(gram, keys, _SWEEPS, rng)
            posterior = gram.posterior([int(a) for a in draws.best if a >= 0])
            self.noise = replace(
                self.noise,
                residual=posterior.residual,
                discrepancy=posterior.discrepancy(self.noise, self.slab.gap),
                power=posterior.power(self.noise),
            )
            terms = [atoms[a].term for a in posterior.chosen]
            if turn == len(_TURNS) - 1:
                gram = Gram.of(self.rows, self.discrepancy, atoms, self.noise)
                draws = _sampled(gram, terms, _LONGER * _SWEEPS, rng)
                return Selected(self.full, gram, draws, self.noise, self.slab.gap)
            found, keys = self._remade(atoms, terms, turn)
        raise AssertionError("there is a last turn")

    def _atoms(self, found: Atoms, *, searched: bool) -> list[Atom]:
        """Atoms of all groups: the grid, and what was found; a gear that was searched stands without its grid."""
        grid: Atoms = {}
        for term in (*self.begun_terms, *self.candidates, *self.bodies):
            grid.setdefault(term.key, []).append(atom_of(term, self.slab))
        for key, more in found.items():
            old = [atom for atom in grid.get(key, []) if not (searched and atom.term.known)]
            grid[key] = [*more, *old]
        return with_odds(atom for atoms in grid.values() for atom in atoms)

    def _remade(self, atoms: Sequence[Atom], terms: Sequence[Term], turn: int) -> tuple[Atoms, list[Term]]:
        """The likeliest model's terms with their shapes searched, made anew at what it predicts; and where to begin."""
        basis = Basis(self.full, self.rows, self.modelled, self.discrepancy, self.noise, self.slab.gap)
        settled = settle(basis, terms, once=turn == 0)
        terms, makers, now = settled.terms, settled.makers, settled.now
        sizes = [settled.company.sizes(i) for i in range(len(terms))]
        gears = gears_of(terms)
        turned = settled.basis is not basis
        self.full, self.rows = settled.basis.full, settled.basis.rows
        self.slab = settled.basis.slab
        found: Atoms = {}
        for term, maker in (
            other_forms(settled.basis.gram, atoms, terms, self.slab, makers) if turn >= 1 else []
        ):
            found.setdefault(term.key, []).append(self._with_shape(maker, term, None))
        whole = TermMaker(now.context, self.full.strict)
        joints = self._worst(terms)
        for term in forms_unlike_grids(
            settled.basis.gram, terms, self.slab, whole, self.library.effects, joints
        ):
            found.setdefault(term.key, []).append(self._with_shape(whole, term, None))
        self._grid_again(now, terms, gears, first=turn == 0 or turned)
        keys: list[Term] = []
        for term, x, maker in zip(terms, sizes, makers, strict=True):
            if _is_begun(term):
                continue
            again = _whole_delay(maker, term, x) or maker.again(term)
            if again is None:
                continue
            again = replace(again, started=term.started)
            if term.known and not term.effect.timing:
                # What is made anew may have lost what the old column had.
                old = TermMaker(term.context, self.full.strict)
                found.setdefault(term.key, []).append(self._with_shape(old, term, x))
            found.setdefault(term.key, []).append(
                self._with_shape(maker, again, x if again.size == term.size else None)
            )
            keys.append(again)
        return found, [*keys, *(term for term in terms if _is_begun(term))]

    def _worst(self, terms: Sequence[Term]) -> list[str]:
        """Joints without a gear in the model that have most left, in units of their noise."""
        use = self.rows.block >= 0
        left = (self.noise.residual[:, use] ** 2).mean(axis=1) / self.noise.floor**2
        taken = {term.location for term in terms if group_of(term)[0] == "gear"}
        names = self.full.samples.joints
        order = [int(j) for j in np.argsort(-left) if left[j] > _STANDS and names[j] not in taken]
        return [names[j] for j in order[:_TRIED]]

    def _grid_again(self, now: Prediction, terms: Sequence[Term], gears: list[int], *, first: bool) -> None:
        """Columns of the grid at what the model predicts, where it has moved the load, and once in any case."""
        moves = any(term.effect.moves for i, term in enumerate(terms) if i not in gears)
        if first or moves:
            context = now.without(*gears) if moves else Context(self.full)
            maker = TermMaker(context, self.full.strict)
            self.begun_terms = self.library.begun(maker)
            self.candidates = self.library.candidates(maker, self.begun_context)

    def _with_shape(self, maker: TermMaker, term: Term, x: Array | None) -> Atom:
        """A term with the columns of its shape."""
        changes: list[Mapping[int, Array]] = []
        if x is not None and term.theta and not term.effect.is_body:
            changes = [change for _, change in shape_changes(maker, term, x)]
        return atom_of(term, self.slab, changes)


def _is_begun(term: Term) -> bool:
    """Whether a term is made anew with every grid, as what the model begins with is."""
    return term.started and not term.effect.along


def _whole_delay(maker: TermMaker, term: Term, x: Array) -> Term | None:
    """A delay whose size is its own length, in the place of a secant; None of other terms."""
    closer = term.effect.closer
    if not (term.effect.stands_in and term.effect.timing) or closer is None:
        return None
    low, high = closer.searched[0].low, closer.searched[0].high
    return maker.make(closer, term.location, (float(np.clip(term.beta(x)[0], low, high)),))


def _sampled(gram: Gram, begin: Sequence[Term], sweeps: int, rng: np.random.Generator) -> Draws:
    """Models, from the mode that an ascent from some terms reaches."""
    problem = problem_of(gram.atoms, gram.gram, gram.reduced)
    groups = groups_of(gram.atoms)
    state = np.full(len(groups), -1, dtype=np.int64)
    wanted = {id(term): term for term in begin}
    for a, atom in enumerate(gram.atoms):
        if id(atom.term) in wanted:
            state[problem.group[a]] = a
    # Friction is made anew with every grid.
    started = {group_of(term) for term in begin if _is_begun(term)}
    for g, key in enumerate(groups):
        if key in started and state[g] < 0:
            state[g] = problem.begin[g]
    for g, need in enumerate(problem.needs):
        if need >= 0 and state[g] >= 0 and state[need] < 0:
            state[need] = problem.begin[need]
    for _ in range(_BANS):
        mode = climb(problem, state)
        chosen = [int(a) for a in mode if a >= 0]
        sizes = gram.posterior(chosen).sizes
        banned = [a for a in chosen if not _can_be(gram.atoms[a], sizes[a])]
        if not banned:
            break
        # What its size denies is not there: nothing else is to lean on it.
        problem.log_prior[banned] = -_BANNED
        state[problem.group[banned]] = -1
        state[(problem.needs >= 0) & (state[problem.needs] < 0)] = -1
    return sample(problem, mode, sweeps, _BURNT, rng)


def _can_be(atom: Atom, x: Array) -> bool:
    """Whether an atom's own sizes are what its effect's name says; of a body, whatever they are until it is fitted."""
    if atom.term.effect.is_body:
        return True
    return atom.term.can_be(atom.term.context, atom.parameters(x))


# Probability from which an effect is in the model, and that of a rival, in units of its own, from which it is told.
_THERE, _RIVAL = 0.7, 0.05
# Share of the whole gap, or of some joint's, from which an effect is named.
_OF_ALL, _OF_A_JOINT = 0.01, 0.05
# Effects that are listed as likely by themselves.
_LISTED = 8


def model_of_gap(
    full: Baseline,
    modelled: tuple[str, ...],
    effects: tuple[Effect, ...],
    floor: Array,
    sigma: Array | None,
    rng: np.random.Generator,
) -> Found:
    """The model of a record's gap, of all effects that the posterior over them names.

    Args:
        full: what every model begins with, fitted.
        modelled: words of ``modelled``.
        effects: that may be named.
        floor: ``(n_joints,)`` noise in the rows' band.
        sigma: ``(n_joints,)`` standard deviation of the positions' noise [rad]; None for none.
        rng: random numbers.
    """
    with step("look for effects"):
        selected = _Turns.begun(full, modelled, effects, floor).run(rng)
    gram, draws = selected.gram, selected.draws
    rows = gram.rows
    groups = groups_of(gram.atoms)
    number = {key: g for g, key in enumerate(groups)}
    sure = [a for a in selected.chosen if draws.inclusion[number[group_of(gram.atoms[a].term)]] >= _THERE]
    free = [gram.atoms[a].term for a in sure]
    terms = _with_bodies(free, selected, rows)
    terms = _of_some_share(terms, selected, rows, floor, _scale(full), Context(selected.full))
    # A body beside what is named alone: what stood beside it may have cancelled a part of it.
    whole = {term.key: term for term in free if term.effect.is_body}
    terms = _with_bodies([whole.get(term.key, term) for term in terms], selected, rows)
    basis = Basis(
        full, rows_of(full, modelled, floor), modelled, gram.discrepancy, selected.noise, selected.gap
    )
    if len(terms) < len(free):
        selected, rows, terms = _settled_anew(basis, terms, selected)
    if sigma is not None:
        model = fit(Design(rows, tuple(terms)), range(len(terms)))
        real = that_predict(model, selected.full, sigma, partial(_forms, selected), rng)
        if real != terms:
            selected, rows, terms = _settled_anew(basis, real, selected)
    late = _late(basis, terms, selected, rows, effects)
    if late is not None:
        selected, rows, terms = _settled_anew(basis, [*terms, late[0]], selected)
    kept = {group_of(term) for term in terms}
    others: list[Term] = []
    rivals: dict[int, tuple[Rival, ...]] = {}
    nats: dict[int, float] = {}
    for k, term in enumerate(terms):
        if late is not None and term.effect.timing:
            nats[k] = late[1]
            continue
        g = number[group_of(term)]
        chance = float(np.clip(draws.inclusion[g], 1e-12, 1.0 - 1e-12))
        nats[k] = float(np.log(chance / (1.0 - chance)))
        found = []
        for other in np.argsort(-draws.rivals[g]):
            odds = float(draws.rivals[g, other] / max(draws.rivals[g, g], 1e-6))
            if draws.rivals[g, other] < _RIVAL or other == g or groups[other] in kept:
                continue
            rest = (*terms[:k], *terms[k + 1 :])
            like = _that_can_be(_likeliest(selected, int(other)), rest, selected, rows)
            if like is None or like.effect.nameless:
                continue
            found.append(Rival(len(terms) + len(others), odds))
            others.append(like)
        rivals[k] = tuple(found)
    # How large others would have to be to show is asked of their columns beside the model.
    small = [a.term for a in gram.atoms if a.term.size == 1 and a.term.own is not None and not a.term.known]
    small = [term for term in small if group_of(term) not in kept]
    model = fit(Design(rows, (*terms, *others, *small)), range(len(terms)))
    now = predicted(selected.full, model)
    return Found(model, nats, rivals, len(groups), selected.full, now, _likely(selected))


def _settled_anew(
    basis: Basis, terms: Sequence[Term], selected: Selected
) -> tuple[Selected, Rows, list[Term]]:
    """Terms of which others have gone, begun anew from what is fitted without any, in their plainest forms.

    What stood beside them has bent their shapes, what they are made of and how friction changes sign: the posterior's
    baseline and rows follow.
    """
    maker = TermMaker(Context(basis.full), basis.full.strict)
    again = [term if term.effect.is_body else maker.again(term) or term for term in terms]
    settled = settle(basis, again, once=False)
    now = settled.basis
    plain = in_plainest_forms(now.gram, settled.terms, now.slab)
    return replace(selected, full=now.full), now.rows, plain


def _late(
    basis: Basis, terms: Sequence[Term], selected: Selected, rows: Rows, effects: Sequence[Effect]
) -> tuple[Term, float] | None:
    """A delay of the whole torque by which blocks left out are predicted, with its log odds; None where none is.

    Whitened rows tell a delay by the instants at which friction changes sign, which are late or early for reasons of
    their own: beside a model without one it is asked of rows that count alike. Where another effect may have taken a
    part of it, as the damping of a soft gear does, all shapes are searched anew beside it before it is judged.
    """
    if any(term.effect.timing for term in terms):
        return None
    without = fit(Design(rows, tuple(terms)), range(len(terms)))
    now = predicted(selected.full, without)
    maker = TermMaker(now.context, selected.full.strict)

    def odds(among: Rows, beside: Sequence[Term], price: float) -> float:
        both = fit(Design(among, tuple(beside)), range(len(beside)))
        return nats_of(both, without, np.zeros_like(both.predicted)) - price

    found: list[tuple[float, Term]] = []
    for effect in effects:
        whole = effect.closer if effect.timing and effect.stands_in else None
        if whole is None:
            continue
        chance, grid = effect.belief.chance, effect.grid(now.context, "torque")
        price = float(np.log((1.0 - chance) / chance * len(grid)))
        made = (maker.make(whole, "torque", theta) for theta in grid)
        delays = [term for term in made if term is not None and term.can_be(now.context, np.ones(1))]
        tried = [(odds(rows, (*terms, term), price), term) for term in delays]
        most, best = max(tried, key=lambda one: one[0], default=(-np.inf, None))
        if best is not None and any(effect.name in term.effect.confusable_with for term in terms):
            _, anew, settled = _settled_anew(basis, [*terms, best], selected)
            most = max(most, odds(anew, settled, price))
        found += [(most, best)] if best is not None and most > 0.0 else []
    most, best = max(found, key=lambda one: one[0], default=(0.0, None))
    return None if best is None else (best, most)


def _scale(full: Baseline) -> Array:
    """Standard deviation of each torque in the trials that are fitted; infinite of joints that stand throughout."""
    samples = full.samples
    tau = samples.rows([trial.measured for trial in samples.trials])[samples.identification]
    return np.where(stands_throughout(samples), np.inf, np.maximum(tau.std(axis=0), 1e-9))


def _likeliest(selected: Selected, group: int) -> Term:
    """The likeliest atom's term of a group."""
    groups = groups_of(selected.gram.atoms)
    own = [a for a, atom in enumerate(selected.gram.atoms) if group_of(atom.term) == groups[group]]
    return selected.gram.atoms[max(own, key=lambda a: selected.draws.by_atom[a])].term


def _with_bodies(terms: Sequence[Term], selected: Selected, rows: Rows) -> list[Term]:
    """Terms, each body of them the likeliest that can exist beside the others; those that cannot are left out."""
    kept: list[Term] = []
    for k, term in enumerate(terms):
        found = _that_can_be(term, (*kept, *terms[k + 1 :]), selected, rows)
        if found is not None:
            kept.append(found)
    return kept


def _that_can_be(term: Term, others: Sequence[Term], selected: Selected, rows: Rows) -> Term | None:
    """A term; of a body the likeliest that can exist beside others, None where there is none."""
    if not term.effect.is_body or term.direction is not None:
        return term
    maker = TermMaker(Context(selected.full), selected.full.strict)
    model = fit(Design(rows, tuple(others)), range(len(others)), left_out=False)
    return body(model, maker, term.effect, term.location)


def _of_some_share(
    terms: Sequence[Term], selected: Selected, rows: Rows, floor: Array, scale: Array, context: Context
) -> list[Term]:
    """Terms whose sizes are what their names say, that take a share of the gap and leave less of what judges.

    What leaves more of what judges goes first, one at a time, and each that went is asked again beside what stays:
    friction that drifts with time fits its own trials and denies the dry friction beside it in the others.
    """
    kept, gone, changed = list(terms), list[Term](), set[Key]()
    while kept:
        model = fit(Design(rows, tuple(kept)), range(len(kept)))
        cannot = [k for k, term in enumerate(kept) if not term.can_be(context, model.parameters(k))]
        if cannot:
            term = kept.pop(min(cannot, key=model.taken_by))
            forms = _forms_that_can_be(term, kept, selected, rows, context)
            like = None if term.key in changed else next(forms, None)
            if like is None:
                gone.append(term)
            else:
                kept.append(like)
                changed.add(like.key)
            continue
        worth = _worth(model, floor, scale)
        small = [k for k, term in enumerate(kept) if worth[k] < 1.0 and not term.started]
        if not small:
            break
        gone.append(kept.pop(min(small, key=lambda k: worth[k])))
    for term in reversed(gone):
        for like in _forms_that_can_be(term, kept, selected, rows, context):
            more = [*kept, like]
            model = fit(Design(rows, tuple(more)), range(len(more)))
            fits = (one.can_be(context, model.parameters(k)) for k, one in enumerate(more))
            worth = _worth(model, floor, scale)
            if all(fits) and all(w >= 1.0 or one.started for w, one in zip(worth, more, strict=True)):
                kept = more
                break
    return kept


def _forms_that_can_be(
    term: Term, others: Sequence[Term], selected: Selected, rows: Rows, context: Context
) -> Iterator[Term]:
    """A term, its law's plain form and forms with a part of its numbers, if sizes beside others are as names say.

    Of a term that cannot be itself, each form of no more numbers.
    """

    def can_be(like: Term) -> bool:
        model = fit(Design(rows, (*others, like)), range(len(others) + 1), left_out=False)
        return like.can_be(context, model.parameters(len(others)))

    own, itself = term.effect, can_be(term)
    if itself:
        yield term
    for like in _forms(selected, term):
        part = set(like.effect.linear) < set(own.linear) and like.effect.searched == own.searched
        plain = type(like.effect) is type(EFFECTS.get(term.name))
        if (part or plain or (not itself and like.n_parameters <= term.n_parameters)) and can_be(like):
            yield like


def _forms(selected: Selected, term: Term) -> Iterator[Term]:
    """The likeliest atom of each other form of a term's law."""
    atoms, tried = selected.gram.atoms, {type(term.effect)}
    for a in np.argsort(-selected.draws.by_atom):
        like = atoms[int(a)].term
        if group_of(like) == group_of(term) and type(like.effect) not in tried:
            tried.add(type(like.effect))
            yield like


def _worth(model: Model, floor: Array, scale: Array) -> Array:
    """By term, its share of the gap in units of the least that is named; how much more it leaves where that is more."""
    shares = shares_of(model, floor)
    weight = shares.open / scale**2
    weight = weight / max(float(weight.sum()), 1e-300)
    moving = np.isfinite(scale)
    made = []
    for k, value, lost in zip(model.chosen, shares.value, shares.lost, strict=True):
        own = model.design.terms[k].own
        # What acts on several joints leaves less as a mean over them; what acts on one, there.
        closes = lost[own] if own is not None else np.log1p(np.maximum(lost, -0.99)).sum()
        share = max(float(value @ weight) / _OF_ALL, float(value[moving].max(initial=0.0)) / _OF_A_JOINT)
        made.append(share if closes > 0.0 else min(float(closes), 0.0))
    return np.array(made)


def _likely(selected: Selected) -> tuple[Term, ...]:
    """What would gain most beside friction and constants alone, best first."""
    gram = selected.gram
    problem = problem_of(gram.atoms, gram.gram, gram.reduced)
    state = np.full(len(problem.begin), -1, dtype=np.int64)
    for a in selected.chosen:
        if gram.atoms[a].term.started:
            state[problem.group[a]] = a
    gains = gains_beside(problem, state)
    best: dict[tuple[str, str], Term] = {}
    for a in np.argsort(-gains):
        term = gram.atoms[a].term
        if not (term.started or term.effect.nameless or term.effect.is_body):
            best.setdefault(term.key, replace(term))
    return tuple(best.values())[:_LISTED]
