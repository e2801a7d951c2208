"""What a model's file says beside the URDF made of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from excite.robot.description import Assumed


@dataclass(frozen=True)
class Said:
    """What another format said that a URDF cannot.

    Attributes:
        floating: whether the base is free, None where the file does not say.
        posture: joint values of a keyframe at which the robot rests [rad or m].
        ignored: pairs of links that may touch.
        loops: blocks ``loops`` of a ``robot.yaml``.
        couplings: blocks ``couplings`` of one.
        assumed: what was assumed to make the URDF.
        armature: rotor inertia by joint [kg·m² or kg].
    """

    floating: bool | None = None
    posture: Mapping[str, float] | None = None
    ignored: tuple[tuple[str, str], ...] = ()
    loops: tuple[Mapping[str, Any], ...] = ()
    couplings: tuple[Mapping[str, Any], ...] = ()
    assumed: tuple[Assumed, ...] = ()
    armature: Mapping[str, float] = field(default_factory=dict)
