"""The search for the model of the gap: forward, backward and by swaps, each term in the company of all others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.evidence import (
    LARGE,
    Merit,
    merit,
    nats_alike,
    nats_between,
    price_of,
    share_taken,
)
from excite.diagnosis.budget.fit.design import Design
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.budget.rivals import with_trifles
from excite.diagnosis.budget.screening import Tried, one_each, screened
from excite.diagnosis.budget.shares import has_told_size
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.gears.gear_effect import GearEffect
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.fitted_signs import signs_again
from excite.diagnosis.equations.joint_torque import Solver
from excite.diagnosis.equations.own_columns import COULOMB, own_signals, own_terms
from excite.progress import step
from excite.regressor.kernels import inverse_dynamics

_SWEEPS = 4
# Front-runners of the screening that are fitted in full at a time, and how often the next ones are tried.
_FITTED, _BATCHES = 14, 2
# Candidates that are fitted in the place of a term that is taken out.
_SWAPPED = 5


@dataclass(eq=False)
class Search:
    """Searches one design.

    Attributes:
        design: all columns.
        context: at which they were made.
        model: the terms so far.
        tried: effects and places that were tried before this search.
        least: share of what is left at its place that a term has to take away to be added.
        stops: whether it ends as soon as a body is found; ``stopped``, whether it has.
        settles: whether what is likelier takes a term's place though it is a rival; before the last pass it may not.
        dry_given: whether the log says that Coulomb friction is modelled.
        rivals: by index of an accepted term, what else scores alike in the company of all others.
    """

    design: Design
    context: Context
    model: Model
    dry_given: bool
    least: float = 0.0
    tried: int = 0
    stops: bool = False
    stopped: bool = False
    settles: bool = False
    rivals: dict[int, list[Tried]] = field(default_factory=dict)
    merits: dict[int, Merit] = field(default_factory=dict)

    @property
    def candidates(self) -> int:
        """Number of effects and places."""
        return max(self.tried, self.design.n_candidates)

    @step("look for effects")
    def run(self) -> Model:
        """Sweep until nothing changes."""
        seen: set[frozenset[int]] = set()
        for _ in range(_SWEEPS):
            self.forward()
            if self.stopped:
                break
            self.backward()
            now = frozenset(self.model.chosen)
            if now in seen:
                break
            seen.add(now)
        return self.model

    def forward(self) -> None:
        """Add terms while any passes."""
        while True:
            found = self._best_of_screening()
            if not found:
                return
            chosen, beside, taken = list(self.model.chosen), self.model, set[int | None]()
            for item in found:
                term = self.design.terms[item.index]
                # What acts on one joint alone competes with what acts on another through bodies that suit both alone.
                alone = term.own is not None and len(term.columns) == 1
                if taken and (not alone or term.own in taken):
                    continue
                passed = item if not taken else self.try_beside(beside, item.index)
                if passed is None or not passed.merit.passes or not self._large(beside, passed):
                    continue
                beside = passed.model
                chosen.append(item.index)
                taken.add(term.own)
                if not alone:
                    break
            self.model = fit(self.design, chosen, self.model.weight)
            if self.stops and self.design.terms[chosen[-1]].effect.is_body:
                self.stopped = True
                return

    def _best_of_screening(self) -> list[Tried]:
        """Those that pass, best first."""
        found = screened(self.model, self.allowed(self.model))
        ranking = one_each(self.design, [s for s in found if self.can_be(s.index, s.x)])
        for batch in range(_BATCHES):
            part = ranking[batch * _FITTED : (batch + 1) * _FITTED]
            passing = self._passing([item.index for item in part])
            if passing:
                return self._simpler_first(passing)
        # What the model began with and has lost may be missed by blocks and not by a fit of all of them: on a Panda
        # a bias of 36 nats is screened with none.
        return self._passing([k for k in self.allowed(self.model) if self.design.terms[k].started])

    def _passing(self, candidates: Sequence[int]) -> list[Tried]:
        """Those of some candidates that pass in a full fit, best first."""
        tried = [self.try_beside(self.model, k) for k in candidates]
        passing = [t for t in tried if t is not None and t.merit.passes and self._large(self.model, t)]
        return sorted(passing, key=lambda item: -item.merit.score)

    def _large(self, model: Model, item: Tried) -> bool:
        """Whether a term takes away enough of what a model leaves where it acts most."""
        enough = self.least <= 0.0 or share_taken(model, item.model) >= self.least
        return enough and not self._patches(model, item)

    def _patches(self, model: Model, item: Tried) -> bool:
        """Whether a term that bends to anything takes too little of the gap to be what it says."""
        effect = self.design.terms[item.index].effect
        return effect.patches and share_taken(model, item.model, self._gap) < LARGE

    @cached_property
    def _gap(self) -> Array:
        """What a model without any term leaves of each joint where it is not fitted, ``(n_joints,)``."""
        return np.asarray(fit(self.design, ()).predicted.sum(axis=0))

    def _simpler_first(self, passing: list[Tried]) -> list[Tried]:
        """The simplest of those that score like the best at its place comes first."""
        best = passing[0]
        least = (1.0 - THRESHOLDS.alike) * best.merit.score
        alike = [t for t in passing if t.merit.score >= least and self._same_place(t.index, best.index)]
        simple = min(alike, key=lambda t: self.design.terms[t.index].n_parameters)
        return [simple, *(t for t in passing if t is not simple)]

    def backward(self) -> None:
        """Take each term out in the company of all others: drop it, or swap it for what scores better."""
        self.rivals, self.merits = {}, {}
        order = sorted(self.model.chosen, key=self.model.taken_by)
        for k in order:
            if k not in self.model.chosen:
                continue
            others = [i for i in self.model.chosen if i != k]
            without = fit(self.design, others, self.model.weight)
            term = self.design.terms[k]
            here = merit(without, self.model, term, self.candidates)
            orphan = term.effect.friction and not self._rubs(others, term.location)
            tried = self._in_place_of(k, without)
            ahead = {t.index: self._ahead(t, k) for t in tried}
            best = max(tried, key=lambda t: ahead[t.index], default=None)
            keep = here.passes and not orphan and self.can_be(k, self.model.parameters(k))
            keep = keep and (not self.settles or has_told_size(self.model, k))
            if best is not None and best.merit.passes:
                simple = self.design.terms[best.index].n_parameters < term.n_parameters
                gain, width = ahead[best.index], self._width(without, best)
                alike = simple and gain > -width and self._same_place(best.index, k)
                if not keep or alike or gain > (THRESHOLDS.rival if self.settles else width):
                    self.model = best.model
                    self.merits |= {t.index: t.merit for t in (best, *best.trifles)}
                    continue
            if not keep:
                self.model = without
                continue
            self.merits[k] = here
            passing = [t for t in tried if t.merit.passes and not self._richer(t.index, k)]
            behind = [replace(t, behind=-ahead[t.index] / self._width(without, t)) for t in passing]
            self.rivals[k] = [t for t in behind if t.behind < 1.0]

    def _ahead(self, item: Tried, k: int) -> float:
        """Nats that another term has over the one in the model, against what the worse leaves, less their prices."""
        cost = sum(price_of(self.design.terms[t.index], self.candidates) for t in (item, *item.trifles))
        return nats_between(self.model, item.model) + price_of(self.design.terms[k], self.candidates) - cost

    def _width(self, without: Model, item: Tried) -> float:
        """Nats within which another term is a rival: a share of those that the one in the model has, counted alike."""
        return max(THRESHOLDS.rival, THRESHOLDS.alike * nats_alike(without, self.model, item.model))

    def _in_place_of(self, k: int, without: Model) -> list[Tried]:
        """What else might stand in a term's place, fitted in full."""
        term = self.design.terms[k]
        allowed = [i for i in self.allowed(without) if self.design.terms[i].key != term.key and i != k]
        joints = set(term.columns)
        ranking = [s for s in screened(without, allowed) if self.can_be(s.index, s.x)]
        near = [item for item in one_each(self.design, ranking) if item.joint in joints]
        tried = (self.try_beside(without, item.index) for item in near[:_SWAPPED])
        made = [item for item in tried if item is not None and not self._patches(without, item)]
        wide = len(term.columns) > 1
        return [with_trifles(self, t, without) if wide else t for t in made]

    def _same_place(self, a: int, b: int) -> bool:
        """Whether two terms are at one place: the simpler one is preferred there, not a simpler one elsewhere."""
        one, other = self.design.terms[a], self.design.terms[b]
        return one.location == other.location

    def _richer(self, a: int, b: int) -> bool:
        """Whether one term is at another's place with more parameters: of two alike the simpler one is meant."""
        more = self.design.terms[a].n_parameters > self.design.terms[b].n_parameters
        return more and self._same_place(a, b)

    def can_be(self, k: int, x: Array) -> bool:
        """Whether a term is physical at fitted parameters."""
        return self.design.terms[k].can_be(self.context, x)

    def try_beside(self, without: Model, k: int) -> Tried | None:
        """A model with term ``k`` beside its own, and what that is worth; None where its numbers cannot be."""
        model = fit(self.design, (*without.chosen, k), without.weight, beside=without)
        if not self.can_be(k, model.parameters(k)):
            return None
        return Tried(k, model, merit(without, model, self.design.terms[k], self.candidates))

    def allowed(self, model: Model) -> list[int]:
        """Terms that may join a model."""
        terms = [self.design.terms[k] for k in model.chosen]
        keys = {t.key for t in terms}
        timed = any(t.effect.timing for t in terms)
        # Play and compliance of one gear are two forms of one thing.
        gears = {t.location for t in terms if isinstance(t.effect, GearEffect)}
        return [
            k
            for k, t in enumerate(self.design.terms)
            if t.key not in keys
            and not (timed and t.effect.timing)
            and not (t.location in gears and isinstance(t.effect, GearEffect))
            and (not t.effect.friction or self._rubs(model.chosen, t.location))
        ]

    def _rubs(self, chosen: Sequence[int], location: str) -> bool:
        """Whether a joint has Coulomb friction for others to grow on."""
        return self.dry_given or any(
            self.design.terms[k].location == location and self.design.terms[k].effect.term is COULOMB
            for k in chosen
        )


