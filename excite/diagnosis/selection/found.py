"""The model of the gap of a record: what the posterior names, fitted together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.bodies import make_body_term
from excite.diagnosis.budget.fit.design import Design, Rows
from excite.diagnosis.budget.fit.joint_fit import Model, fit_model
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.library import Library
from excite.diagnosis.budget.prediction import Prediction, predict_model
from excite.diagnosis.budget.record import GapModel, Rival, rows_of
from excite.diagnosis.budget.shares import shares_of
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.standing_joints import stands_throughout
from excite.diagnosis.selection.gram import Gram, Noise, discrepancy_columns
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
from excite.diagnosis.selection.sampler import Draws, draw_models, find_mode, gains_beside
from excite.diagnosis.selection.settling import (
    Basis,
    gears_of,
    keep_predictive_terms,
    predictive_nats,
    settle_shapes,
)
from excite.diagnosis.selection.shapes import (
    RICHER,
    other_forms,
    search_further_forms,
    shape_changes,
    use_plainest_forms,
)
from excite.progress import step

# By turn: factor of the noise's variance, and white part of its spectrum.
_TURNS = ((16.0, 10.0), (4.0, 3.0), (1.0, 1.0))
# Sweeps of a turn, those that do not count, and how many times more the last one has. With 60 a scaled position planted
# in an xMate's record is named by one of three seeds, with 150 by none; longer runs were not tried.
_SWEEPS, _BURNT, _LONGER = 150, 30, 2
# How often an ascent begins again without what its sizes deny, and what that loses.
_BANS, _BANNED = 6, 1e4
# Power left of a joint, in units of its noise, from which forms are tried there that no grid tells; and of how many.
_STANDS, _TRIED = 4.0, 2
# Deviation of the discrepancy at first, in units of the gap.
_DISCREPANCY = 0.1

Atoms = dict[Key, list[Atom]]


@dataclass(frozen=True, eq=False)
class EffectPosterior:
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
    def best_atoms(self) -> tuple[int, ...]:
        """Atoms of the likeliest model."""
        return tuple(int(a) for a in self.draws.best if a >= 0)

    @property
    def best_terms(self) -> list[Term]:
        """Terms of the likeliest model."""
        return [self.gram.atoms[a].term for a in self.best_atoms]

    @property
    def probable_terms(self) -> list[Term]:
        """Those of them that most of the draws have."""
        number = {key: g for g, key in enumerate(groups_of(self.gram.atoms))}
        return [term for term in self.best_terms if self.draws.inclusion[number[group_of(term)]] >= _THERE]


class _Turn(NamedTuple):
    """A turn of the search at one power of the likelihood.

    Attributes:
        search: its state after it.
        posterior: what it drew.
        found: atoms that were found in it, for the next one.
        keys: terms that the next one begins with.
        kept: of its terms, those that would be kept.
        model: of those of them that pay for their names by how they predict blocks left out.
    """

    search: _Search
    posterior: EffectPosterior
    found: Atoms
    keys: list[Term]
    kept: list[Term]
    model: Model


@dataclass(eq=False)
class _Search:
    """State of the search."""

    full: Baseline
    modelled: tuple[str, ...]
    library: Library
    initial_context: Context
    rows: Rows
    discrepancy: tuple[Array, ...]
    noise: Noise
    slab: Slab
    initial_terms: Sequence[Term]
    candidates: Sequence[Term]
    bodies: Sequence[Term]

    @classmethod
    def begin_search(
        cls, full: Baseline, modelled: tuple[str, ...], effects: tuple[Effect, ...], floor: Array
    ) -> _Search:
        library, rows = Library(modelled, effects), rows_of(full, modelled, floor)
        residual = fit_model(Design(rows, ()), (), left_out=False).residual
        gap = np.sqrt(np.maximum((residual[:, rows.block >= 0] ** 2).mean(axis=1), floor**2))
        n = len(gap)
        noise = Noise(residual, 1.0, np.ones(n), 1.0, _DISCREPANCY * gap, floor)
        maker = TermMaker(Context(full), full.strict)
        bodies = (maker.make_term(effect, place, ()) for effect, place in library.body_places(maker.context))
        return cls(
            full,
            modelled,
            library,
            maker.context,
            rows,
            discrepancy_columns(full),
            noise,
            Slab.of_rows(rows, gap),
            library.make_initial_terms(maker),
            library.make_candidate_terms(maker, maker.context),
            [body for body in bodies if body is not None],
        )

    def run_search(self, rng: np.random.Generator) -> EffectPosterior:
        """Run all turns of the search, then once more at the power of the likelihood whose model predicts best.

        Of a model that cannot be all of the truth a likelihood of full power may prefer many effects where one predicts
        more; the power is learned by what its models say of blocks left out (Grünwald, van Ommen 2017).
        """
        first = self._run_turn(0, {}, [], rng)
        best = last = self._run_turn(1, first.found, first.keys, rng)
        for k in range(2, len(_TURNS)):
            last = self._run_turn(k, last.found, last.keys, rng)
            if self._is_worth_more(last, best):
                best = last
        again = best.search._draw_again(best, rng)
        return (again if self._is_worth_more(again, best) else best).posterior

    def _run_turn(self, k: int, found: Atoms, keys: list[Term], rng: np.random.Generator) -> _Turn:
        anneal, white = _TURNS[k]
        self.noise = replace(self.noise, anneal=anneal, white=white)
        posterior = self._draw_posterior(self._collect_atoms(found, searched=k >= 2), keys, rng)
        found, keys = self._new_terms(posterior, k)
        kept = self._keep_terms(keys, posterior)
        return _Turn(replace(self), posterior, found, keys, kept, self._fit_paying(kept))

    def _draw_again(self, turn: _Turn, rng: np.random.Generator) -> _Turn:
        """A longer run of a turn, from what it ended with."""
        atoms = self._collect_atoms(turn.found, searched=True)
        terms = self._draw_posterior(atoms, turn.keys, rng).best_terms
        gram = Gram.of_rows(self.rows, self.discrepancy, atoms, self.noise)
        draws = _sample_models(gram, terms, _LONGER * _SWEEPS, rng)
        posterior = EffectPosterior(self.full, gram, draws, self.noise, self.slab.gap)
        kept = self._keep_terms(posterior.probable_terms, posterior)
        return turn._replace(posterior=posterior, kept=kept, model=self._fit_paying(kept))

    def _is_worth_more(self, turn: _Turn, best: _Turn) -> bool:
        """Whether a turn's effects predict blocks left out better than another's, by what further ones cost.

        Where no other effects are kept, the later turn is; in other forms, unless these predict worse by what a number
        costs.
        """
        nats = predictive_nats(turn.model, best.model)
        if {term.key for term in turn.kept} <= {term.key for term in best.kept}:
            return nats > -RICHER or _forms_of(turn.kept) <= _forms_of(best.kept)
        cost, other = (sum(self._prices_of(one.model).values()) for one in (turn, best))
        return nats > max(cost - other, 0.0)

    def _prices_of(self, model: Model) -> dict[int, float]:
        """By term that not every model may begin with, the nats by which blocks left out have to be likelier with it.

        As a name has to, and by as many for each further number as a form of more numbers has to.
        """
        begun = {group_of(term) for term in self.initial_terms}
        tried = begun.union(map(group_of, (*self.candidates, *self.bodies)))
        name, terms = float(np.log(THRESHOLDS.odds * max(len(tried), 1))), model.design.terms
        return {
            k: name + RICHER * (terms[k].n_parameters - 1)
            for k in model.chosen
            if group_of(terms[k]) not in begun
        }

    def _keep_terms(self, terms: Sequence[Term], posterior: EffectPosterior) -> list[Term]:
        return _terms_with_share(choose_bodies(terms, self.full, self.rows), posterior, self.rows)

    def _fit_paying(self, kept: Sequence[Term]) -> Model:
        """Terms that pay, beside all that a model may begin with: what of that is there says nothing of effects."""
        groups = {group_of(term) for term in kept}
        begun = [term for term in self.initial_terms if group_of(term) not in groups]
        model = fit_model(Design(self.rows, (*kept, *begun)), range(len(kept) + len(begun)))
        while True:
            spare = {
                k: predictive_nats(model, _without(model, k)) - price
                for k, price in self._prices_of(model).items()
            }
            weakest = min(spare, key=lambda k: spare[k], default=None)
            if weakest is None or spare[weakest] > 0.0:
                return model
            model = _without(model, weakest)

    def _draw_posterior(
        self, atoms: list[Atom], keys: Sequence[Term], rng: np.random.Generator
    ) -> EffectPosterior:
        """Draw models from the mode that some terms lead to; the noise becomes what the likeliest leaves."""
        gram = Gram.of_rows(self.rows, self.discrepancy, atoms, self.noise)
        draws = _sample_models(gram, keys, _SWEEPS, rng)
        posterior = gram.compute_posterior([int(a) for a in draws.best if a >= 0])
        self.noise = replace(
            self.noise,
            residual=posterior.residual,
            discrepancy=posterior.estimate_discrepancy(self.noise, self.slab.gap),
            power=posterior.estimate_power_factors(self.noise),
        )
        return EffectPosterior(self.full, gram, draws, self.noise, self.slab.gap)

    def _collect_atoms(self, found: Atoms, *, searched: bool) -> list[Atom]:
        """Atoms of all groups: the grid, and what was found; a gear that was searched stands without its grid."""
        grid: Atoms = {}
        for term in (*self.initial_terms, *self.candidates, *self.bodies):
            grid.setdefault(term.key, []).append(atom_of(term, self.slab))
        for key, more in found.items():
            old = [atom for atom in grid.get(key, []) if not (searched and atom.term.known)]
            # One atom a shape: which of two that are the same is in the model would be a matter of rounding.
            begun = {(type(atom.term.effect), atom.term.theta) for atom in old if atom.term.started}
            grid[key] = [*(a for a in more if (type(a.term.effect), a.term.theta) not in begun), *old]
        return with_odds(atom for atoms in grid.values() for atom in atoms)

    def _new_terms(self, posterior: EffectPosterior, turn: int) -> tuple[Atoms, list[Term]]:
        """The likeliest model's terms with their shapes searched, made anew at what it predicts; and where to begin."""
        atoms, terms = posterior.gram.atoms, posterior.best_terms
        basis = Basis(self.full, self.rows, self.modelled, self.discrepancy, self.noise, self.slab.gap)
        settled = settle_shapes(basis, terms, once=turn == 0)
        terms, makers, now = settled.terms, settled.makers, settled.now
        sizes = [settled.company.term_sizes(i) for i in range(len(terms))]
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
        joints = self._worst_joints(terms)
        for term in search_further_forms(
            settled.basis.gram, terms, self.slab, whole, self.library.effects, joints
        ):
            found.setdefault(term.key, []).append(self._with_shape(whole, term, None))
        self._renew_grid(now, terms, gears, first=turn == 0 or turned)
        keys: list[Term] = []
        for term, x, maker in zip(terms, sizes, makers, strict=True):
            if _is_begun(term):
                continue
            again = _whole_delay(maker, term, x) or maker.remake_term(term)
            if again is None:
                continue
            again = replace(again, started=term.started)
            if term.known and not term.effect.timing:
                # What is made anew may have lost what the old column had.
                old = TermMaker(term.context, self.full.strict)
                found.setdefault(term.key, []).append(self._with_shape(old, term, x))
            found.setdefault(term.key, []).append(
                self._with_shape(maker, again, x if again.n_free == term.n_free else None)
            )
            keys.append(again)
        return found, [*keys, *(term for term in terms if _is_begun(term))]

    def _worst_joints(self, terms: Sequence[Term]) -> list[str]:
        """Joints without a gear in the model that have most left, in units of their noise."""
        use = self.rows.block >= 0
        left = (self.noise.residual[:, use] ** 2).mean(axis=1) / self.noise.floor**2
        taken = {term.location for term in terms if group_of(term)[0] == "gear"}
        names = self.full.samples.joints
        order = [int(j) for j in np.argsort(-left) if left[j] > _STANDS and names[j] not in taken]
        return [names[j] for j in order[:_TRIED]]

    def _renew_grid(self, now: Prediction, terms: Sequence[Term], gears: list[int], *, first: bool) -> None:
        """Columns of the grid at what the model predicts, where it has moved the load, and once in any case."""
        moves = any(term.effect.moves for i, term in enumerate(terms) if i not in gears)
        if first or moves:
            context = now.context_without(*gears) if moves else Context(self.full)
            maker = TermMaker(context, self.full.strict)
            self.initial_terms = self.library.make_initial_terms(maker)
            self.candidates = self.library.make_candidate_terms(maker, self.initial_context)

    def _with_shape(self, maker: TermMaker, term: Term, x: Array | None) -> Atom:
        """A term with the columns of its shape."""
        changes: list[Mapping[int, Array]] = []
        if x is not None and term.theta and not term.effect.is_body:
            changes = [change for _, change in shape_changes(maker, term, x)]
        return atom_of(term, self.slab, changes)


