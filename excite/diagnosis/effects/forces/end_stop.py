"""A stop that a joint runs into, or a body that the arm touches there: physics that no name of a diagnosis has."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.equations.joint_torque import Fit

# Shares of a joint's travel that may lie beyond the edge.
_SHARES = (0.05, 0.12, 0.22, 0.35, 0.5)
# What acts over more than this of the travel is a spring.
_MOST = 0.6


class EndStop(Effect):
    """``τ = k max(q − edge, 0)``: beyond an edge the joint is pushed back, before it there is nothing.

    The search is over how far the joint goes beyond the edge.
    """

    name = "end_stop"
    nameless = "position"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("stiffness", "N·m/rad", 0.0),)
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("depth", "rad", 1e-3, 6.0),)
    side: ClassVar[float] = 1.0

    @property
    def forms(self) -> tuple[Effect, ...]:
        return (LowerEndStop(),)

    def grid(self, context: Context, location: str) -> list[Theta]:
        travel = float(np.ptp(context.q[:, context.row(location)]))
        return [(share * travel,) for share in _SHARES]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        way = self.side * context.q[:, j]
        beyond = np.maximum(way - (way.max() - theta[0]), 0.0)
        return Shape({j: self.side * beyond[:, None]})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        travel = float(np.ptp(context.q[:, context.row(location)]))
        inside = self.searched[0].low <= theta[0] <= _MOST * travel
        return inside and super().admissible(context, location, theta, beta)

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        way = self.side * context.q[:, context.row(location)]
        stiffness = super().estimates(context, location, theta, fit)["stiffness"]
        return {
            "edge": Estimate(self.side * (float(way.max()) - theta[0]), None, "rad"),
            "stiffness": stiffness,
        }


class LowerEndStop(EndStop):
    """The same at the other end of the travel."""

    side: ClassVar[float] = -1.0

    @property
    def forms(self) -> tuple[Effect, ...]:
        return ()
