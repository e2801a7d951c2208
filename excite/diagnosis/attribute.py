"""Attribution: effects added one by one, each the best of all candidates, until nothing above the floor is left."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from excite.diagnosis.baseline import WIDTHS, Baseline, own_names
from excite.diagnosis.effects.effect import Context, Effect
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations import Fit, Solver
from excite.diagnosis.evidence import Judge, effective_counts
from excite.diagnosis.hypotheses import Hypothesis, Search
from excite.diagnosis.noise_floor import repeat_floor
from excite.robot.robot import Array

_REFINED = 5
_STRONG = 3
_LISTED = 24
# Hypotheses that remove this share of the power that another removes are compared by their likelihood.
_ALIKE = 0.7
# A richer form of an effect has to lower the loss by so much.
_RICHER = 0.01
_HARDLY = 0.3


@dataclass(frozen=True)
class Gates:
    """What an effect must reach to be named.

    Attributes:
        evidence: nats, identification and validation trials together, less the price of its parameters.
        validation: nats on validation trials alone.
        closed: share of the power above the floor, on validation trials, that it removes on some joint.
        evidence_again: nats of a further effect.
        validation_again: nats of a further effect on validation trials alone.
        closed_again: share that a further effect removes.
        relative: strength of a further effect against the strongest one, as normalised torque amplitude.
        of_rest: share of all normalised power above the floor that a further effect removes.
        same_joint: share of a joint's power that is needed where the joint has an accepted effect already, and
            for timing.
        left: joints well above the floor that a further effect may leave as they are: where every joint has a
            little of something, naming one of them would be arbitrary.
        most: effects at most.
        stands: power at its place over the floor's, before it; a smaller rest would not be called a gap either.
    """

    evidence: float = 25.0
    validation: float = 4.0
    closed: float = 0.4
    evidence_again: float = 80.0
    validation_again: float = 30.0
    closed_again: float = 0.2
    relative: float = 0.1
    of_rest: float = 0.12
    same_joint: float = 0.6
    left: int = 2
    most: int = 3
    stands: float = 1.5


@dataclass(frozen=True, eq=False)
class Scored:
    """A hypothesis and its merits against the fit before it.

    Attributes:
        hypothesis: the hypothesis.
        evidence: nats less the price of its parameters and of the candidates tried.
        validation: nats on validation trials.
        closed: ``(n_joints,)`` share of the validation power above the floor that it removes.
        strength: amplitude that it removes, over channels, normalised by the channels' deviation.
        of_rest: share of the normalised power above the floor, over all channels, that it removes.
        place: index of the joint that it changes most.
        price: of its parameters, taken off the evidence [nats].
        power: ``(n_joints, 2)`` mean squares that it leaves, identification and validation [(N·m)²].
        count: ``(n_joints, 2)`` effective samples of what it leaves.
        left: joints above twice the floor's power of which it removes hardly anything.
        stands: power at ``place`` before it over the floor's.
    """

    hypothesis: Hypothesis
    evidence: float
    validation: float
    closed: Array
    strength: float
    of_rest: float
    place: int
    price: float
    power: Array
    count: Array
    left: int
    stands: float

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.hypothesis.effect.name

    @property
    def location(self) -> str:
        """Its place."""
        return self.hypothesis.location


@dataclass(frozen=True, eq=False)
class Stage:
    """One step of the attribution.

    Attributes:
        context: what the effects were tried against.
        ranking: candidates, best first.
        accepted: the one that was accepted, None at the end.
    """

    context: Context
    ranking: tuple[Scored, ...]
    accepted: Scored | None


@dataclass(frozen=True, eq=False)
class Attribution:
    """All steps.

    Attributes:
        stages: in order; the last accepts nothing unless the most effects were reached.
        before: fit of the baseline.
        after: fit with all accepted effects.
        final: the baseline with them.
        floor: ``(n_joints,)`` noise floor after them [N·m].
        scale: ``(n_joints,)`` standard deviation of each torque in the identification trials [N·m].
    """

    stages: tuple[Stage, ...]
    before: Fit
    after: Fit
    final: Baseline
    floor: Array
    scale: Array

    @property
    def accepted(self) -> tuple[Scored, ...]:
        """Accepted effects in order."""
        return tuple(s.accepted for s in self.stages if s.accepted is not None)


@dataclass(eq=False)
class Attributor:
    """Runs the attribution.

    Attributes:
        baseline: the fitted baseline.
        spectral: ``(n_joints,)`` spectral noise floor [N·m].
        gates: what an effect must reach.
    """

    baseline: Baseline
    spectral: Array
    gates: Gates = field(default_factory=Gates)
    _kept: dict = field(default_factory=dict)

    def run(self) -> Attribution:
        """Add effects until none passes."""
        samples = self.baseline.samples
        use = samples.identification
        tau = samples.rows([t.tau for t in samples.trials])
        scale = np.maximum(tau[use].std(axis=0), 1e-9)
        current, stages, accepted = self.baseline, [], []
        before = current.fit
        while len(accepted) < self.gates.most:
            context = Context(current)
            ranking = self._rank(context, scale)
            best = next((s for s in ranking if self._passes(s, accepted)), None)
            stages.append(Stage(context, ranking, best))
            if best is None:
                break
            best = replace(best, hypothesis=polished(best.hypothesis))
            stages[-1] = Stage(context, ranking, best)
            accepted.append(best)
            current = extended(best.hypothesis).reprofiled()
        return Attribution(tuple(stages), before, current.fit, current, self._floor(current.fit), scale)

    def _floor(self, fit: Fit) -> Array:
        """Of repeated trials; of the spectrum where there are none."""
        repeat = repeat_floor(self.baseline.samples, self.baseline.judged(fit.residual))
        return self.spectral if repeat is None else np.maximum(repeat, 0.5 * self.spectral)

    def _rank(self, context: Context, scale: Array) -> tuple[Scored, ...]:
        search = Search(context, context.baseline.solver, self._kept)
        found: list[Hypothesis] = []
        for effect in self._offered():
            for location in effect.locations(context):
                item = search.coarse(effect, location)
                if item is not None:
                    found.append(item)
        if not found:
            return ()
        before = context.baseline.fit
        found.sort(key=_price)
        strong = sorted(found, key=lambda item: -self._removed(before, item, scale))[:_STRONG]
        # A resonance is found by its search, hardly by the grid that the search starts from.
        tuned = [item for item in found if len(item.effect.searched) > 1]
        kinds = {item.effect.name: item for item in reversed(tuned)}
        chosen = [item for item in found if item in found[:_REFINED] or item in [*strong, *kinds.values()]]
        rest = [item for item in found[:_LISTED] if item not in chosen]
        refined = [refine_with_width(search, item) for item in chosen] + rest
        refined = self._ordered(before, refined, scale)
        floor = self._floor(refined[0].fit)
        return tuple(self._score(before, item, floor, scale) for item in refined)

    def _removed(self, before: Fit, item: Hypothesis, scale: Array) -> float:
        """Normalised power above the floor that a hypothesis removes from the identification trials."""
        least = self.spectral**2
        old, new = (np.maximum(fit.sigma**2 - least, 0.0) for fit in (before, item.fit))
        return float(((old - new) / scale**2).sum())

    def _ordered(self, before: Fit, found: list[Hypothesis], scale: Array) -> list[Hypothesis]:
        """First those that remove about as much power as any, the likeliest of them first, and so on.

        By likelihood alone a little cleaned off a quiet joint would come before a lot taken from a bad one.
        """
        power = {id(item): self._removed(before, item, scale) for item in found}
        order: list[Hypothesis] = []
        rest = sorted(found, key=lambda item: -power[id(item)])
        while rest:
            least = _ALIKE * max(power[id(rest[0])], 0.0)
            group = [item for item in rest if power[id(item)] >= least] or rest
            order += sorted(group, key=_price)
            rest = [item for item in rest if item not in group]
        return order

    def _offered(self) -> list[Effect]:
        return [e for e in EFFECTS.values() if e.offered(self.baseline.modelled)]

    def _score(self, before: Fit, item: Hypothesis, floor: Array, scale: Array) -> Scored:
        samples = self.baseline.samples
        first, last = self.baseline.judged(before.residual), self.baseline.judged(item.fit.residual)
        # Of what this hypothesis leaves: what another has left to explain would count for correlated noise.
        counts = effective_counts(last, samples.identification, samples.trial_of_row)
        # Repeated trials may show less noise than the spectrum above the band makes one expect.
        judge = Judge(samples.identification, counts, np.minimum(self.spectral, floor))
        ratio = judge.ratio(first, last)
        price = 0.5 * item.n_parameters * np.log(max(judge.count.sum(), 2.0)) + np.log(200.0)
        left_over = judge.power(last)
        old, new = judge.power(first).validation, left_over.validation
        change = old - new
        room = np.maximum(old - floor**2, 0.05 * old)
        closed = change / room
        normal = change / scale**2
        strength = float(np.sqrt(max(float(normal[normal > 0.0].sum()), 0.0)))
        rest = float((np.maximum(old - floor**2, 0.0) / scale**2).sum())
        of_rest = strength**2 / max(rest, strength**2, 1e-300)
        place = int(np.argmax(ratio.sum(axis=1)))
        left = int(np.sum((old > 2.0 * floor**2) & (closed < _HARDLY)))
        # Without validation trials there are the fitted ones alone to judge by.
        side = int(not samples.identification.all())
        least = np.maximum(floor, self.spectral)[place] ** 2
        stands = float((first[place] ** 2).mean() / least)
        evidence, outside = float(ratio.sum() - price), float(ratio[:, side].sum())
        power = np.column_stack([left_over.identification, new])
        return Scored(
            item,
            evidence,
            outside,
            closed,
            strength,
            of_rest,
            place,
            float(price),
            power,
            counts,
            left,
            stands,
        )

    def _passes(self, item: Scored, accepted: list[Scored]) -> bool:
        gates = self.gates
        if item.evidence < gates.evidence or item.validation < gates.validation:
            return False
        if item.stands < gates.stands:
            return False
        if not accepted:
            return float(item.closed[item.place]) >= gates.closed
        if item.evidence < gates.evidence_again or item.validation < gates.validation_again:
            return False
        timing = item.hypothesis.effect.timing
        if timing and any(a.hypothesis.effect.timing for a in accepted):
            return False
        strongest = max(a.strength for a in accepted)
        crowded = timing or item.location in {a.location for a in accepted}
        needed = gates.same_joint if crowded else gates.closed_again
        if (
            item.left > gates.left
            or item.of_rest < gates.of_rest
            or item.strength < gates.relative * strongest
        ):
            return False
        return float(item.closed.max()) >= needed


def _price(item: Hypothesis) -> float:
    """Loss with the price of parameters, per effective sample (Schwarz 1978), samples white in the band."""
    samples = item.baseline.samples
    count = 2.0 * samples.bands.rows_hz / samples.bands.rate_hz * samples.identification.sum()
    return item.loss + 0.5 * item.n_parameters * float(np.log(count)) / float(count)


def refine_with_width(search: Search, start: Hypothesis) -> Hypothesis:
    """Local search; for friction the width of the joint's sign change is searched along with it."""
    best = search.refine(start)
    base = search.context.baseline
    if not best.effect.friction or "coulomb_friction" not in base.modelled:
        return best
    names, j = own_names(base.modelled), search.context.row(best.location)
    if base.breakaways[j] > 0.0:
        return best
    place = WIDTHS.index(base.widths[j])
    for step in (1, -1):
        k = place + step
        while 0 <= k < len(WIDTHS):
            own = base.own_rows(names, j, WIDTHS[k])
            widths = base.widths.copy()
            widths[j] = WIDTHS[k]
            moved = replace(base, widths=widths, solver=search.solver.with_own(j, own))
            item = Search(replace(search.context, baseline=moved), moved.solver).refine(
                best, evaluations=6, step=0.15
            )
            if item.loss >= best.loss - 1e-3:
                break
            best, k = item, k + step
    return best