def _without(model: Model, k: int) -> Model:
    """A model without one of its terms."""
    return fit_model(model.design, [i for i in model.chosen if i != k], model.weight)


def _is_begun(term: Term) -> bool:
    """Whether a term is made anew with every grid, as what the model begins with is."""
    return term.started and not term.effect.along


def _whole_delay(maker: TermMaker, term: Term, x: Array) -> Term | None:
    """A delay whose size is its own length, in the place of a secant; None of other terms."""
    closer = term.effect.refined_form
    if not (term.effect.stands_in and term.effect.timing) or closer is None:
        return None
    low, high = closer.searched[0].low, closer.searched[0].high
    return maker.make_term(closer, term.location, (float(np.clip(term.to_beta(x)[0], low, high)),))


def _with_whole_delays(terms: Sequence[Term], selected: EffectPosterior, rows: Rows) -> list[Term]:
    """Terms, a delay at its own length where a secant stands for it, which tells it near its own alone."""
    model = fit_model(Design(rows, tuple(terms)), range(len(terms)), left_out=False)
    maker = TermMaker(Context(selected.full), selected.full.strict)
    return [_whole_delay(maker, term, model.term_parameters(k)) or term for k, term in enumerate(terms)]


def _sample_models(gram: Gram, begin: Sequence[Term], sweeps: int, rng: np.random.Generator) -> Draws:
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
        mode = find_mode(problem, state)
        chosen = [int(a) for a in mode if a >= 0]
        sizes = gram.compute_posterior(chosen).sizes_by_atom
        banned = [a for a in chosen if not _is_possible(gram.atoms[a], sizes[a])]
        if not banned:
            break
        # What its size denies is not there: nothing else is to lean on it.
        problem.log_prior[banned] = -_BANNED
        state[problem.group[banned]] = -1
        state[(problem.needs >= 0) & (state[problem.needs] < 0)] = -1
    return draw_models(problem, mode, sweeps, _BURNT, rng)


