"""Repaired trials that have torques, and what is to be tried on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from excite.arrays import Array
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.samples import ArmSamples
from excite.logs.log import Log
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class TorqueRecord:
    """Repaired trials that have torques, measured or reconstructed.

    Attributes:
        robot: the nominal model.
        log: the log, its trials repaired.
        modelled: what the baseline has, and effects that are not to be tried.
        out: folder for the motion of the next experiment; none is planned without it.
        reconstructed_noise: noise of torques that were not measured, in the rows' band, ``(n_joints,)`` [N·m]; None
            where they were, whose noise stands in their spectrum.
        effects: the library of effects to try.
    """

    robot: Robot
    log: Log
    modelled: tuple[str, ...]
    out: Path | None = None
    reconstructed_noise: Callable[[ArmSamples], Array] | None = None
    effects: tuple[Effect, ...] = field(default_factory=lambda: tuple(EFFECTS.values()))
