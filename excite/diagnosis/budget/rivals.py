"""What might stand in the place of a term of the model of the gap."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Protocol

from excite.diagnosis.budget.evidence import lacks, nats_between
from excite.diagnosis.budget.fit.joint_fit import Model
from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.budget.screening import Tried, one_each, screened
from excite.diagnosis.budget.thresholds import THRESHOLDS

# What stands in the place of a term that acts on several joints, with a small effect of its own where it
# lacks one.
#
# A body moves several joints and has several parameters: where one joint has most of what it explains, the
# others take up whatever little there is at the rest. On a SCARA whose first motor has a rotor that the model
# lacks, a body on the second axis says as much of the first joint, and takes up 12 nats at the second; of
# 3600 in all that is no sign of it.

# Effects of a joint that are tried there, likeliest first.
_TRIED = 2
# What is further behind than so many times what trifles may add and what makes a rival is none, whatever is added: nats
# between other models count other numbers of samples. Of 60 terms in others' places on a drawn arm two are 1.4 times as
# far behind, and all others 7 times and more.
_BEHIND = 2.0


class Searched(Protocol):
    """What is asked of a search.

    Attributes:
        model: the terms so far.
    """

    model: Model

    def allowed(self, model: Model) -> list[int]:
        """Terms that may join a model."""

    def try_beside(self, without: Model, k: int) -> Tried | None:
        """A model with term ``k`` beside its own; None where its numbers cannot be."""


def with_trifles(search: Searched, item: Tried, without: Model) -> Tried:
    """A term in another's place with one more effect at each joint where it lacks one; as it is where these are large.

    Args:
        search: whose model has the other.
        item: the term, in a model that has it in the other's place.
        without: the model with neither.
    """
    behind = nats_between(item.model, search.model)
    added = THRESHOLDS.alike * max(nats_between(without, item.model), 0.0)
    width = max(THRESHOLDS.rival, THRESHOLDS.alike * nats_between(without, search.model))
    if behind > _BEHIND * (added + width):
        return item
    whole, found = item.model, list[Tried]()
    terms = whole.design.terms
    for joint in lacks(without, search.model, item.model):
        there = [k for k in search.allowed(whole) if terms[k].own == joint and len(terms[k].columns) == 1]
        ranking = one_each(whole.design, screened(whole, there))
        tried = (search.try_beside(whole, one.index) for one in ranking[:_TRIED])
        best = next((one for one in tried if one is not None), None)
        if best is None:
            return item
        whole = best.model
        found.append(best)
    # Several that are no trifles could stand for anything that acts on several joints.
    if not found or nats_between(item.model, whole) > THRESHOLDS.alike * nats_between(without, whole):
        return item
    return replace(item, model=whole, trifles=tuple(found))


def terms_of(rivals: Iterable[Tried], terms: Sequence[Term]) -> list[Term]:
    """Rivals' terms, with those that they need beside them.

    Args:
        rivals: of a term in a model.
        terms: of the design.
    """
    return [terms[item.index] for rival in rivals for item in (rival, *rival.trifles)]