def _is_possible(atom: Atom, x: Array) -> bool:
    """Whether an atom's own sizes are what its effect's name says; of a body, whatever they are until it is fitted."""
    if atom.term.effect.is_body:
        return True
    return atom.term.is_possible(atom.term.context, atom.term_parameters(x))


# Probability from which an effect is in the model, and that of a rival, in units of its own, from which it is told.
_THERE, _RIVAL = 0.7, 0.05
# Share of the whole gap, or of some joint's, from which an effect is named.
_OF_ALL, _OF_A_JOINT = 0.01, 0.05
# Effects that are listed as likely by themselves.
_LISTED = 8


def build_gap_model(
    full: Baseline,
    modelled: tuple[str, ...],
    effects: tuple[Effect, ...],
    floor: Array,
    sigma: Array | None,
    rng: np.random.Generator,
) -> GapModel:
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
        selected = _Search.begin_search(full, modelled, effects, floor).run_search(rng)
    gram, draws = selected.gram, selected.draws
    rows = gram.rows
    groups = groups_of(gram.atoms)
    number = {key: g for g, key in enumerate(groups)}
    basis = Basis(
        full, rows_of(full, modelled, floor), modelled, gram.discrepancy, selected.noise, selected.gap
    )
    free = selected.probable_terms
    terms = _terms_with_share(choose_bodies(free, selected.full, rows), selected, rows)
    # A body beside what is named alone: what stood beside it may have cancelled a part of it.
    terms = _with_whole_delays(choose_bodies(terms, selected.full, rows), selected, rows)
    if _forms_of(terms) != _forms_of(free):
        selected, rows, terms = _settle_again(basis, terms, selected)
    if sigma is not None:
        model = fit_model(Design(rows, tuple(terms)), range(len(terms)))
        forms = partial(_forms_beside, selected, rows)
        real = keep_predictive_terms(model, selected.full, sigma, forms, rng)
        same, terms = _forms_of(real) == _forms_of(terms), real
        if not same:
            selected, rows, terms = _settle_again(basis, terms, selected)
    # With shapes that have settled anew, and without what has gone, another may leave more of what judges.
    fewer = _terms_with_share(terms, selected, rows)
    if _forms_of(fewer) != _forms_of(terms):
        selected, rows, terms = _settle_again(basis, fewer, selected)
    late = _find_delay(terms, selected, rows, effects)
    if late is not None:
        selected, rows, terms = _settle_again(basis, [*terms, late[0]], selected)
    kept = {group_of(term) for term in terms}
    others: list[Term] = []
    rivals: dict[int, tuple[Rival, ...]] = {}
    nats: dict[int, float] = {}
    for k, term in enumerate(terms):
        if late is not None and term.effect.timing:
            nats[k] = late[1]
            continue
        chance = float(np.clip(draws.inclusion[number[group_of(term)]], 1e-12, 1.0 - 1e-12))
        nats[k] = float(np.log(chance / (1.0 - chance)))
        found = _likely_rivals(terms, k, selected, rows)
        first = len(terms) + len(others)
        rivals[k] = tuple(Rival(first + i, odds) for i, (_, odds) in enumerate(found))
        others += [like for like, _ in found]
    # How large others would have to be to show is asked of their columns beside the model.
    small = [a.term for a in gram.atoms if a.term.n_free == 1 and a.term.own is not None and not a.term.known]
    small = [term for term in small if group_of(term) not in kept]
    model = fit_model(Design(rows, (*terms, *others, *small)), range(len(terms)))
    now = predict_model(selected.full, model)
    return GapModel(model, nats, rivals, len(groups), selected.full, now, _rank_single_terms(selected))


