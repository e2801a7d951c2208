"""What accepted effects change of a robot's description, and what no description holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from excite.arrays import Array


@dataclass(frozen=True, eq=False)
class RobotChanges:
    """A robot's bodies and drives as a diagnosis found them.

    Attributes:
        viscous: viscous friction by joint [N·m·s/rad].
        coulomb: Coulomb friction by joint [N·m].
        armature: rotor inertia by joint [kg·m²].
        bodies: by link, ``(10,)`` inertial parameters that it has more than the model says, about the link's frame.
        beyond: what a description has no place for, a sentence each.
    """

    viscous: Mapping[str, float] = field(default_factory=dict)
    coulomb: Mapping[str, float] = field(default_factory=dict)
    armature: Mapping[str, float] = field(default_factory=dict)
    bodies: Mapping[str, Array] = field(default_factory=dict)
    beyond: tuple[str, ...] = ()
