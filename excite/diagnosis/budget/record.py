"""The model of the gap of a record, and the rows that it is fitted to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Design, Rows, blocks_of
from excite.diagnosis.budget.fit.joint_fit import Model
from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.budget.library import with_initial_terms
from excite.diagnosis.budget.prediction import Prediction
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.own_columns import ARMATURE, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.standstill import fit_where_slipping
from excite.progress import step


@dataclass(frozen=True)
class Rival:
    """What may stand in the place of a term.

    Attributes:
        index: of the other term in the design.
        odds: against the term itself.
    """

    index: int
    odds: float


@dataclass(frozen=True, eq=False)
class GapModel:
    """A model of the gap.

    Attributes:
        model: the terms, fitted together; its design has their rivals too.
        nats: by index of a term, log odds that it is there.
        rivals: by index of a term, what may stand in its place.
        tried: number of effects and places that might have been found.
        baseline: what every model begins with, fitted.
        prediction: its torques.
        likely: what would explain most if it stood alone, best first.
    """

    model: Model
    nats: Mapping[int, float]
    rivals: Mapping[int, tuple[Rival, ...]]
    tried: int
    baseline: Baseline
    prediction: Prediction
    likely: tuple[Term, ...] = ()

    @property
    def design(self) -> Design:
        """Columns of its terms and of their rivals."""
        return self.model.design


@step("fit what is modelled")
def fit_initial_baseline(samples: ArmSamples, modelled: tuple[str, ...], floor: Array) -> Baseline:
    """What every model of a record begins with: what is modelled, and friction and constants whether or not."""
    return fit_where_slipping(samples, with_initial_terms(modelled), floor)


def rows_of(full: Baseline, modelled: tuple[str, ...], floor: Array) -> Rows:
    """Weighted rows of what is modelled."""
    samples, weight = full.samples, full.strict
    e = full.solver.equations
    again = weight / full.root_weight
    terms = own_terms(modelled)
    own = [full.weighted_own_rows(terms, j, [sign], weight)[0] for j, sign in enumerate(full.signs)]
    outside = not samples.identification_rows.all()
    block = blocks_of(samples, identification=True)
    judged = blocks_of(samples, identification=False) if outside else block
    return Rows(
        e.shared * again[:, :, None],
        tuple(own),
        e.y * again,
        block,
        judged,
        samples.trial_of_row,
        floor,
        terms.index(ARMATURE) if ARMATURE in terms else None,
        -samples.motor_inertias,
    )
