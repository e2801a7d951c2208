"""An effect's form in a MuJoCo model of an arm: bodies, drives, XML, and what is left to a runner."""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from enum import StrEnum
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.bristle import Bristle, StaticFriction
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.friction_sign import sign_of_motion

if TYPE_CHECKING:
    import mujoco

# What a MuJoCo model cannot say of an effect and leaves to whoever runs it: typed, and as text within the
# model.


class Absence(StrEnum):
    """Why a MuJoCo model cannot have an effect, or a part of it, by itself."""

    FRICTION = "a joint has one level of dry friction, whatever its speed, load, time and deflection"
    SPRING = "a joint's spring is odd in its deflection and not periodic"
    CHANNEL = "a motor has one filter and no delay"
    READING = "the servo and the log read a joint's position alike"
    SENSOR = "a motor's force is that of its own joint alone"
    START = "where a gear stands when a roll-out begins is part of the state"
    SOME_TRIALS = "it is there in some trials alone"
    BEHIND = "it acts behind a coupling or a loop"
    NO_FORM = "no form is given"


def _no_runs() -> Array:
    return np.zeros(0)


@dataclass(eq=False, slots=True)
class JointStep:
    """A joint at the start of a step, in every run of a simulation; all arrays are ``(n_runs,)``.

    Attributes:
        carried: torque that its gear carries, asked for where it is needed [N·m].
        bends: whether all its dry friction builds up over a deflection.
        q: position [rad].
        v: velocity [rad/s].
        trial_s: time since the trial's start [s].
        session_s: time since the session's start [s].
        growth: how far friction that drifts had come when the roll-out began, where that is known.
    """

    carried: Callable[[], Array]
    bends: bool = False
    q: Array = field(default_factory=_no_runs)
    v: Array = field(default_factory=_no_runs)
    trial_s: Array = field(default_factory=_no_runs)
    session_s: Array = field(default_factory=_no_runs)
    growth: Array | None = None


class Note(ABC):
    """What a runner does for an effect; a frozen dataclass of numbers, those that may be missing None by default.

    Attributes:
        beyond: why the model cannot say it.
        every_step: whether the runner has to see to it at every step.
        rubs: whether it changes the joint's dry or viscous friction.
        takes_all: whether its bristles hold all of the joint's dry friction.
    """

    beyond: ClassVar[Absence]
    every_step: ClassVar[bool] = True
    takes_all: ClassVar[bool] = False

    @property
    def has_friction(self) -> bool:
        """Whether it changes the joint's dry or viscous friction."""
        return False

    @property
    def late_by(self) -> float:
        """Time by which the torque channel is late [s]."""
        return 0.0

    @property
    def filter_before(self) -> float:
        """Time constant of a filter before the motors [s]."""
        return 0.0

    @property
    def log_offset(self) -> float:
        """By how much the log's position exceeds the one that a servo reads [rad]."""
        return 0.0

    @property
    def static_friction(self) -> StaticFriction | None:
        """Static friction of the joint, applied to its bristles; None where it has none."""
        return None

    def make_bristle(self) -> Bristle | None:
        """Bristle model of its own; None where it has none."""
        return None

    def held_friction(self, level: Array) -> Array:
        """Dry friction that its own bristles hold, of a joint with a ``level`` of it, both ``(n_runs,)`` [N·m]."""
        return np.zeros_like(level)

    def resting_deflection(self, torque: float) -> float | None:
        """Where the joint's gear rests under a torque [N·m] that it opposes [rad]; None where it does not give way."""
        return None

    def joint_friction(self, level: Array, at: JointStep) -> tuple[Array, Array | float]:
        """A joint's level of dry friction with it [N·m], and viscous friction that it adds [N·m·s/rad], by run."""
        return level, 0.0

    def joint_torque(self, at: JointStep) -> Array | float:
        """Torque on the joint, ``(n_runs,)`` [N·m]."""
        return 0.0

    @classmethod
    def number_names(cls) -> tuple[str, ...]:
        """Names of its numbers, in order."""
        # They are its dataclass' fields, which its abstract class has none of.
        known: Any = cls
        return tuple(f.name for f in fields(known))

    @classmethod
    def from_values(cls, values: Mapping[str, float]) -> Self:
        """The note made from the values that it uses."""
        return cls(**{name: values[name] for name in cls.number_names() if name in values})

    def to_text(self) -> str:
        """Its numbers as ``NAME=NUMBER``, without those that are None."""
        values = ((name, getattr(self, name)) for name in self.number_names())
        return " ".join(f"{name}={value:.9g}" for name, value in values if value is not None)