# Predictions of a fitted model of the gap: what its columns are made of when they are made again.


@dataclass(frozen=True, eq=False)
class Prediction:
    """A model's torques, and those of each of its terms.

    Attributes:
        baseline: with all terms in its predictions; delays and lags are readings, which no torque follows.
        torques: by index of the term, full rate ``(n_samples, n_joints)``; what the model begins with is not listed.
        moves: by index of the term, whether it is a torque that gears carry.
    """

    baseline: Baseline
    torques: dict[int, Array]
    moves: dict[int, bool]

    @property
    def context(self) -> Context:
        """With all terms."""
        return Context(self.baseline)

    def without(self, *terms: int) -> Context:
        """As terms' own columns need it: a gear's load is not what it makes of it itself."""
        base = self.baseline
        for k in terms:
            if k not in self.torques:
                continue
            torque, total = self.torques[k], base.total - self.torques[k]
            if self.moves[k]:
                base = replace(base, rigid=base.rigid - torque, total=total, added=base.added - torque)
            else:
                base = replace(base, total=total, added_drive=base.added_drive - torque)
        return Context(base)


def predicted(full: Baseline, model: Model) -> Prediction:
    """Torques of a fitted model.

    Args:
        full: what every model begins with, fitted.
        model: the model.
    """
    s, index = full.samples, list(full.samples.index)
    x = model.x[: full.basis.shape[1]]
    phi, rigid = full.phi, full.rigid
    if full.free:
        phi = full.phi + full.basis @ (x - full.fit.shared)
        q, v, a = (s.stacked(name) for name in ("q", "v", "a"))
        rigid = inverse_dynamics(s.robot.model, q, v, a, phi)[:, index]
    moved, driven = np.zeros_like(rigid), full.added_drive.copy()
    y, known = full.solver.equations.y.copy(), full.strict > 0.0
    back = np.where(known, full.root_weight, 0.0) / np.where(known, full.strict, 1.0)
    torques, moves = {}, {}
    for k in model.chosen:
        term = model.design.terms[k]
        if term.started:
            continue
        for j, block in term.columns.items():
            y[j] -= (block @ model.parameters(k)) * back[j]
        if term.effect.timing:
            continue
        torques[k] = torque_of(term, model.parameters(k))
        moves[k] = term.effect.moves
        (moved if moves[k] else driven)[:] += torques[k]
    now = replace(full.fit, equations=replace(full.solver.equations, y=y), shared=x, held=None)
    terms = own_terms(full.modelled)
    own = [own_signals(s, terms, j, sign) @ now.own[j] for j, sign in enumerate(full.signs)]
    rigid = rigid + moved
    total = rigid + np.column_stack(own) + driven
    base = replace(full, fit=now, phi=phi, rigid=rigid, total=total, added=moved, added_drive=driven)
    return Prediction(base, torques, moves)


def signs_beside(full: Baseline, model: Model) -> Baseline:
    """What every model begins with, its friction's sign changes searched again: a large effect has bent them.

    Args:
        full: what every model begins with, fitted.
        model: the model so far.
    """
    now = predicted(full, model).baseline
    apart = replace(now, solver=Solver(now.fit.equations))
    again = signs_again(apart.updated(apart.solver.fit()))
    if again.signs == full.signs:
        return full
    moved = full.with_signs(again.signs)
    return moved.updated(moved.solver.fit())


def torque_of(term: Term, x: Array) -> Array:
    """What a fitted term adds to the torques at full rate, ``(n_samples, n_joints)``."""
    shape = term.effect.shape(term.context, term.location, term.theta)
    torque = np.zeros_like(term.context.baseline.rigid)
    for j, columns in shape.columns.items():
        torque[:, j] += columns @ term.beta(x)
    for j, values in shape.offset.items():
        torque[:, j] += values
    return torque
