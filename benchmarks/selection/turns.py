"""The posterior over all effects of a record: columns made, models sampled, shapes searched, columns made anew.

The likelihood is annealed over the turns: a shape on a grid is model error, and at full power small effects enter to
patch it up. After each turn the shapes of the likeliest model are searched together, other forms of each law each at
its best, and predictions, of which columns are made, follow the model found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.selection.gram import Gram, Noise, Posterior, discrepancy_columns
from benchmarks.selection.prior import (
    Atom,
    Key,
    Slab,
    atom_of,
    group_of,
    groups_of,
    problem_of,
    with_odds,
)
from benchmarks.selection.sampler import Draws, climb, sample
from benchmarks.selection.settling import Basis, gears_of, settle
from benchmarks.selection.shapes import (
    forms_unlike_grids,
    other_forms,
    shape_changes,
)
from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Design, Rows
from excite.diagnosis.budget.fit.joint_fit import fit
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.library import Library
from excite.diagnosis.budget.record import rows_of
from excite.diagnosis.budget.search import Prediction
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
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

    @property
    def posterior(self) -> Posterior:
        """Its parameters."""
        return self.gram.posterior(self.chosen)


@step("look for effects")
def select(
    full: Baseline,
    modelled: tuple[str, ...],
    effects: tuple[Effect, ...],
    floor: Array,
    rng: np.random.Generator,
) -> Selected:
    """Sample which effects a record has.

    Args:
        full: what every model begins with, fitted.
        modelled: words of ``modelled``.
        effects: that may be there.
        floor: ``(n_joints,)`` noise in the rows' band.
        rng: random numbers.
    """
    return _Turns.begun(full, modelled, effects, floor).run(rng)


@dataclass(eq=False)
class _Turns:
    """State of the search."""

    full: Baseline
    modelled: tuple[str, ...]
    library: Library
    rows: Rows
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
            rows,
            noise,
            Slab.of(rows, gap),
            library.begun(maker),
            library.candidates(maker),
            [body for body in bodies if body is not None],
        )

    def run(self, rng: np.random.Generator) -> Selected:
        """All turns."""
        discrepancy = discrepancy_columns(self.full)
        found: Atoms = {}
        keys: list[Term] = []
        for turn, (anneal, white) in enumerate(_TURNS):
            last = turn == len(_TURNS) - 1
            self.noise = replace(self.noise, anneal=anneal, white=white)
            atoms = self._atoms(found, searched=turn >= 2)
            gram = Gram.of(self.rows, discrepancy, atoms, self.noise)
            draws = _sampled(gram, keys, _SWEEPS, rng)
            posterior = gram.posterior([int(a) for a in draws.best if a >= 0])
            self.noise = replace(
                self.noise,
                residual=posterior.residual,
                discrepancy=posterior.discrepancy(self.noise, self.slab.gap),
                power=posterior.power(self.noise),
            )
            gram = Gram.of(self.rows, discrepancy, atoms, self.noise)
            terms = [atoms[a].term for a in posterior.chosen]
            if last:
                draws = _sampled(gram, terms, _LONGER * _SWEEPS, rng)
                return Selected(self.full, gram, draws, self.noise, self.slab.gap)
            found, keys = self._remade(gram, terms, turn)
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

    def _remade(self, gram: Gram, terms: Sequence[Term], turn: int) -> tuple[Atoms, list[Term]]:
        """The likeliest model's terms with their shapes searched, made anew at what it predicts; and where to begin."""
        basis = Basis(self.full, self.rows, self.modelled, self.noise, self.slab.gap)
        settled = settle(basis, gram, terms, once=turn == 0)
        gram, terms, makers, now = settled.gram, settled.terms, settled.makers, settled.now
        sizes = [settled.company.sizes(i) for i in range(len(terms))]
        gears = gears_of(terms)
        turned = settled.basis is not basis
        self.full, self.rows = settled.basis.full, settled.basis.rows
        self.slab = settled.basis.slab
        found: Atoms = {}
        for term, maker in other_forms(gram, terms, self.slab, makers) if turn >= 1 else []:
            found.setdefault(term.key, []).append(self._with_shape(gram, maker, term, None))
        whole = TermMaker(now.context, self.full.strict)
        joints = self._worst(gram, terms)
        for term in forms_unlike_grids(gram, terms, self.slab, whole, self.library.effects, joints):
            found.setdefault(term.key, []).append(self._with_shape(gram, whole, term, None))
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
                found.setdefault(term.key, []).append(self._with_shape(gram, old, term, x))
            found.setdefault(term.key, []).append(
                self._with_shape(gram, maker, again, x if again.size == term.size else None)
            )
            keys.append(again)
        return found, [*keys, *(term for term in terms if _is_begun(term))]

    def _worst(self, gram: Gram, terms: Sequence[Term]) -> list[str]:
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
            self.begun_terms, self.candidates = self.library.begun(maker), self.library.candidates(maker)

    def _with_shape(self, gram: Gram, maker: TermMaker, term: Term, x: Array | None) -> Atom:
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
