"""How fast two bodies of a robot can approach each other, whatever its configuration."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.sliding import is_prismatic


def approach_rates(model: pin.Model, geometry: pin.GeometryModel) -> Array:
    """Largest rate at which each joint changes the distance of each pair, per unit of its speed.

    Only joints on the way from one body to the other count. A revolute joint at 1 rad/s moves the farthest
    point of the body beyond it by no more than its distance from the joint's origin, in m/s, and that is at
    most the sum of the links between and the body's own radius; a prismatic joint by 1. A free base has two
    columns: its linear speed with rate 1, its angular speed with the distance.

    Args:
        model: pinocchio model of joints with one coordinate, the first possibly a free-flyer.
        geometry: its collision model with pairs.

    Returns:
        ``(n_pairs, n_columns)``, one column a joint in model order, two for a free base [m/rad or 1].
    """
    rates = np.array([_body_rates(model, shape) for shape in geometry.geometryObjects])
    ancestors = np.array([_columns_above(model, shape.parentJoint) for shape in geometry.geometryObjects])
    first = np.array([pair.first for pair in geometry.collisionPairs], dtype=int)
    second = np.array([pair.second for pair in geometry.collisionPairs], dtype=int)
    between = ancestors[first] != ancestors[second]
    return np.asarray((rates[first] + rates[second]) * between)


def _first_column(model: pin.Model, joint: int) -> int:
    """First column of a joint."""
    free = model.nvs[1] == 6
    return joint if free and joint > 1 else joint - 1


def _columns_above(model: pin.Model, joint: int) -> Array:
    above = np.zeros(_n_columns(model), dtype=bool)
    for ancestor in list(model.supports[joint])[1:]:
        above[_first_column(model, ancestor)] = True
        if model.nvs[ancestor] == 6:
            above[1] = True
    return above


def _n_columns(model: pin.Model) -> int:
    return int(model.njoints - 1 + (1 if model.nvs[1] == 6 else 0))


def _body_rates(model: pin.Model, shape: pin.GeometryObject) -> Array:
    """Rates by which the joints above a body move its points, zero for the others."""
    local = shape.geometry
    local.computeLocalAABB()
    reach = float(np.linalg.norm(shape.placement.act(local.aabb_center)) + local.aabb_radius)
    rates = np.zeros(_n_columns(model))
    for joint in reversed(list(model.supports[shape.parentJoint])[1:]):
        column = _first_column(model, joint)
        prismatic = model.nvs[joint] == 1 and is_prismatic(model, model.idx_vs[joint])
        if model.nvs[joint] == 6:
            rates[column], rates[column + 1] = 1.0, reach
            continue
        rates[column] = 1.0 if prismatic else reach
        if prismatic:
            q = model.idx_qs[joint]
            reach += max(abs(model.lowerPositionLimit[q]), abs(model.upperPositionLimit[q]))
        reach += float(np.linalg.norm(model.jointPlacements[joint].translation))
    return rates