@dataclass(frozen=True, eq=False)
class Noted:
    """A note at a place.

    Attributes:
        word: what it is called in the model: the effect's name.
        place: joint, or the channels of ``torque``.
        note: the note.
    """

    word: str
    place: str
    note: Note


# What follows a joint's name in that of the joint between its motor and its link.
DEFLECTION = ".deflection"


@dataclass(frozen=True)
class Sizes:
    """An effect's place and sizes, as a diagnosis states them.

    Attributes:
        location: its place.
        values: its parameters by name, SI.
        joints: joints with torque.
    """

    location: str
    values: Mapping[str, float]
    joints: tuple[str, ...] = ()

    def value_of(self, name: str, missing: float = 0.0) -> float:
        """Value of a parameter; ``missing`` where it has none of that name."""
        return float(self.values.get(name, missing))


@dataclass(frozen=True, eq=False)
class Draft:
    """A model in the making.

    Attributes:
        joints: joints with torque.
        spec: the specification.
    """

    joints: tuple[str, ...]
    spec: mujoco.MjSpec

    def find_joint(self, name: str) -> mujoco.MjsJoint:
        """A joint by its name."""
        return self.spec.joint(name)

    def find_motor(self, joint: str) -> mujoco.MjsActuator:
        """A joint's motor."""
        return self.spec.actuator(joint)

    def moved_body(self, joint: str) -> mujoco.MjsBody:
        """The body that a joint moves."""
        return next(b for b in self.spec.bodies if any(j.name == joint for j in b.joints))


Change = Callable[[Draft], None]


@dataclass(frozen=True, eq=False)
class Form:
    """What a model has of an effect; sizes are those that a diagnosis states, whatever columns they were fitted by.

    Attributes:
        viscous: viscous friction of the joint where it is [N·m·s/rad].
        coulomb: dry friction of that joint [N·m].
        armature: rotor inertia of that joint [kg·m²].
        bias: constant in that joint's torque channel [N·m].
        reads: factor of that joint's torque channel; what is fitted to that joint alone is in the channel's units.
        body: inertial parameters of the link where it is, ``(10,)``, in the order of the dynamic parameters.
        gravity: what becomes of gravity ``(3,)`` [m/s²].
        elements: what it changes in the XML.
        finish: likewise, once all else is in the XML.
        notes: what is left to the runner.
        absent: why the model has nothing of it; None where it has.
    """

    viscous: float = 0.0
    coulomb: float = 0.0
    armature: float = 0.0
    bias: float = 0.0
    reads: float = 1.0
    body: Array | None = None
    gravity: Callable[[Array], Array] | None = None
    elements: Change | None = None
    finish: Change | None = None
    notes: tuple[Noted, ...] = field(default=())
    absent: Absence | None = None


@dataclass(frozen=True, eq=False)
class InitialState:
    """What a record tells of an effect's own state, for roll-outs that begin within it, one array a trial.

    Attributes:
        growth: how far friction that drifts has come, ``(n,)``.
        deflection: deflection of a gear [rad] and its speed [rad/s], ``(n, 2)``.
    """

    growth: list[Array] | None = None
    deflection: list[Array] | None = None


# What an effect is given to work with: the fitted baseline and full-rate signals at its parameters.

# Steps of first and second differences [rad], [rad/s].
_STEP, _FAR = 1e-5, 1e-3


