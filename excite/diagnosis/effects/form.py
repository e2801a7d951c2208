"""An effect's form in a MuJoCo model of an arm: bodies, drives, XML, and what is left to a runner."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from excite.arrays import Array
from excite.diagnosis.effects.note import Beyond, Noted

if TYPE_CHECKING:
    import mujoco

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

    def value(self, name: str, missing: float = 0.0) -> float:
        """One of its parameters."""
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

    def joint(self, name: str) -> mujoco.MjsJoint:
        """A joint by its name."""
        return self.spec.joint(name)

    def motor(self, joint: str) -> mujoco.MjsActuator:
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
    absent: Beyond | None = None


@dataclass(frozen=True, eq=False)
class Told:
    """What a record tells of an effect's own state, for roll-outs that begin within it, one array a trial.

    Attributes:
        growth: how far friction that drifts has come, ``(n,)``.
        deflection: deflection of a gear [rad] and its speed [rad/s], ``(n, 2)``.
    """

    growth: list[Array] | None = None
    deflection: list[Array] | None = None
