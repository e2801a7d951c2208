"""What the posterior names, fitted together: the model that sizes, shares and the verdict are read from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.selection.gram import Gram
from benchmarks.selection.prior import group_of, groups_of, problem_of
from benchmarks.selection.sampler import gains_beside
from benchmarks.selection.settling import Basis, settle
from benchmarks.selection.shapes import in_plainest_forms
from benchmarks.selection.turns import Selected
from excite.arrays import Array
from excite.diagnosis.budget.bodies import body
from excite.diagnosis.budget.evidence import Merit
from excite.diagnosis.budget.fit.beside import Beside
from excite.diagnosis.budget.fit.design import Design, Rows
from excite.diagnosis.budget.fit.joint_fit import fit
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.record import Found, rows_of
from excite.diagnosis.budget.screening import Tried
from excite.diagnosis.budget.search import Search, predicted
from excite.diagnosis.budget.shares import shares_of
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.own_columns import COULOMB

# Probability from which an effect is in the model, and that of a rival from which it is told.
_THERE, _RIVAL = 0.7, 0.05
# Share of the whole gap, or of some joint's, from which an effect is named.
_OF_ALL, _OF_A_JOINT = 0.01, 0.05
# Effects that are listed as likely by themselves.
_LISTED = 8


def found_of(
    selected: Selected, first: Baseline, modelled: tuple[str, ...], floor: Array, scale: Array
) -> Found:
    """The model of what the posterior names.

    Args:
        selected: the posterior.
        first: what every model begins with, fitted without any effect.
        modelled: words of ``modelled``.
        floor: ``(n_joints,)`` noise in the rows' band.
        scale: ``(n_joints,)`` standard deviation of each torque.
    """
    gram, draws, full = selected.gram, selected.draws, selected.full
    groups = groups_of(gram.atoms)
    number = {key: g for g, key in enumerate(groups)}
    sure = [a for a in selected.chosen if draws.inclusion[number[group_of(gram.atoms[a].term)]] >= _THERE]
    rows = rows_of(full, modelled, floor)
    free = [gram.atoms[a].term for a in sure]
    terms = _with_bodies(free, selected, rows)
    terms = _of_some_share(terms, rows, floor, scale, Context(full))
    # A body beside what is named alone: what stood beside it may have cancelled a part of it.
    keys = {term.key for term in terms}
    terms = _with_bodies([term for term in free if term.key in keys], selected, rows)
    if len(terms) < len(free):
        # What stood beside them has bent their shapes, what they are made of and how friction changes sign.
        begun = rows_of(first, modelled, floor)
        basis = Basis(first, begun, modelled, selected.noise, selected.gap)
        maker = TermMaker(Context(first), first.strict)
        again = [term if term.effect.is_body else maker.again(term) or term for term in terms]
        gram = Gram.of(begun, gram.discrepancy, gram.atoms, selected.noise)
        settled = settle(basis, gram, again, once=False)
        full, rows = settled.basis.full, settled.basis.rows
        selected = replace(selected, full=full)
        terms = in_plainest_forms(settled.gram, settled.terms, settled.basis.slab)
    kept = {group_of(term) for term in terms}
    others: list[Term] = []
    rivals: dict[int, list[Tried]] = {}
    merits: dict[int, Merit] = {}
    for k, term in enumerate(terms):
        g = number[group_of(term)]
        chance = float(draws.inclusion[g])
        score = float(np.clip(np.log(max(chance, 1e-12) / max(1.0 - chance, 1e-12)), -20.0, 30.0))
        merits[k] = Merit(np.zeros(len(floor)), score, score)
        for other in np.argsort(-draws.rivals[g]):
            p = float(draws.rivals[g, other])
            if p < _RIVAL or other == g or groups[other] in kept:
                continue
            rest = (*terms[:k], *terms[k + 1 :])
            like = _that_can_be(_likeliest(selected, int(other)), rest, selected, rows)
            if like is None or like.effect.nameless:
                continue
            behind = float(np.log(max(draws.rivals[g, g], 1e-6) / p)) / 3.0
            rivals.setdefault(k, []).append(Tried(len(terms) + len(others), None, merits[k], behind))  # type: ignore[arg-type]
            others.append(like)
    design = Design(rows, (*terms, *others))
    model = fit(design, range(len(terms)))
    now = predicted(full, model)
    dry = COULOMB.asked(modelled)
    search = Search(design, now.context, model, dry, tried=len(groups), rivals=rivals, merits=merits)
    return Found(search, full, now, _likely(selected))


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
    return body(Beside.of(model), maker, term.effect, term.location)


def _of_some_share(
    terms: Sequence[Term], rows: Rows, floor: Array, scale: Array, context: Context
) -> list[Term]:
    """Terms whose sizes are what their names say, that take a share of the gap and leave less of what judges."""
    kept, moving = list(terms), np.isfinite(scale)
    while kept:
        model = fit(Design(rows, tuple(kept)), range(len(kept)))
        cannot = [k for k, term in enumerate(kept) if not term.can_be(context, model.parameters(k))]
        if cannot:
            weakest = min(cannot, key=model.taken_by)
            kept = [term for k, term in enumerate(kept) if k != weakest]
            continue
        shares = shares_of(model, floor)
        weight = shares.open / scale**2
        weight = weight / max(float(weight.sum()), 1e-300)
        worth = np.array(
            [
                max(float(value @ weight) / _OF_ALL, float(value[moving].max(initial=0.0)) / _OF_A_JOINT)
                for value in shares.value
            ]
        )
        # What acts on several joints leaves less as a mean over them; what acts on one, there.
        closes = np.array(
            [
                lost[term.own] if term.own is not None else np.log1p(np.maximum(lost, -0.99)).sum()
                for term, lost in zip(kept, shares.lost, strict=True)
            ]
        )
        worth = np.where(closes > 0.0, worth, -1.0)
        small = [k for k in np.argsort(worth) if worth[k] < 1.0 and not kept[k].started]
        if not small:
            break
        # A few at a time: what one leaves another may take.
        gone = set(small[: max(1, len(small) // 2)])
        kept = [term for k, term in enumerate(kept) if k not in gone]
    return kept


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
        if gains[a] > 0.0 and not (term.started or term.effect.nameless or term.effect.is_body):
            best.setdefault(term.key, replace(term))
    return tuple(best.values())[:_LISTED]
