"""What every effect says of itself: law, places, parameters, columns, its form in a simulator."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.form import Absence, Context, Form, InitialState, Note, Noted, Sizes
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.own_columns import OwnTerm
from excite.doctor.doubt import Doubt
from excite.errors import InputError

Theta = tuple[float, ...]
SECANT = "secant"
"""Name of a parameter at which a column is a secant: where the effect's size itself is, of which it is no estimate."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect.

    Attributes:
        name: its name.
        unit: SI unit.
        low: least value that is physical.
        high: greatest value that is physical.
        width: standard deviation that it has a priori.
        beside: whether it comes along with what the effect's name stands for.
    """

    name: str
    unit: str
    low: float = -np.inf
    high: float = np.inf
    width: float = np.inf
    beside: bool = False


@dataclass(frozen=True, eq=False)
class Shape:
    """What an effect adds to the torques at given non-linear parameters.

    Attributes:
        columns: by index of the joint's row, full-rate torques per unit of each linear parameter
            ``(n_samples, n_linear)``; rows that are not named get nothing.
        offset: by index of the row, full-rate torques ``(n_samples,)`` that come without a factor.
    """

    columns: dict[int, Array] = field(default_factory=dict)
    offset: dict[int, Array] = field(default_factory=dict)


class Belief(NamedTuple):
    """What is believed of an effect before any record.

    Of three drawn arms with 19 effects to be found, chances of 0.02 for 0.1, and torques three times as large as the
    gap, changed no name; torques a third as large let five false ones in. Assembled robots rarely have links of a wrong
    length or encoders off by much: with 0.1 for both, one of eight drawn arms had three lengths that were not there.
    With 0.02 for scaled positions, three of nine records of a TX40 had one that was not there, with 0.01 one.

    Attributes:
        chance: that a place has it.
        width: standard deviation of its linear parameters [SI]; infinite where only the gap bounds its torque.
        group: effects of one group exclude each other at a place; its own name where empty.
    """

    chance: float = 0.1
    width: float = np.inf
    group: str = ""


class Effect(ABC):
    """An effect: its physics, where it can be, its parameters, and what it looks like in the torques.

    Attributes:
        name: its name in a diagnosis.
        linear: its linear parameters, in the order of the columns.
        searched: its non-linear parameters, in the order of ``theta``.
        confusable_with: effects that can look alike.
        separating_motion: what motion or measurement tells them apart.
        without_motion: what tells them apart where no motion does; empty where nothing is known to.
        mujoco: how a MuJoCo model expresses it, in words; :meth:`in_mujoco` does it.
        note: what a model leaves to its runner; None where that is nothing.
        term: the term of a baseline's drives that it is; None where it is none.
        observed_by: quantities of a log that it is measured by: where these are in doubt it cannot be named.
        spans: what its columns are made of, in words; empty where no other effect's are.
        moves: whether it changes the torque that the gears carry (bodies, geometry), not the drives'.
        friction: whether the width of the velocity's sign change is searched along with it.
        timing: whether it is a matter of time in the torque channel as a whole.
        late_by: parameter that says how late a motor follows what it is told; empty where it is no matter of that.
        nameless: what it follows, where it is physics that no name of a diagnosis stands for; empty where it has one.
        seen_alone: whether it may show where the plainer form that it enriches does not, and is tried along with that.
        stands_in: whether its size and what it searches are one number, as only its closer form has it.
        by_load: whether it is a share of what the rigid bodies ask of its joint.
        is_body: whether its linear parameters are the ten of a body.
        behind: whether it may act at joints that no motor turns alone, behind couplings and loops.
        by_motion: whether its columns follow the motion and the inertial parameters alone, whatever else is found.
        of_channel: whether it is of the torque channel alone: a log without one has none of it.
        twins_without_torque: other names that mean the same where only commands and positions are known.
        twins_of_a_gain: other names for what a servo's gain does that was estimated wrongly.
        along: other effects that this form has in it, with those of its parameters that are theirs.
        belief: how likely it is, how large, and what it excludes.
    """

    name: ClassVar[str]
    linear: ClassVar[tuple[Parameter, ...]] = ()
    searched: ClassVar[tuple[Parameter, ...]] = ()
    confusable_with: ClassVar[tuple[str, ...]] = ()
    separating_motion: ClassVar[str] = ""
    without_motion: ClassVar[str] = ""
    mujoco: ClassVar[str] = ""
    moves: ClassVar[bool] = False
    friction: ClassVar[bool] = False
    timing: ClassVar[bool] = False
    late_by: ClassVar[str] = ""
    note: ClassVar[type[Note] | None] = None
    term: ClassVar[OwnTerm | None] = None
    observed_by: ClassVar[frozenset[Doubt]] = frozenset()
    spans: ClassVar[tuple[str, ...]] = ()
    nameless: ClassVar[str] = ""
    seen_alone: ClassVar[bool] = False
    stands_in: ClassVar[bool] = False
    by_load: ClassVar[bool] = False
    is_body: ClassVar[bool] = False
    behind: ClassVar[bool] = False
    by_motion: ClassVar[bool] = False
    of_channel: ClassVar[bool] = False
    twins_without_torque: ClassVar[tuple[str, ...]] = ()
    twins_of_a_gain: ClassVar[tuple[str, ...]] = ()
    along: ClassVar[dict[type[Effect], tuple[str, ...]]] = {}
    belief: ClassVar[Belief] = Belief()

    @property
    def prior_widths(self) -> Array:
        """Prior standard deviations of its linear parameters, ``(n_linear,)``."""
        return np.array([p.width for p in self.linear])

    @property
    def own_joint(self) -> bool:
        """Whether it acts on the torque of its own joint alone."""
        return not (self.moves or self.timing)

    @property
    def reaches_others(self) -> bool:
        """Whether it acts on the torques of other joints as on that of its own: bodies and geometry."""
        return self.moves and self.by_motion

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        """Other forms of the same physics with more parameters, tried once the effect is named, or where none is."""
        return ()

    @property
    def refined_form(self) -> Effect | None:
        """The same physics without linearisation, tried last; None where the effect has no such form."""
        return None

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        """Other forms of the same physics, tried along with this one."""
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        """Starting points ``theta`` of an extended form's search, given those of the plain form."""
        return [theta]

    def further_starts(self, context: Context, location: str) -> list[Theta]:
        """Further starting points of an extended form's search, used where the plain form fits nothing."""
        return []

    def equivalent_form(self, context: Context, location: str, theta: Theta) -> tuple[Effect, Theta] | None:
        """An effect with nearly the same torque, but for bodies and a constant; None for most effects."""
        return None

    def transfer_shape(self, old: Context, new: Context, location: str, theta: Theta) -> Theta:
        """``theta`` for another fit of the baseline, such that the torque is nearly the same."""
        return theta

    def nearest_body(
        self, context: Context, location: str, information: Array, target: Array
    ) -> Array | None:
        """Linear parameters of the body that can exist and is the most likely, of effects that are bodies.

        Args:
            context: where its columns were made.
            information: inverse covariance of the linear parameters, ``(10, 10)``.
            target: ``information`` times their estimate.
        """
        return None

    def is_candidate(self, modelled: tuple[str, ...]) -> bool:
        """Whether it is tried beside a baseline with the terms ``modelled``: not if that has it already."""
        return self.name not in modelled if self.term is None else not self.term.is_modelled(modelled)

    def locations(self, context: Context) -> tuple[str, ...]:
        """Where it can be: every joint, unless said otherwise."""
        return context.joints

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        """Grid of non-linear parameters from which the search starts."""
        return [()]

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        """Torques at its joint per unit of each linear parameter, ``(n_samples, n_linear)``, of what acts at one."""
        raise InputError("lacks its torques", source=self.name, remedy="define unit_torques, or shape")

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        """Columns and offset that it adds to the torques."""
        return Shape(context.motor_columns(location, self.unit_torques(context, location, theta)))

    def mistake_in(self, method: str, result: Any, context: Context | None = None, *_: object) -> str:
        """What is wrong with what a derived class's method returns; empty for nothing."""
        if context is None or method not in ("unit_torques", "shape"):
            return ""
        made = result if isinstance(result, Shape) else Shape({0: result})
        (n, joints), wide = context.v.shape, len(self.linear)
        sizes = [(columns, (n, wide)) for columns in made.columns.values()]
        for values, size in (*sizes, *((offset, (n,)) for offset in made.offset.values())):
            if values.shape != size:
                return f"has the shape {values.shape} where {size} is expected"
            if not np.isfinite(values).all():
                return "is not finite everywhere"
        rows = sorted({*made.columns, *made.offset} - {*range(joints)})
        return f"has rows {rows} where those of joints are 0 to {joints - 1}" if rows else ""

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        """Whether parameters are within their bounds and describe this effect rather than another one."""
        return self.in_bounds(beta, np.zeros(len(beta)))

    def in_bounds(self, beta: Array, spread: Array) -> bool:
        """Whether linear parameters are within their bounds, each by no more than its spread outside."""
        return all(
            p.low <= b + s and b - s <= p.high for p, b, s in zip(self.linear, beta, spread, strict=True)
        )

    def shape_at(self, theta: Theta, beta: Array) -> Theta:
        """The shape that goes with linear parameters ``(n_linear,)``; by default ``theta``, whatever they are."""
        return theta

    def is_physical(self, context: Context, location: str, fit: Fit) -> bool:
        """Whether a fit is physically possible within its standard deviations."""
        return True

    def is_possible(self, context: Context, location: str, beta: Array) -> bool:
        """Whether linear parameters ``(n_linear,)`` are physically possible at that place."""
        return True

    def is_within_scope(self, context: Context, location: str, theta: Theta, fit: Fit) -> bool:
        """Whether the fitted ``theta`` is inside the range that this effect describes, not at its bound."""
        return True

    def to_estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        """Estimates of its parameters by name, without those that the record does not determine."""
        found = {
            p.name: Estimate(float(b), float(s), p.unit)
            for p, b, s in zip(self.linear, fit.extra, fit.extra_std, strict=True)
            if np.isfinite(s)
        }
        searched = {p.name: Estimate(t, None, p.unit) for p, t in zip(self.searched, theta, strict=True)}
        return {name: size for name, size in (found | searched).items() if name != SECANT}

    def to_sizes(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, float]:
        """Values of its parameters by name, with further numbers that a simulator needs."""
        values = {name: e.value for name, e in self.to_estimates(context, location, theta, fit).items()}
        values |= {p.name: float(b) for p, b in zip(self.linear, fit.extra, strict=True)}
        return values | {p.name: float(t) for p, t in zip(self.searched, theta, strict=True)}

    def in_mujoco(self, item: Sizes) -> Form:
        """Its form in a MuJoCo model; without one, the model is without it, and says why."""
        return Form(absent=Absence.NO_FORM)

    def initial_state(self, context: Context, location: str, theta: Theta) -> InitialState:
        """Its internal state along the record, for roll-outs; empty by default."""
        return InitialState()

    def second_name(self, baseline: Baseline, location: str, fit: Fit) -> str | None:
        """Name of another effect with the same torques in this record; None by default."""
        return None

    def make_note(self, item: Sizes, place: str | None = None) -> Noted:
        """Its note with given parameter values."""
        if self.note is None:
            raise TypeError(f"{self.name} leaves nothing to a runner")
        return Noted(self.name, place or item.location, self.note.from_values(item.values))