def _forms_of(terms: Sequence[Term]) -> set[tuple[Key, type[Effect], tuple[int, ...]]]:
    """Names, places and forms of terms."""
    return {(term.key, type(term.effect), tuple(term.kept)) for term in terms}


def _likely_rivals(
    terms: Sequence[Term], k: int, selected: EffectPosterior, rows: Rows
) -> list[tuple[Term, float]]:
    """What may be in the place of the ``k``-th term, and its odds."""
    groups, kept = groups_of(selected.gram.atoms), {group_of(term) for term in terms}
    g = groups.index(group_of(terms[k]))
    instead, rest = selected.draws.rivals[g], (*terms[:k], *terms[k + 1 :])
    found = []
    for other in np.argsort(-instead):
        if instead[other] < _RIVAL or other == g or groups[other] in kept:
            continue
        like = _possible_term(_likeliest_term(selected, int(other)), rest, selected, rows)
        if like is not None and not like.effect.nameless:
            found.append((like, float(instead[other] / max(instead[g], 1e-6))))
    return found


def _settle_again(
    basis: Basis, terms: Sequence[Term], selected: EffectPosterior
) -> tuple[EffectPosterior, Rows, list[Term]]:
    """Terms of which others have gone, begun anew from what is fitted without any, in their plainest forms.

    What stood beside them has bent their shapes, what they are made of and how friction changes sign: the posterior's
    baseline and rows follow.
    """
    maker = TermMaker(Context(basis.full), basis.full.strict)
    again = [term if term.effect.is_body else maker.remake_term(term) or term for term in terms]
    settled = settle_shapes(basis, again, once=False)
    now = settled.basis
    plain = use_plainest_forms(now.gram, settled.terms, now.slab)
    selected = replace(selected, full=now.full)
    return selected, now.rows, choose_bodies(plain, now.full, now.rows)


