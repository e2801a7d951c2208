"""An effect on the base's wrench equation: what would be true if it were there."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.state import State
from excite.doctor.doubt import Doubt

# Parts of a MuJoCo model that are written from a state with all effects in it, by the state's field. What changes
# another field (the recorded motion, what sensors read, a force that comes and goes) is no part of a model, and is
# noted beside it for its runner to apply.
MODEL_PARTS = {
    "phi": "body mass, pos and inertia",
    "tree": "body pos",
    "placements": "pos and quat of the site that is the sensor",
}

# How far from a link's origin forces act on it [m].
_REACH = 0.1


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect.

    Attributes:
        name: its name.
        unit: SI unit.
        scale: standard deviation of what one would expect before looking at data, in ``unit``.
        step: step of finite differences, in ``unit``.
        low: the least that it may be.
    """

    name: str
    unit: str
    scale: float
    step: float
    low: float = -np.inf

    @classmethod
    def of_names(cls, names: Sequence[str], unit: str, scale: float, step: float) -> tuple[Parameter, ...]:
        """Parameters that differ by their names alone."""
        return tuple(cls(name, unit, scale, step) for name in names)


class FloatingEffect(ABC):
    """One effect; parameters at zero mean that it is absent.

    Attributes:
        name: a word of the contract.
        form: which of several forms of the same physics it is; empty where there is but one.
        reads_as: what it is confused with, and what tells it apart.
        leaves: effects as which an approximate form of it leaves its own rest, at the same place.
        observed_by: quantities of a log that it is measured by: where these are in doubt it cannot be named.
        changes: field of a state that it changes.
        places: where it can sit.
        own: its parameters, where they are the same at all places.
        counts: sign with which the contract counts its parameters: -1 where it counts what is logged less what is true.
        least_shrink: share of the noise's power that it must take away as well, however significant it looks:
            noise in the regressors' kinematics lets a fit to a clean record shrink it a little, and more so
            where the columns are made of accelerations.
        exact: whether its form is, so that it leaves nothing that another of its name would take up.
        in_torques: whether joint torques show it where no wrench is read.
        price: what must be paid for what was learnt of it from the record before its parameters [nats].
    """

    name: ClassVar[str]
    form: ClassVar[str] = ""
    reads_as: ClassVar[str]
    leaves: ClassVar[tuple[str, ...]] = ()
    observed_by: ClassVar[frozenset[Doubt]] = frozenset()
    changes: ClassVar[str]
    places: ClassVar[staticmethod[[State], tuple[str, ...]]]
    own: ClassVar[tuple[Parameter, ...]]
    counts: ClassVar[float] = 1.0
    least_shrink: ClassVar[float] = 0.1
    exact: ClassVar[bool] = False
    in_torques: ClassVar[bool] = False
    price: float = 0.0

    @property
    def form_name(self) -> str:
        """Name of this form in the library."""
        return self.form or self.name

    def is_seen(self, record: FloatingRecord) -> bool:
        """Whether a record can show it."""
        return self.in_torques or bool(record.robot.sensors)

    @property
    def mujoco_part(self) -> str:
        """What of a MuJoCo model it is, in words; empty where it is noted beside the model."""
        return MODEL_PARTS.get(self.changes, "")

    def locations(self, state: State) -> tuple[str, ...]:
        """Places where it can sit."""
        return self.places(state)

    def parameters_at(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Its parameters there."""
        return self.own

    def fit_starts(self, state: State, location: str) -> tuple[Array, ...]:
        """Parameters with which it is absent and from which a fit may begin; by default zeros alone."""
        return (np.zeros(len(self.parameters_at(state, location))),)

    def stored_data(self, record: FloatingRecord) -> dict[str, Any]:
        """What it stores beside its parameters, ready for JSON; empty by default."""
        return {}

    def with_stored_data(self, said: Mapping[str, Any], record: FloatingRecord) -> FloatingEffect:
        """The effect that holds what :meth:`stored_data` said."""
        return self

    @abstractmethod
    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """The true state if the effect is there with parameters ``theta``."""

    def residual_columns(self, state: State, location: str, theta: Array) -> Array:
        """Minus the derivative of the residual with respect to ``theta``, ``(n, 6, k)``.

        Forward differences: the fit is iterated, and its steps are evaluated in full.
        """
        columns, here = [], state.residual
        if theta.any():
            here = self.apply_to(state, location, theta).residual
        for i, parameter in enumerate(self.parameters_at(state, location)):
            ahead = theta.copy()
            ahead[i] += parameter.step
            columns.append((here - self.apply_to(state, location, ahead).residual) / parameter.step)
        return np.stack(columns, axis=2)

    def report_parameters(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """Parameters by name, as the contract defines the effect; by default those of :meth:`parameters_at`."""
        return {
            p.name: Estimate(self.counts * float(value), float(spread), p.unit)
            for p, value, spread in zip(self.parameters_at(state, location), theta, std, strict=True)
        }

    def effect_name(self, theta: Array) -> str:
        """Name of the effect at these parameters."""
        return self.name

    def parameter_scales(self, state: State, location: str) -> Array:
        """``(k,)`` expected size of each parameter."""
        return np.array([p.scale for p in self.parameters_at(state, location)])


def link_names(state: State) -> tuple[str, ...]:
    """Names of the measured links that have mass, one a segment."""
    phi, unmeasured = state.record.tree.phi, state.record.unmeasured
    return tuple(
        segment.link
        for i, segment in enumerate(state.record.robot.segments)
        if i not in unmeasured and phi[10 * i] > 0.0
    )


# A point of a link, in its joint's frame; the same for all links, so that large ones pay no more.
POINT = Parameter.of_names(("at_x", "at_y", "at_z"), "m", _REACH, 1e-5)


def sensor_names(state: State) -> tuple[str, ...]:
    """Names of what is read."""
    return tuple(state.readings)


def segment_of(state: State, link: str) -> int:
    """Index of a link's segment."""
    return [segment.link for segment in state.record.robot.segments].index(link)


def visible_joints(state: State) -> tuple[str, ...]:
    """Joints whose motion or placement shows in the base's equation: all but those beyond every sensor."""
    record = state.record
    beyond = {segment + 1 for segment in record.unmeasured}
    carriers = {sensor.joint for sensor in record.robot.sensors}
    return tuple(
        name
        for name in record.robot.joint_names
        if (j := joint_of(state, name)) not in beyond or j in carriers
    )


def joint_of(state: State, joint: str) -> int:
    """Index of a joint in the tree."""
    return state.record.tree.names.index(joint)
