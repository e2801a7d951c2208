"""Measured channels beside what was commanded: another joint's, turned, in another unit."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array, assign_rows
from excite.doctor.check import Check, Outcome
from excite.finding import Finding, list_names
from excite.logs.log import Log
from excite.robot.robot import Robot

_DEGREE = 180.0 / np.pi
# A channel tracks a command when what is left is this share of the command's own deviation.
_TRACKS = 0.5
# Factor by which another assignment of channels has to be better.
_BETTER = 3.0
_MEASURED = {"q": "positions", "tau": "torques"}


class Commands(Check):
    """Order, sign and unit of measured positions and torques against their commands; which side is wrong is open."""

    kinds = ("command_order", "command_sign", "command_degrees")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        found = [*_order(log, "q_cmd", "commanded positions"), *_order(log, "tau_cmd", "commanded torques")]
        return Outcome(log, tuple(found))


def _order(log: Log, attribute: str, what: str) -> list[Finding]:
    measured = "q" if attribute == "q_cmd" else "tau"
    pairs = [
        (getattr(trial, measured), getattr(trial, attribute))
        for trial in log.trials
        if getattr(trial, attribute) is not None and getattr(trial, measured) is not None
    ]
    if not pairs:
        return []
    y, x = np.concatenate([pair[0] for pair in pairs]), np.concatenate([pair[1] for pair in pairs])
    deviation = x.std(axis=0)
    moving = (deviation > 1e-6 * max(float(deviation.max()), 1e-12)) & (y.std(axis=0) > 0.0)
    if moving.sum() < 1:
        return []
    names = np.array(log.header.joints)[moving]
    y, x = y[:, moving] - y[:, moving].mean(axis=0), x[:, moving] - x[:, moving].mean(axis=0)
    miss = np.array([[np.sqrt(np.mean((yi - xj) ** 2)) for xj in x.T] for yi in y.T]) / x.std(axis=0)
    own = np.diag(miss)
    rows, order = np.arange(len(miss)), assign_rows(np.minimum(miss, 10.0))
    moved = (rows != order) & (miss[rows, order] < np.minimum(_TRACKS, own / _BETTER))
    if moved.any():
        text = (
            f"{_MEASURED[measured]} of {list_names(tuple(names[moved]))} follow the {what} of "
            f"{list_names(tuple(names[order[moved]]))}: the joints stand in another order in one of them"
        )
        figures = {"own_miss": float(own[moved].max()), "other_miss": float(miss[rows, order][moved].max())}
        return [_finding("command_order", text, figures, tuple(names[moved]))]
    return _sign_and_scale(y, x, own, names, measured, what)


def _sign_and_scale(y: Array, x: Array, own: Array, names: Array, measured: str, what: str) -> list[Finding]:
    slope = (y * x).sum(axis=0) / (x**2).sum(axis=0)
    left = (y - slope * x).std(axis=0) / np.maximum(y.std(axis=0), 1e-300)
    follows = (left < _TRACKS) & (own > _TRACKS)
    found = []
    for kind, chosen, cause in (
        ("command_sign", follows & (slope < 0.0), "the sign of one of them is turned"),
        (
            "command_degrees",
            follows & ((np.abs(slope * _DEGREE - 1.0) < 0.3) | (np.abs(slope / _DEGREE - 1.0) < 0.3)),
            "one is in degrees, the other in radians",
        ),
    ):
        if chosen.any():
            joints = tuple(names[chosen])
            text = f"{_MEASURED[measured]} of {list_names(joints)} are {slope[chosen][0]:.3g} times the {what}: {cause}"
            found.append(_finding(kind, text, {"slope": float(slope[chosen][0])}, joints))
    return found


def _finding(kind: str, text: str, figures: dict[str, float], joints: tuple[str, ...]) -> Finding:
    remedy = "correct the columns that are wrong, the measured ones or the commands"
    return Finding(kind, text, figures, joints, severity="limits", remedy=remedy)
