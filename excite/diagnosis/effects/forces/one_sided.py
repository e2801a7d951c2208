"""What pushes a joint back beyond an edge and does nothing before it: a stop, or a spring with slack."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.equations.joint_torque import Fit


class OneSided(Effect):
    """``τ = k max(q − edge, 0)``; the search is over how far the joint goes beyond the edge.

    Attributes:
        side: 1 where it acts above the edge, −1 below.
        first: shares of the joint's travel beyond the edge from which the search begins.
        within: least and greatest share that its name stands for. What acts over much of the travel is a spring: edges
            at 75 to 85 % of the samples leave 0.15 to 0.46 of the travel of 56 joints beyond them (95 % of the joints),
            edges at half of the samples 0.42 to 0.58.
    """

    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("stiffness", "N·m/rad", 0.0),)
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("depth", "rad", 1e-3, 12.0),)
    by_motion = True
    side: ClassVar[float] = 1.0
    first: ClassVar[tuple[float, ...]] = ()
    within: ClassVar[tuple[float, float]] = (0.0, 1.0)

    def grid(self, context: Context, location: str) -> list[Theta]:
        travel = float(np.ptp(context.q[:, context.row(location)]))
        return [(share * travel,) for share in self.first]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        way = self.side * context.q[:, j]
        beyond = np.maximum(way - (way.max() - theta[0]), 0.0)
        return Shape({j: self.side * beyond[:, None]})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        travel = float(np.ptp(context.q[:, context.row(location)]))
        least, most = self.within
        return (
            self.searched[0].low <= theta[0]
            and least * travel <= theta[0] <= most * travel
            and beta[0] >= 0.0
        )

    def beyond_edge(self, context: Context, location: str, theta: Theta) -> Theta:
        """Non-linear parameters of what acts on the other side of the same edge."""
        return (float(np.ptp(context.q[:, context.row(location)])) - theta[0],)

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        way = self.side * context.q[:, context.row(location)]
        stiffness = super().estimates(context, location, theta, fit)["stiffness"]
        return {
            "edge": Estimate(self.side * (float(way.max()) - theta[0]), None, "rad"),
            "stiffness": stiffness,
        }