def _find_delay(
    terms: Sequence[Term], selected: EffectPosterior, rows: Rows, effects: Sequence[Effect]
) -> tuple[Term, float] | None:
    """A delay of the whole torque by which blocks left out are predicted, with its log odds; None where none is.

    Whitened rows tell a delay by the instants at which friction changes sign, which are late or early for reasons of
    their own: beside a model without one it is asked of rows that count alike.
    """
    if any(term.effect.timing for term in terms):
        return None
    without = fit_model(Design(rows, tuple(terms)), range(len(terms)))
    now = predict_model(selected.full, without)
    maker = TermMaker(now.context, selected.full.strict)
    best: Term | None = None
    most = 0.0
    for effect in effects:
        whole = effect.refined_form if effect.timing and effect.stands_in else None
        if whole is None:
            continue
        chance, grid = effect.belief.chance, effect.search_grid(now.context, "torque")
        price = float(np.log((1.0 - chance) / chance * len(grid)))
        for term in (maker.make_term(whole, "torque", theta) for theta in grid):
            if term is None or not term.is_possible(now.context, np.ones(1)):
                continue
            both = fit_model(Design(rows, (*terms, term)), range(len(terms) + 1))
            odds = predictive_nats(both, without) - price
            if odds > most:
                best, most = term, odds
    return None if best is None else (best, most)