def polished(item: Hypothesis) -> Hypothesis:
    """The same effect with finer non-linear parameters, richer forms, and predictions at its own fit."""
    item = _finer(item)
    for form in item.effect.richer:
        search = Search(Context(item.baseline), item.baseline.solver)
        begun = [search.try_at(form, item.location, theta) for theta in form.starts(item.theta)]
        found = [start for start in begun if start is not None]
        if not found:
            continue
        new = search.refine(min(found, key=lambda start: start.loss), evaluations=14)
        if _price(new) < _price(item) - _RICHER:
            item = _finer(new)
    return item


def _finer(item: Hypothesis) -> Hypothesis:
    original = item.baseline
    for step in (0.15, 0.1, 0.05):
        moved = replace(original.updated(item.fit), solver=original.solver)
        new = Search(Context(moved), original.solver).refine(item, evaluations=12, step=step)
        if new.loss > item.loss - 1e-3:
            return item if new.loss > item.loss else new
        item = new
    return item


def extended(item: Hypothesis) -> Baseline:
    """The baseline with an effect in it: its columns shared ones with hardly any prior, its offset taken off."""
    baseline, fit = item.baseline, item.fit
    e = baseline.solver.equations
    y, shared, basis = e.y, e.shared, baseline.basis
    if item.columns.offset is not None:
        y = y - item.columns.offset
    if item.columns.extra is not None:
        scale = 10.0 * np.maximum(np.abs(fit.extra), 10.0 * np.maximum(fit.extra_std, 1e-12))
        shared = np.concatenate([shared, item.columns.extra * scale], axis=2)
        basis = np.hstack([basis, np.zeros((len(basis), len(scale)))])
    solver = Solver(replace(e, y=y, shared=shared))
    torque = torque_of(item)
    added, drive = baseline.added, baseline.added_drive
    added, drive = (added + torque, drive) if item.effect.moves else (added, drive + torque)
    old = np.concatenate([baseline.fit.shared, np.zeros(basis.shape[1] - len(baseline.fit.shared))])
    fixed = replace(
        baseline,
        solver=solver,
        basis=basis,
        fit=replace(baseline.fit, shared=old),
        rigid=baseline.rigid + added - baseline.added,
        added=added,
        added_drive=drive,
    )
    return fixed.updated(solver.fit())


def torque_of(item: Hypothesis) -> Array:
    """What a fitted effect adds to the torques at full rate, ``(n_samples, n_joints)`` [N·m]."""
    shape = item.effect.shape(Context(item.baseline), item.location, item.theta)
    torque = np.zeros_like(item.baseline.rigid)
    for j, columns in shape.columns.items():
        torque[:, j] += columns @ item.fit.extra
    for j, values in shape.offset.items():
        torque[:, j] += values
    return torque
