"""How large an effect would have to be for a record to show it beside everything that its model has."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.answer.budget import Detectable
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.budget.fit.joint_fit import Model
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.equations.units import at_joint
from excite.robot.robot import Robot


def detectable_sizes(model: Model, robot: Robot, candidates: int) -> tuple[Detectable, ...]:
    """Sizes at which effects of one parameter at one joint would be worth their price, by effect and place.

    A column c of what is left beside all others gains ``½ share·|c|² β²/σ²`` nats; that has to be the price.

    Args:
        model: the model of the gap.
        robot: the robot, for units.
        candidates: number of effects and places that were tried.
    """
    inverse = np.linalg.inv(model.normal)
    price = THRESHOLDS.price + 0.5 * np.log(max(candidates, 1))
    smallest: dict[tuple[str, str], Detectable] = {}
    for k, term in enumerate(model.design.terms):
        j = term.own
        if term.known or term.size != 1 or j is None or len(term.columns) != 1 or k in model.chosen:
            continue
        g, where = model.design.fitted.total[j], model.design.place[k][j]
        columns, numbers = model.layout.columns[j], model.layout.numbers[j]
        cross = model.weight[j] * g[columns, where[0]]
        left = model.weight[j] * g[where[0], where[0]] - cross @ inverse[np.ix_(numbers, numbers)] @ cross
        if left <= 0.0:
            continue
        size = float(np.sqrt(2.0 * price / (model.share[j] * left))) * float(term.scale[0])
        unit = term.effect.linear[term.kept[0]].unit
        unit = at_joint(robot, term.location, {"size": Estimate(size, None, unit)})["size"].unit
        if term.key not in smallest or size < smallest[term.key].size:
            smallest[term.key] = Detectable(term.name, term.location, size, unit)
    return tuple(smallest.values())