def _torque_scale(full: Baseline) -> Array:
    """Standard deviation of each torque in the trials that are fitted; infinite of joints that stand throughout."""
    samples = full.samples
    tau = samples.to_rows([trial.measured_torque for trial in samples.trials])[samples.identification_rows]
    return np.where(stands_throughout(samples), np.inf, np.maximum(tau.std(axis=0), 1e-9))


def _likeliest_term(selected: EffectPosterior, group: int) -> Term:
    """The likeliest atom's term of a group."""
    groups = groups_of(selected.gram.atoms)
    own = [a for a, atom in enumerate(selected.gram.atoms) if group_of(atom.term) == groups[group]]
    return selected.gram.atoms[max(own, key=lambda a: selected.draws.by_atom[a])].term


def choose_bodies(terms: Sequence[Term], full: Baseline, rows: Rows) -> list[Term]:
    """Terms, each body of them the likeliest that can exist beside the others that are in.

    Bodies enter one at a time, the one with which blocks left out are predicted best, as long as that is better: free
    numbers of several links share out between them what one body makes.

    Args:
        terms: of a model.
        full: what every model begins with, fitted.
        rows: of the record.
    """
    kept = [term for term in terms if not term.effect.is_body]
    outside = [term for term in terms if term.effect.is_body]
    if not outside:
        return kept
    model = fit_model(Design(rows, tuple(kept)), range(len(kept)))
    while outside:
        entered: tuple[float, Term, Term, Model] | None = None
        for term in outside:
            body = _make_body(term, kept, full, rows)
            if body is None:
                continue
            larger = fit_model(Design(rows, (*kept, body)), range(len(kept) + 1))
            nats = predictive_nats(larger, model)
            if nats > (entered[0] if entered else 0.0):
                entered = nats, term, body, larger
        if entered is None:
            break
        _, term, body, model = entered
        kept.append(body)
        outside.remove(term)
    return kept


def _possible_term(term: Term, others: Sequence[Term], selected: EffectPosterior, rows: Rows) -> Term | None:
    """A term; of a body the likeliest that can exist beside others, None where there is none."""
    if not term.effect.is_body or term.direction is not None:
        return term
    return _make_body(term, others, selected.full, rows)


def _make_body(term: Term, others: Sequence[Term], full: Baseline, rows: Rows) -> Term | None:
    """The likeliest body at a term's link that can exist beside others; None where none says anything."""
    maker = TermMaker(Context(full), full.strict)
    model = fit_model(Design(rows, tuple(others)), range(len(others)), left_out=False)
    return make_body_term(model, maker, term.effect, term.location)


