"""All terms that a model of the gap may have: what it begins with, and every effect at every place."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.effect import Effect, Theta
from excite.diagnosis.effects.forces import EndStop
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.own_columns import CONSTANT, COULOMB, VISCOUS
from excite.diagnosis.equations.standing_joints import stands_throughout

# Physics without a name: where it says more than what has one, the gap is unknown, and follows what it follows.
NAMELESS: tuple[Effect, ...] = (EndStop(),)
# What a model of an arm begins with at every joint, whether or not the log says that it is modelled: each of the
# three passes alone only where the others are there, so they are judged together and pruned.
_BEGUN = (VISCOUS, COULOMB, CONSTANT)


def with_initial_terms(modelled: Sequence[str]) -> tuple[str, ...]:
    """Words of ``modelled`` with those that every model begins with."""
    return (*modelled, *(term.words[0] for term in _BEGUN if not term.is_modelled(modelled)))


@dataclass(frozen=True, eq=False)
class Library:
    """Makes the terms of a record.

    Attributes:
        modelled: words of ``modelled`` in the log.
        effects: what may be named.
    """

    modelled: tuple[str, ...]
    effects: tuple[Effect, ...]

    def make_initial_terms(self, maker: TermMaker) -> list[Term]:
        """Friction and constants that the log does not call modelled."""
        base = maker.context.baseline
        missing = [term for term in _BEGUN if not term.is_modelled(self.modelled)]
        named = {id(effect.term): effect for effect in self.effects if effect.term is not None}
        made = []
        stands = stands_throughout(base.samples)
        for j, joint in enumerate(maker.context.joints):
            for term in () if stands[j] else missing:
                effect = named[id(term)]
                theta: Theta = ()
                if term is COULOMB:
                    sign = base.signs[j]
                    effect = effect.variant_forms[0] if sign.has_bristles else effect
                    theta = (sign.breakaway if sign.has_bristles else sign.width,)
                column = base.weighted_own_rows((term,), j, [base.signs[j]], maker.weight)[0][:, :1]
                size = float(np.sqrt((column**2).mean()))
                if size > 0.0:
                    made.append(
                        Term(
                            effect,
                            joint,
                            theta,
                            maker.context,
                            {j: column / size},
                            np.array([1.0 / size]),
                            kept=(0,),
                            own=j,
                            started=True,
                        )
                    )
        return made

    def make_candidate_terms(self, maker: TermMaker, begun: Context) -> list[Term]:
        """Every effect at every place where it can be told, at every point of its grid.

        Args:
            maker: makes their columns.
            begun: what the model begins with. A load that is itself found is no load that a gain is told by: scaled, it
                would be the same torque under another name.
        """
        return maker.make_all(self._candidate_places(maker.context, begun))

    def body_places(self, context: Context) -> Iterable[tuple[Effect, str]]:
        """Every effect that is a body, at every link."""
        full = with_initial_terms(self.modelled)
        for effect in self.effects:
            if effect.is_body and effect.is_candidate(full):
                yield from ((effect, place) for place in effect.locations(context))

    def _candidate_places(self, context: Context, begun: Context) -> Iterable[tuple[Effect, str, Theta]]:
        full = with_initial_terms(self.modelled)
        # What a drive does in motion cannot be told of one that stands, and friction holds it with any constant.
        stands = {context.joints[j] for j in np.flatnonzero(stands_throughout(context.baseline.samples))}
        for effect in self.effects:
            offered = effect.is_candidate(full)
            if effect.is_body or not (offered or effect.term):
                continue
            # What a model begins with it begins with at motors alone.
            behind = context.follower_indices if effect.behind else ()
            for place in (*(effect.locations(context) if offered else ()), *behind):
                if effect.own_joint and place in stands:
                    continue
                if effect.by_load and not has_rigid_load(begun, place):
                    continue
                for form in (
                    effect,
                    *effect.variant_forms,
                    *(f for f in effect.extended_forms if f.seen_alone),
                ):
                    for theta in form.search_grid(context, place):
                        yield form, place, theta


def has_rigid_load(context: Context, joint: str) -> bool:
    """Whether a joint's rigid bodies ask for enough of its torque."""
    j, samples = context.row(joint), context.baseline.samples
    load = float(np.sqrt(np.mean(context.baseline.rigid[:, j] ** 2)))
    torque = float(np.sqrt(np.mean(samples.stack_trials("tau")[:, j] ** 2)))
    return load >= THRESHOLDS.load * torque