@dataclass(frozen=True, eq=False)
class Context:
    """The baseline and full-rate signals at its parameters.

    Attributes:
        baseline: the fitted baseline.
    """

    baseline: Baseline
    _signs: dict[int, Array] = field(default_factory=dict)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints with rows."""
        return self.baseline.samples.joints

    def row(self, joint: str) -> int:
        """Index of a joint's row."""
        return self.joints.index(joint)

    @property
    def follower_indices(self) -> dict[str, int]:
        """Joints that no motor of the log turns alone."""
        return self.baseline.samples.follower_indices

    def signal_at(self, place: str, name: str) -> Array:
        """``q``, ``v`` or ``a`` of a joint, whether or not it has rows, ``(n_samples,)``."""
        samples = self.baseline.samples
        if place in self.joints:
            return samples.motor_signal(name)[:, self.row(place)]
        return samples.stack_trials(name)[:, self.follower_indices[place]]

    def motor_columns(self, place: str, columns: Array) -> dict[int, Array]:
        """Columns of torque at a joint, ``(n_samples, n)``, mapped to the motors that move it."""
        if place in self.joints:
            return {self.row(place): columns}
        along = self.baseline.samples.motion_maps[:, self.follower_indices[place]]
        return {j: columns * along[:, [j]] for j in np.flatnonzero(along.any(axis=0)).tolist()}

    @cached_property
    def q(self) -> Array:
        """``(n_samples, n_joints)`` [rad]."""
        return self.baseline.samples.motor_signal("q")

    @cached_property
    def v(self) -> Array:
        """``(n_samples, n_joints)`` [rad/s]."""
        return self.baseline.samples.motor_signal("v")

    @cached_property
    def a(self) -> Array:
        """``(n_samples, n_joints)`` [rad/s²]."""
        return self.baseline.samples.motor_signal("a")

    @cached_property
    def session_time(self) -> Array:
        """``(n_samples,)`` time since the session's start [s]."""
        return self.baseline.samples.stack_trials("session_s")

    def friction_sign(self, j: int) -> Array:
        """Smoothed sign of the velocity that a joint's dry friction follows, ``(n_samples,)``."""
        if j not in self._signs:
            base = self.baseline
            self._signs[j] = sign_of_motion(base.samples, j, base.signs[j])
        return self._signs[j]

    def perturbed_torques(self, j: int, turn: float = 0.0, speed: float = 0.0, more: float = 0.0) -> Array:
        """Torques of the fitted bodies at a perturbed motion of one joint, ``(n_samples, n_joints)`` [N·m]."""
        samples = self.baseline.samples
        return samples.rigid_torques(self.baseline.phi, *samples.perturbed_motion(j, turn, speed, more))

    def torque_gradient(self, j: int, what: str) -> Array:
        """Change of the torques per unit of a joint's ``q``, ``v`` or ``a``: ``(n_samples, n_joints)``."""
        kept = self.baseline.derived.values
        if (j, what) not in kept:
            step = 1.0 if what == "a" else _STEP
            still = self.baseline.rigid - self.baseline.added
            change = self.perturbed_torques(j, *(step * (what == name) for name in ("q", "v", "a"))) - still
            # A torque in one piece: most take one of them, or all one after the other.
            kept[j, what] = np.asfortranarray(change / step)
        return kept[j, what]

    def torque_curvature(self, j: int, what: str) -> Array:
        """Second derivative of the torques with a joint's motion: ``qq``, ``qv``, ``vv`` or ``qa``, as the gradient."""
        kept = self.baseline.derived.values
        if (j, what) not in kept:
            at = partial(self.perturbed_torques, j)
            # Torques are of second degree in the speeds and of first in the accelerations: steps there may be large.
            h = _FAR
            ahead, behind = at(h), at(-h)
            faster, slower = (at(h, 1.0), at(-h, 1.0)), (at(h, -1.0), at(-h, -1.0))
            still = self.baseline.rigid - self.baseline.added
            kept[j, "qq"] = (ahead - 2.0 * still + behind) / h**2
            kept[j, "qv"] = (faster[0] - faster[1] - slower[0] + slower[1]) / (4.0 * h)
            kept[j, "vv"] = 0.5 * (sum(faster) + sum(slower)) - ahead - behind
            kept[j, "qa"] = (at(h, more=1.0) - ahead - at(-h, more=1.0) + behind) / (2.0 * h)
        return kept[j, what]