def _terms_with_share(terms: Sequence[Term], selected: EffectPosterior, rows: Rows) -> list[Term]:
    """Terms whose sizes are what their names say, that take a share of the gap and leave less of what judges.

    What leaves more of what judges goes first, one at a time: friction that drifts with time fits its own trials and
    denies the dry friction beside it in the others.
    """
    kept, changed = list(terms), set[Key]()
    scale, context = _torque_scale(selected.full), Context(selected.full)
    while kept:
        model = fit_model(Design(rows, tuple(kept)), range(len(kept)))
        cannot = [k for k, term in enumerate(kept) if not term.is_possible(context, model.term_parameters(k))]
        if cannot:
            term = kept.pop(min(cannot, key=model.taken_by))
            forms = _possible_forms(term, kept, selected, rows, context)
            like = None if term.key in changed else next(forms, None)
            if like is not None:
                kept.append(like)
                changed.add(like.key)
            continue
        worth = _relative_worth(model, rows.floor, scale)
        # What a model may begin with goes where it leaves no less of what judges.
        small = [k for k, term in enumerate(kept) if worth[k] < 1.0 and not (term.started and worth[k] > 0.0)]
        if not small:
            break
        del kept[min(small, key=lambda k: worth[k])]
    return kept


def _possible_forms(
    term: Term, others: Sequence[Term], selected: EffectPosterior, rows: Rows, context: Context
) -> Iterator[Term]:
    """A term, its law's plain form and forms with a part of its numbers, if sizes beside others are as names say.

    Of a term that cannot be itself, each form of no more numbers.
    """

    def sizes_of(like: Term) -> Array:
        model = fit_model(Design(rows, (*others, like)), range(len(others) + 1), left_out=False)
        return model.term_parameters(len(others))

    def is_possible(like: Term) -> bool:
        return like.is_possible(context, sizes_of(like))

    own, sizes = term.effect, sizes_of(term)
    itself = term.is_possible(context, sizes)
    if itself:
        yield term
    # Beside what has gone a shape that follows from its size was that of another size.
    anew = TermMaker(term.context, selected.full.strict).shape_at_size(term, sizes)
    if anew is not term and is_possible(anew):
        yield anew
    for like in _other_forms(selected, term):
        part = set(like.effect.linear) < set(own.linear) and like.effect.searched == own.searched
        plain = type(like.effect) is type(EFFECTS.get(term.name))
        if (part or plain or (not itself and like.n_parameters <= term.n_parameters)) and is_possible(like):
            yield like


def _forms_beside(
    selected: EffectPosterior, rows: Rows, term: Term, others: Sequence[Term]
) -> Iterator[Term]:
    """The likeliest body in the place of free numbers, and other forms of a term's law."""
    body = _possible_term(term, others, selected, rows)
    if body is not None and body is not term:
        yield body
    yield from _other_forms(selected, term)


def _other_forms(selected: EffectPosterior, term: Term) -> Iterator[Term]:
    """The likeliest atom of each other form of a term's law."""
    atoms, tried = selected.gram.atoms, {type(term.effect)}
    for a in np.argsort(-selected.draws.by_atom):
        like = atoms[int(a)].term
        if group_of(like) == group_of(term) and type(like.effect) not in tried:
            tried.add(type(like.effect))
            yield like


def _relative_worth(model: Model, floor: Array, scale: Array) -> Array:
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


def _rank_single_terms(selected: EffectPosterior) -> tuple[Term, ...]:
    """Terms by their gain beside friction and constants alone, best first."""
    gram = selected.gram
    problem = problem_of(gram.atoms, gram.gram, gram.reduced)
    state = np.full(len(problem.begin), -1, dtype=np.int64)
    for a in selected.best_atoms:
        if gram.atoms[a].term.started:
            state[problem.group[a]] = a
    gains = gains_beside(problem, state)
    best: dict[tuple[str, str], Term] = {}
    for a in np.argsort(-gains):
        term = gram.atoms[a].term
        if not (term.started or term.effect.nameless or term.effect.is_body):
            best.setdefault(term.key, replace(term))
    return tuple(best.values())[:_LISTED]
